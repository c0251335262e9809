"""What a harvest tells, in any model, and when it is given up.

An exchange is that a picker leaves a full bin, and gets an empty one from a carrier.
"""

from dataclasses import dataclass

# Ticks for each bin of a harvest after which it is given up, whatever robots do: far beyond any.
LONGEST = 4_000_000
# Ticks in which no robot drives on or finishes a step: they wait for each other.
JAM = 6_000
# Ticks after which it is looked whether robots move on, where a harvest stops for decisions.
LOOK_AT = JAM // 20


@dataclass
class Exchange:
    """An exchange of bins, and what its carrier did for it."""

    #: The tick at which the picker got the empty bin.
    tick: int
    #: Ticks for which its carrier was busy, until it could leave the queue again. None: it is out.
    carrier_ticks: float | None = None
    #: What the carrier used of its battery in that time, as a share.
    battery_used: float = 0.0
