"""Colours: what a robot does, who speaks to whom, and what stands in the field. sRGB."""

from typing import NamedTuple

Colour = tuple[int, int, int]

PICKING, DRIVING, WAITING = "picking", "driving", "waiting"
STOPPED, CALLING, HANDLING = "stopped", "calling", "handling a bin"
HAULING, UNLOADING, RESTING = "hauling a full bin", "unloading", "resting"

STATES: dict[str, Colour] = {
    PICKING: (76, 175, 80),
    DRIVING: (45, 140, 240),
    WAITING: (255, 160, 20),
    STOPPED: (235, 50, 60),
    CALLING: (255, 90, 170),
    HANDLING: (205, 220, 57),
    HAULING: (0, 190, 200),
    UNLOADING: (165, 80, 220),
    RESTING: (150, 155, 160),
}

HELD_UP = ("stopped", "held up", "blocked", "obstacle")  # anywhere in what a robot says: it cannot go on
WORDS: dict[str, str] = {  # else the one of these that comes first
    "driv": DRIVING,
    "going": DRIVING,
    "turning": DRIVING,
    "mov": DRIVING,
    "bringing": DRIVING,
    "walking": DRIVING,
    "wandering": DRIVING,
    "unload": UNLOADING,
    "loaded": UNLOADING,
    "call": CALLING,
    "asking": CALLING,
    "wait": WAITING,
    "queue": WAITING,
    "comes": WAITING,
    "pick": PICKING,
    "coupl": HANDLING,
    "uncoupl": HANDLING,
    "leav": HANDLING,
    "taking": HAULING,
    "rest": RESTING,
    "done": RESTING,
    "park": RESTING,
    "stand": RESTING,
    "idle": RESTING,
    "finish": RESTING,
    "grow": RESTING,
}


def state_of(doing: str) -> str:
    """The state that a text like 'picking row 3' tells; one that says nothing rests, any other drives."""
    said = doing.lower()
    if any(word in said for word in HELD_UP):
        return STOPPED
    found = [(said.index(word), -len(word), state) for word, state in WORDS.items() if word in said]
    return min(found)[2] if found else DRIVING if said else RESTING


def colour_of(doing: str) -> Colour:
    return STATES[state_of(doing)]


class Line(NamedTuple):
    """How something that is said is drawn between the two."""

    colour: Colour
    seconds: float  # how long it stays
    radius: float  # m
    rank: int  # where there are too many lines, those of a lower rank go first


_ASKED, _OFFERED = Line((255, 90, 170), 1.5, 0.05, 1), Line((255, 200, 60), 1.5, 0.05, 0)
_SENT, _TOLD = Line((60, 220, 120), 5.0, 0.14, 3), Line((60, 200, 255), 4.0, 0.1, 2)
TALK: dict[str, Line] = {
    "call": _ASKED,
    "emptybin": _ASKED,
    "offer": _OFFERED,
    "come": _SENT,
    "yes": _SENT,
    "carrier": _TOLD,
    "here": _TOLD,
    "no": Line((170, 170, 170), 1.0, 0.05, 0),
}
QUIET = frozenset({"claim", "places", "state", "binstate", "confirm", "where", "position", "no", "deedrefused"})  # logged as DEBUG


def plain(what: str) -> str:
    """The key of an event's word in these tables."""
    return what.lower().replace(" ", "").replace("_", "")


GRASS, MOWN, SOIL, BARE = (92, 134, 62), (102, 146, 70), (158, 130, 96), (116, 96, 70)
MEADOW = (98, 136, 70)
FIELDS: tuple[Colour, ...] = (MEADOW, (110, 146, 76), (88, 124, 66), (128, 148, 84), (84, 118, 62))  # around, as far as one sees
ROW_RIPE, ROW_PICKED = (74, 110, 50), (214, 188, 124)
GRAVEL, ROAD_EDGE = (196, 192, 182), (228, 224, 214)
BARK, POST, WIRE, FENCE, KERB = (98, 70, 48), (150, 130, 104), (200, 200, 205), (136, 112, 84), (168, 160, 148)
LEAVES: tuple[Colour, ...] = ((78, 142, 56), (92, 158, 62), (66, 128, 50), (108, 172, 72))
VINE: tuple[Colour, ...] = ((124, 186, 76), (108, 172, 66), (138, 198, 88))
KIWI, KIWI_FLESH = (124, 90, 46), (148, 178, 60)
BAR = (236, 236, 240)
SHADE = (24, 40, 16)
SKY = (206, 224, 238)
