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
    """The look of an arc, which shows a message between two bodies.

    `seconds`: for how long it is shown. `radius`: screen points. `rank`: if there are too many
    arcs, those of lower rank are left out.
    """

    colour: Colour
    seconds: float
    radius: float
    rank: int


_ASKED = Arc(colour=(255, 90, 170), seconds=1.5, radius=1.0, rank=1)
_OFFERED = Arc(colour=(255, 200, 60), seconds=1.5, radius=1.0, rank=0)
_SENT = Arc(colour=(60, 220, 120), seconds=5.0, radius=2.5, rank=3)
_TOLD = Arc(colour=(60, 200, 255), seconds=4.0, radius=2.0, rank=2)
_REFUSED = Arc(colour=(170, 170, 170), seconds=1.0, radius=1.0, rank=0)
TALK: dict[str, Arc] = {
    "call": _ASKED,
    "emptybin": _ASKED,
    "offer": _OFFERED,
    "come": _SENT,
    "yes": _SENT,
    "carrier": _TOLD,
    "here": _TOLD,
    "no": _REFUSED,
}
# Events that are logged as DEBUG.
QUIET = frozenset(
    {"claim", "places", "state", "binstate", "confirm", "where", "position", "no", "deedrefused"}
)


def plain(word: str) -> str:
    """Return the key of an event's word in these tables: lower case, without spaces and
    underscores.
    """
    return word.lower().replace(" ", "").replace("_", "")


# Kind of body -> colour of what its laser hits.
SCANS: dict[str, Colour] = {
    "picker": (255, 0, 200),
    "carrier": (0, 150, 255),
    "tractor": (255, 40, 30),
}
OTHER_SCANS: Colour = (250, 250, 120)

GRASS = (92, 134, 62)
MOWN = (102, 146, 70)
SOIL = (158, 130, 96)
BARE = (116, 96, 70)
MEADOW = (98, 136, 70)
# Around the orchard, up to the horizon.
FIELDS: tuple[Colour, ...] = (
    MEADOW,
    (110, 146, 76),
    (88, 124, 66),
    (128, 148, 84),
    (84, 118, 62),
)
ROW_RIPE = (74, 110, 50)
ROW_PICKED = (214, 188, 124)
GRAVEL = (196, 192, 182)
ROAD_EDGE = (228, 224, 214)
WIRE = (200, 200, 205)
FENCE = (136, 112, 84)
KERB = (168, 160, 148)
LEAVES = (78, 142, 56)
VINE = (124, 186, 76)
KIWI = (124, 90, 46)
BAR = (236, 236, 240)
YELLOW = (255, 214, 0)
PAINT = (250, 250, 245)
CHARGING = (30, 150, 90)
SHADE = (24, 40, 16)
SKY = (206, 224, 238)
