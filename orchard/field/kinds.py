"""The kinds of bodies (size, colour, speed, laser, towing), and the names of agents.

An agent drives a body. Its name is the body's: a kind and a number, as in "picker_01". Sizes and
speeds are those of the manual (docs/manual.md); docs/reference.md lists them.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from orchard.field.repeatable import PI


# Lasers are compared by identity (`eq=False`): there is one for each kind, and they are keys of
# tables in which beams are looked up at each scan. A comparison of their fields would cost time.
@dataclass(frozen=True, eq=False)
class Laser:
    """A laser range finder. Its beams go counter-clockwise."""

    beams: int
    first: float  # rad, the angle of the first beam
    increment: float  # rad, from a beam to the next one
    ahead: float  # m, from the body's centre forward to where it is mounted


Colour = tuple[int, int, int]  # sRGB, each 0 to 255


@dataclass(frozen=True)
class Kind:
    """The properties of all bodies of a kind."""

    length: float  # m, along its heading
    width: float  # m
    height: float  # m
    colour: Colour
    speed: float  # m/s, maximum
    turn: float  # rad/s, maximum
    laser: Laser
    # m from its centre back to the centre of its coupled bin; 0: it tows nothing.
    tows: float = 0.0
    # Whether others collide with it. Weeds are flat.
    solid: bool = True
    # Whether it is a robot. Robots move before people and animals. They can be stopped, and their
    # states are counted.
    robot: bool = False
    # Whether it moves only on the bar of a robot, as a bin does, and there also to its left and
    # right.
    sideways: bool = False

    @property
    def radius(self) -> float:
        """The radius of the circle around its box, m."""
        return 0.5 * math.sqrt(self.length * self.length + self.width * self.width)

    @property
    def drives(self) -> bool:
        """Whether it moves by itself."""
        return self.speed > 0.0 and not self.sideways


# The furthest and the nearest return of all lasers, m. A ray is cast from the laser's centre itself
# (orchard/sim/kernels/laser.py), so no return is too near.
LASER_RANGE = 10.0
LASER_NEAREST = 0.0
FRONT_BEAMS = 180
AROUND_BEAMS = 60


def _front(length: float) -> Laser:
    """Return the laser at the front of a body, which sees the half circle ahead of it.

    `length`: of the body, m. Both ends of the half circle have a beam, so there is one gap fewer
    than beams.
    """
    return Laser(
        beams=FRONT_BEAMS, first=-PI / 2, increment=PI / (FRONT_BEAMS - 1), ahead=length / 2
    )


# The laser in the middle of a body that sees all around it.
AROUND = Laser(beams=AROUND_BEAMS, first=0.0, increment=2 * PI / AROUND_BEAMS, ahead=0.0)
# An eighth of a half turn, rad. Robots turn by so much in a second (docs/manual.md).
EIGHTH = PI / 8


def _person(colour: Colour) -> Kind:
    return Kind(
        length=0.55,
        width=1.0,
        height=1.7,
        colour=colour,
        speed=1.0,
        turn=PI,
        laser=_front(0.55),
    )


def _animal(colour: Colour) -> Kind:
    return Kind(
        length=1.0,
        width=0.8,
        height=0.7,
        colour=colour,
        speed=3.0,
        turn=2 * PI,
        laser=_front(1.0),
    )


KINDS: dict[str, Kind] = {
    "picker": Kind(
        length=2.5,
        width=1.5,
        height=1.0,
        colour=(238, 130, 238),
        speed=1.0,
        turn=EIGHTH,
        laser=_front(2.5),
        tows=2.25,
        robot=True,
    ),
    "carrier": Kind(
        length=1.8,
        width=1.5,
        height=0.5,
        colour=(0, 170, 255),
        speed=1.0,
        turn=EIGHTH,
        laser=_front(1.8),
        tows=1.9,
        robot=True,
    ),
    "tractor": Kind(
        length=5.0,
        width=3.0,
        height=3.0,
        colour=(220, 30, 30),
        speed=1.0,
        turn=EIGHTH,
        laser=_front(5.0),
        robot=True,
    ),
    "bin": Kind(
        length=1.0,
        width=1.0,
        height=1.0,
        colour=(178, 34, 34),
        speed=3.0,
        turn=2 * PI,
        laser=AROUND,
        robot=True,
        sideways=True,
    ),
    "worker": _person(colour=(34, 139, 34)),
    "visitor": _person(colour=(127, 255, 212)),
    "dog": _animal(colour=(128, 128, 128)),
    "cat": _animal(colour=(255, 140, 0)),
    "weed": Kind(
        length=0.5,
        width=0.5,
        height=0.5,
        colour=(60, 160, 40),
        speed=0.0,
        turn=0.0,
        laser=AROUND,
        solid=False,
    ),
}

# Lists of kinds that the program treats alike. They follow from the properties above, so a new kind
# is in them by itself.
ROBOTS = tuple(name for name, kind in KINDS.items() if kind.robot)
# Robots that drive by themselves: all but bins. They have a pin in the picture, a short name and
# GNSS receivers of their own.
VEHICLES = tuple(name for name in ROBOTS if KINDS[name].drives)
# What tows bins. The harvest makes progress while these robots finish steps of their plans.
HAULERS = tuple(name for name, kind in KINDS.items() if kind.tows)
# What drives or walks by itself. Their scans are recorded, and they can learn.
MOVERS = tuple(name for name, kind in KINDS.items() if kind.drives)

# The built-in agents without a body: `traffic` grants places on the roads, `dispatch` sends
# carriers to full bins.
TRAFFIC = "traffic"
DISPATCH = "dispatch"
BODILESS = (TRAFFIC, DISPATCH)
PEOPLE = ("worker", "visitor")
ANIMALS = ("dog", "cat")


def kind_of(name: str) -> str:
    """Return the kind in a name: "picker" for "picker_01"."""
    return name.rsplit("_", 1)[0]


def number_of(name: str) -> int:
    """Return the number in a name: 1 for 'picker_01'."""
    return int(name.rsplit("_", 1)[1])


def short_name(name: str) -> str:
    """Return the short name of a robot, for narrow places: 'P01' for 'picker_01'."""
    kind, _, number = name.rpartition("_")
    return f"{kind[0].upper()}{number}"


def name_of(kind: str, number: int) -> str:
    """Return the name of the number-th body of a kind, counted from 1."""
    return f"{kind}_{number:02d}"


def select_agents(
    names: Iterable[str], only: list[str], without: list[str], share: str = "0/1"
) -> list[str]:
    """Return the selected ones of some names of agents, in their order.

    `only` and `without`: kinds or names; an empty `only` selects all. `share` is "I/N": of the
    names that `only` and `without` leave, every N-th one is taken, beginning with number I, from 0.
    Raises ValueError for an unknown kind or name, or a wrong share.
    """
    names = list(names)
    for word in [*only, *without]:
        if not any(_is_meant(name, [word]) for name in names):
            kinds = ", ".join(sorted({kind_of(name) for name in names}))
            raise ValueError(f"{word}: no such agent or kind; there are {kinds}")
    first, _, step = share.partition("/")
    if not (first.isdecimal() and step.isdecimal() and int(first) < int(step)):
        raise ValueError(f"share {share}: must be I/N, with I from 0 to N - 1")
    selected = []
    for name in names:
        is_selected = not only or _is_meant(name, only)
        if is_selected and not _is_meant(name, without):
            selected.append(name)
    return selected[int(first) :: int(step)]


def _is_meant(name: str, words: list[str]) -> bool:
    """Whether a name, or its kind, is one of some words."""
    return name in words or kind_of(name) in words
