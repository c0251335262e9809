"""The names that a scenario can have: of policies of dispatch, rules for rows and orders of picking
that are built in, and of what follows a policy's mistake. And names that agents cannot have.
"""

from orchard.field.kinds import BODILESS

NEAREST = "nearest"
ROLLING = "rolling"
# A value of `dispatch_errors`, and no policy: the run ends at an order that cannot be.
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
