"""The names of what is built in: policies of dispatch, rules for rows, orders of picking."""

from orchard.field.kinds import BODILESS

NEAREST = "nearest"
ROLLING = "rolling"
END = "end"
# The built-in policies.
DISPATCH_POLICIES = (
    NEAREST,
    "farthest-first",
    "longest-waiting",
    "predictive",
    "predictive-farthest",
    ROLLING,
    "assignment",
)
BALANCED = "balanced"
BALANCED_ENDS = "balanced-ends"
MANUAL = "manual"
BALANCED_TIMES = "balanced-times"
# The built-in rules for rows.
ROW_RULES = (BALANCED, BALANCED_ENDS, MANUAL, BALANCED_TIMES)
ONWARD = "onward"
OUTWARD = "outward"
# The built-in orders of picking inside a row.
ROW_ORDERS = (ONWARD, OUTWARD)
# Names that a user's agent without a body cannot have.
RESERVED = (*BODILESS, "physics", "logger")
