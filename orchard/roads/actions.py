"""The actions of vehicles, by the names that orders of VDA 5050 use.

An action of an order is done at a node or on an edge. An instant action is done at once, outside of
any order. A vehicle's factsheet declares both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Literal


@dataclass(frozen=True)
class VehicleAction:
    """An action of an order."""

    #: Pattern of the names of the nodes at which it is possible, such as "*/bin/*"; with the scope
    #: EDGE it is possible on the edges to them.
    nodes: str
    #: Whether it needs the parameter `loadId`, the name of a bin.
    needs_load: bool
    description: str
    scope: Literal["NODE", "EDGE"] = "NODE"

    @property
    def blocking(self) -> list[str]:
        """The blocking types of VDA 5050 with which an order may name it, the usual one first.

        HARD: the vehicle stands, and does nothing else meanwhile, as at a node. NONE and SINGLE: it
        drives on meanwhile, as on an edge.
        """
        if self.scope == "NODE":
            return ["HARD"]
        return ["NONE", "SINGLE"]

    def is_done_at(self, node: str) -> bool:
        """Whether it can be done at this node, or on an edge to it."""
        return fnmatch(node, self.nodes)


# Names of actions. `pick` and `drop` are those of VDA 5050, and mean bins here, not fruit.
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
# Actions whose `loadId`, if an order has it, must name the bin that is on the bar.
WITH_THE_BIN = (DROP, UNLOAD)
# Parameters of actions that an order may have, and that change nothing here.
IGNORED = ("stationType", "stationName", "loadType")

# Name of an instant action -> what a vehicle does.
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
