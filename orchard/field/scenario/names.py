"""The names that a scenario can have as values: built-in policies of dispatch, rules for rows, and
orders of picking.

Also what can follow a policy's mistake, and the names that agents of users cannot have.
"""

from orchard.field.kinds import BODILESS

NEAREST = "nearest"
ROLLING = "rolling"
# A value of `dispatch_errors`, and no policy: the run ends at an order of a policy that no carrier
# can follow. The other value is NEAREST: the policy `nearest` takes over.
END = "end"
# The built-in policies. Their classes stand at the same places in `orchard/dispatch/policies.py`.
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
