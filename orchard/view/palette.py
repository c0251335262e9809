"""Colours (sRGB) of states, arcs, laser hits and the field."""

from typing import NamedTuple

from orchard.contract.agent import State

Colour = tuple[int, int, int]

STATES: dict[State, Colour] = {
    "picking": (76, 175, 80),
    "driving": (45, 140, 240),
    "waiting": (255, 160, 20),
    "stopped": (235, 50, 60),
    "failed": (150, 85, 40),
    "calling": (255, 90, 170),
    "handling a bin": (205, 220, 57),
    "hauling": (0, 190, 200),
    "unloading": (165, 80, 220),
    "resting": (150, 155, 160),
    "broken": (250, 250, 250),
}


class Arc(NamedTuple):
    """The look of an arc, which shows a message between two bodies."""

    colour: Colour
    seconds: float  # for which it is shown
    radius: float  # screen points
    rank: int  # if there are too many arcs, those of lower rank are left out


_ASKED, _OFFERED = Arc((255, 90, 170), 1.5, 1.0, 1), Arc((255, 200, 60), 1.5, 1.0, 0)
_SENT, _TOLD = Arc((60, 220, 120), 5.0, 2.5, 3), Arc((60, 200, 255), 4.0, 2.0, 2)
TALK: dict[str, Arc] = {
    "call": _ASKED,
    "emptybin": _ASKED,
    "offer": _OFFERED,
    "come": _SENT,
    "yes": _SENT,
    "carrier": _TOLD,
    "here": _TOLD,
    "no": Arc((170, 170, 170), 1.0, 1.0, 0),
}
QUIET = frozenset(
    {"claim", "places", "state", "binstate", "confirm", "where", "position", "no", "deedrefused"}
)  # logged as DEBUG


def plain(what: str) -> str:
    """Return the key of an event's word in these tables: lower case, without spaces and
    underscores.
    """
    return what.lower().replace(" ", "").replace("_", "")


SCANS: dict[str, Colour] = {
    "picker": (255, 0, 200),
    "carrier": (0, 150, 255),
    "tractor": (255, 40, 30),
}  # of the laser hits of a kind
OTHER_SCANS: Colour = (250, 250, 120)

GRASS, MOWN, SOIL, BARE = (92, 134, 62), (102, 146, 70), (158, 130, 96), (116, 96, 70)
MEADOW = (98, 136, 70)
FIELDS: tuple[Colour, ...] = (
    MEADOW,
    (110, 146, 76),
    (88, 124, 66),
    (128, 148, 84),
    (84, 118, 62),
)  # around the orchard, up to the horizon
ROW_RIPE, ROW_PICKED = (74, 110, 50), (214, 188, 124)
GRAVEL, ROAD_EDGE = (196, 192, 182), (228, 224, 214)
WIRE, FENCE, KERB = (200, 200, 205), (136, 112, 84), (168, 160, 148)
LEAVES, VINE = (78, 142, 56), (124, 186, 76)
KIWI = (124, 90, 46)
BAR = (236, 236, 240)
YELLOW, PAINT, CHARGING = (255, 214, 0), (250, 250, 245), (30, 150, 90)
SHADE = (24, 40, 16)
SKY = (206, 224, 238)
