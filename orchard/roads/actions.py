"""What a vehicle can do at a node or on an edge, and what it obeys at once: as orders name it, and
as its factsheet declares it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Literal


@dataclass(frozen=True)
class VehicleAction:
    """An action.

    `nodes`: at which nodes it is possible, or on the edges to them; `needs_load`: whether it needs
    the parameter `loadId`.
    """

    nodes: str
    needs_load: bool
    description: str
    scope: Literal["NODE", "EDGE"] = "NODE"

    @property
    def blocking(self) -> list[str]:
        """The blocking types that fit it: at a node a vehicle stands and does one thing, on an edge
        it drives.
        """
        if self.scope == "NODE":
            return ["HARD"]
        return ["NONE", "SINGLE"]

    def is_done_at(self, node: str) -> bool:
        """Whether it can be done at this node, or on an edge to it."""
        return fnmatch(node, self.nodes)


PICK = "pick"
DROP = "drop"
HAND_OVER = "handOver"
UNLOAD = "unload"
HARVEST = "harvest"
# Kind of vehicle -> name of an action -> the action.
ACTIONS: Mapping[str, Mapping[str, VehicleAction]] = {
    "carrier": {
        PICK: VehicleAction(
            "*/bin/*", True, "couple the bin loadId, which stands right behind the vehicle"
        ),
        DROP: VehicleAction("*/stop/*", False, "uncouple the bin; it stays where it stands"),
        HAND_OVER: VehicleAction(
            "*/stop/*",
            True,
            "leave the empty bin to the picker that has left the full bin loadId, and wait until it"
            " has it",
        ),
        UNLOAD: VehicleAction("bay*", False, "stand in the bay until the bin is empty"),
    },
    "picker": {
        HARVEST: VehicleAction(
            "*/out/*",
            False,
            "pick the row on the way through it, and weigh the bin at its end",
            "EDGE",
        ),
        DROP: VehicleAction(
            "*/out/*",
            False,
            "drive to the lane's mouth and leave the bin there, which calls a carrier",
        ),
        PICK: VehicleAction(
            "*/wait/*", False, "wait for the empty bin that a carrier brings, and couple it"
        ),
    },
}
WITH_THE_BIN = (DROP, UNLOAD)  # their loadId, if there is one, names the bin on the bar
IGNORED = ("stationType", "stationName", "loadType")  # parameters that change nothing here

INSTANT: Mapping[str, str] = {
    "startPause": "stand, until stopPause",
    "stopPause": "go on",
    "cancelOrder": (
        "drive on to the next node at most, finish a running action, and forget the order"
    ),
    "stateRequest": "send the state",
    "factsheetRequest": "send the factsheet",
    "clearInstantActions": "forget the instant actions that are finished or failed",
}
