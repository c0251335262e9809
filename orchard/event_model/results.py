"""What a harvest tells, in any model, and when it is given up."""

from dataclasses import dataclass

# Ticks for each bin. A harvest in which robots wait for each other ends then.
LONGEST = 4_000_000
# Ticks in which no robot drives on or finishes a step: they wait for each other.
JAM = 6_000
# Ticks after which it is looked whether robots move on, where a harvest stops for decisions.
LOOK_AT = JAM // 20


@dataclass
class Exchange:
    """An exchange of bins, and what its carrier did for it."""

    #: At which the picker got the empty bin.
    tick: int
    #: For which its carrier was busy, until it could leave the queue again. None: it is still out.
    carrier_ticks: float | None = None
    #: What the carrier used of its battery in that time, as a share.
    battery_used: float = 0.0
