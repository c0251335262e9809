"""The kinds of bodies (size, colour, speed, laser, towing), and the names of agents.

Figures: docs/reference.md.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from orchard.field.repeatable import PI


# Lasers are compared by identity: there is one for each kind, and they are keys of what is looked
# up often.
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
    solid: bool = True
    # Robots move before people and animals. They can be stopped, and their states are counted.
    robot: bool = False
    # Whether it can move to its left and right, but only on the bar of a robot.
    sideways: bool = False

    @property
    def radius(self) -> float:
        """The radius of the circle around its box, m."""
        return 0.5 * math.sqrt(self.length * self.length + self.width * self.width)

    @property
    def drives(self) -> bool:
        """Whether it moves by itself."""
        return self.speed > 0.0 and not self.sideways


LASER_RANGE = 10.0  # m
# m. A ray is cast from the laser's centre itself (orchard/sim/kernels/laser.py), so no return is
# too near.
LASER_NEAREST = 0.0


def _front(length: float) -> Laser:
    """Return the laser at the front of a body. `length`: of the body, m."""
    return Laser(beams=180, first=-PI / 2, increment=PI / 179, ahead=length / 2)


AROUND = Laser(beams=60, first=0.0, increment=2 * PI / 60, ahead=0.0)
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

# What is done for several kinds follows from their properties: a new kind is in these lists by
# itself.
ROBOTS = tuple(name for name, kind in KINDS.items() if kind.robot)
# Robots with a pin, a short name and receivers of their own: all but bins.
VEHICLES = tuple(name for name in ROBOTS if KINDS[name].drives)
# The harvest makes progress while they finish steps of their plans.
HAULERS = tuple(name for name, kind in KINDS.items() if kind.tows)
# Their scans are recorded, and they can learn.
MOVERS = tuple(name for name, kind in KINDS.items() if kind.drives)

# The agents without a body that the program brings: one grants places on the roads, and one sends
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
    """Return the selected ones of these names, in their order.

    `only` and `without`: kinds or names; an empty `only` selects all. `share` "I/N": of them every
    N-th from the I-th, from 0. Raises ValueError for an unknown kind or name, or a wrong share.
    """
    names = list(names)
    for word in [*only, *without]:
        if not any(_is_meant(name, [word]) for name in names):
            kinds = ", ".join(sorted({kind_of(name) for name in names}))
            raise ValueError(f"{word}: no such agent or kind; there are {kinds}")
    first, _, of = share.partition("/")
    if not (first.isdecimal() and of.isdecimal() and int(first) < int(of)):
        raise ValueError(f"share {share}: must be I/N, with I from 0 to N - 1")
    selected = []
    for name in names:
        is_selected = not only or _is_meant(name, only)
        if is_selected and not _is_meant(name, without):
            selected.append(name)
    return selected[int(first) :: int(of)]


def _is_meant(name: str, words: list[str]) -> bool:
    """Whether a name, or its kind, is one of some words."""
    return name in words or kind_of(name) in words
