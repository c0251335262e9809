"""What a harvest tells, in any model."""

from dataclasses import dataclass


@dataclass
class Exchange:
    """An exchange of bins, and what its carrier did for it."""

    #: At which the picker got the empty bin.
    tick: int
    #: For which its carrier was busy, until it could leave the queue again. None: it is still out.
    carrier_ticks: float | None = None
    #: What the carrier used of its battery in that time, as a share.
    battery_used: float = 0.0
