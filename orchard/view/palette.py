"""Colours: what a robot does, who speaks to whom, and what stands in the field. sRGB."""

Colour = tuple[int, int, int]

PICKING, DRIVING, WAITING = "picking", "driving", "waiting"
STOPPED, CALLING, HANDLING = "stopped", "calling", "handling a bin"
UNLOADING, RESTING = "unloading", "resting"

STATES: dict[str, Colour] = {
    PICKING: (76, 175, 80),
    DRIVING: (45, 140, 240),
    WAITING: (255, 160, 20),
    STOPPED: (235, 50, 60),
    CALLING: (255, 90, 170),
    HANDLING: (0, 190, 200),
    UNLOADING: (165, 80, 220),
    RESTING: (150, 155, 160),
}

# The first of these words that is in what a robot says it does decides the state.
WORDS: tuple[tuple[str, str], ...] = (
    ("stop", STOPPED),
    ("held", STOPPED),
    ("block", STOPPED),
    ("obstacle", STOPPED),
    ("unload", UNLOADING),
    ("call", CALLING),
    ("asking", CALLING),
    ("wait", WAITING),
    ("queue", WAITING),
    ("pick", PICKING),
    ("coupl", HANDLING),
    ("leav", HANDLING),
    ("taking", HANDLING),
    ("bringing", DRIVING),
    ("rest", RESTING),
    ("done", RESTING),
    ("parked", RESTING),
    ("stand", RESTING),
    ("idle", RESTING),
    ("finished", RESTING),
)


def state_of(doing: str) -> str:
    """The state that a text like 'picking row 3' tells; one that says nothing rests, any other drives."""
    if not doing:
        return RESTING
    words = doing.lower()
    return next((state for word, state in WORDS if word in words), DRIVING)


def colour_of(doing: str) -> Colour:
    return STATES[state_of(doing)]


# What is said -> colour of its line between the two.
TALK: dict[str, Colour] = {
    "call": (255, 90, 170),
    "emptybin": (255, 90, 170),
    "offer": (255, 200, 60),
    "come": (60, 220, 120),
    "confirm": (60, 220, 120),
    "yes": (60, 220, 120),
    "carrier": (60, 200, 255),
    "here": (60, 200, 255),
    "no": (170, 170, 170),
}
QUIET = frozenset({"claim", "places", "state", "binstate", "confirm"})  # said all the time: logged as DEBUG, never drawn

GRASS, MEADOW, SOIL = (104, 142, 66), (120, 156, 82), (139, 116, 84)
ROW_RIPE, ROW_PICKED = (72, 104, 48), (196, 176, 116)
GRAVEL, ROAD_EDGE = (178, 172, 160), (214, 208, 196)
BARK, POST, WIRE, FENCE, KERB = (98, 70, 48), (150, 130, 104), (200, 200, 205), (136, 112, 84), (168, 160, 148)
LEAVES: tuple[Colour, ...] = ((62, 118, 44), (76, 136, 52), (52, 104, 40), (88, 146, 60))
VINE: tuple[Colour, ...] = ((98, 158, 62), (84, 146, 54), (112, 168, 72))
KIWI, KIWI_FLESH = (124, 90, 46), (148, 178, 60)
BAR = (60, 62, 68)
SKY = (206, 224, 238)
