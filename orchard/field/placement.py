"""The start poses of people, animals and weeds, for `orchard/field/layout.py`.

The first bodies of each kind have given places, further ones draw random places. A body starts at
such a place if that is free, else at the nearest free point of a grid. A place is free if the
circle around the body's box is clear of all obstacles, so the body fits at any yaw. Poses are a
part of the run's hash, so they are made without functions that differ between machines. All lengths
are in m.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache, lru_cache, partial

import numpy as np

from orchard.field.geometry import EAST, HEADINGS, Pose, Rect
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE, name_of
from orchard.field.repeatable import TURN, draw, wrap
from orchard.field.scenario import Scenario

# m between a placed body and an obstacle.
CLEAR = 0.3
# m that are kept free ahead of a picker's front edge.
AHEAD_OF_PICKER = 1.5
# The area that the tractor sweeps, also while it turns about at each end of its way
# (orchard/behaviour/tractor.py).
TRACK = Rect(-48.0, 26.0, -22.0, 32.0)
# m: the step of the grid on which the nearest free place is sought.
GRID = 0.25
# Orchards whose grounds are in the cache. Orchards that differ by the seed alone share them.
KEPT_GROUNDS = 4
# Random places to try for a body. If none is free, it gets the free place nearest to the first one.
TRIES = 20

# The places of the first bodies of each kind: docs/reference.md, "The things in it". All further
# ones get random places.
GIVEN = {
    "worker": ((-20.0, 22.0), (25.0, 25.0), (36.0, 18.0), (-44.0, -15.0)),
    "visitor": ((-47.0, 8.0), (-6.0, 22.0), (44.0, 6.0)),
    "dog": ((20.0, -11.0), (20.0, 15.0)),
    "cat": ((-47.0, -11.0),),
    "weed": (),
}

# A box, m: x, y, half length along x, half width along y, and how far a placed body must stay away
# from it.
Obstacle = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Start:
    """A body's name, kind and start pose, and the bin coupled to it ('': none)."""

    name: str
    kind: str
    pose: Pose
    bin: str = ""


def guests(
    scenario: Scenario,
    machines: list[Start],
    *,
    walls: np.ndarray,
    inside: Rect,
    rows: Rect,
    keep_off: Rect,
) -> list[Start]:
    """Return the starts of all people, animals and weeds, each clear of all before it.

    `machines`: the robots, which must face east or west. `walls`: (n, 4), m: x, y, half length
    along x, half width along y of each fixed obstacle. `inside`: the ground between the fences.
    `rows`: that between the first and the last tree line, where no person is placed. `keep_off`: no
    person or animal is placed there. The same seed gives the same starts. Raises ValueError if no
    free place is left.
    """
    bare_grounds = _bare_grounds(walls.tobytes(), tuple(machines), inside, rows, keep_off)
    # Copies, because what is placed is added to them, and the bare ones stay in the cache.
    grounds = {name: copy(ground) for name, ground in bare_grounds.items()}
    of_solid_bodies = [grounds[kind] for kind in ANIMALS + PEOPLE]
    starts = []
    for name, number in _in_order(scenario):
        starts.append(_place(scenario.seed, name, number, grounds[name], of_solid_bodies))
    # Weeds with odd numbers lie above the rows, those with even numbers below.
    beds = (grounds["weed north"], grounds["weed south"])
    for i in range(scenario.weeds):
        bed = beds[i % 2]
        starts.append(_place(scenario.seed, "weed", i + 1, bed, [bed]))
    return starts


@lru_cache(maxsize=KEPT_GROUNDS)
def _bare_grounds(
    walls: bytes, machines: tuple[Start, ...], inside: Rect, rows: Rect, keep_off: Rect
) -> Mapping[str, "_Ground"]:
    """Return the grounds of all kinds before anything is placed, as `guests` is told of them.

    They are kept: only what is placed on them depends on the seed. `walls` are the bytes of the
    array, because an array is no key.
    """
    solid: list[Obstacle] = []
    for x, y, half_x, half_y in np.frombuffer(walls).reshape(-1, 4).tolist():
        solid.append((x, y, half_x, half_y, CLEAR))
    for machine in machines:
        shape = KINDS[machine.kind]
        pose = machine.pose
        solid.append((pose.x, pose.y, shape.length / 2, shape.width / 2, CLEAR))
    areas = [_area(rect) for rect in (keep_off, TRACK, *_ways(machines))]
    north = Rect(inside.west, rows.north, inside.east, inside.north)
    south = Rect(inside.west, inside.south, inside.east, rows.south)
    grounds = {kind: _Ground(inside, kind, [*solid, *areas]) for kind in ANIMALS}
    for kind in PEOPLE:
        grounds[kind] = _Ground(inside, kind, [*solid, *areas, _area(rows)])
    # Weeds are not solid: people and animals may stand on them, and they may lie in all areas.
    grounds["weed north"] = _Ground(north, "weed", solid)
    grounds["weed south"] = _Ground(south, "weed", solid)
    return grounds


class _Ground:
    """Where bodies of a kind may be placed.

    Places are nearly always found without the grid, so it is made when it is first needed.
    """

    def __init__(self, within: Rect, kind: str, obstacles: Sequence[Obstacle]) -> None:
        self.within = within
        self.radius = KINDS[kind].radius
        # x of the columns and y of the rows of the grid.
        self.xs = _steps(within.west, within.east)
        self.ys = _steps(within.south, within.north)
        # (n, 5), the columns of `Obstacle`.
        self.obstacles = np.array(obstacles)
        # Returns which grid points are free. It is `cache`d: it works at its first call only, and
        # all copies of this ground share what it found.
        self._grid = cache(partial(self._free_points, obstacles))
        # The obstacles that are not in the grid yet.
        self._taken: list[Obstacle] = []

    def take(self, obstacle: Obstacle) -> None:
        """Add an obstacle to this ground, and to none of its copies: all arrays are new ones."""
        self.obstacles = np.vstack([self.obstacles, obstacle])
        self._taken = [*self._taken, obstacle]

    def _free_points(
        self, obstacles: Iterable[Obstacle], before: np.ndarray | None = None
    ) -> np.ndarray:
        """Return which grid points are free of some obstacles, (ys, xs) bool.

        `before`: the points that are free of all other obstacles; None: all points are.
        """
        if before is None:
            points = np.ones((len(self.ys), len(self.xs)), dtype=bool)
        else:
            points = before.copy()
        for x, y, half_x, half_y, gap in obstacles:
            reach = gap + self.radius
            # Only the columns and rows of the grid that the obstacle reaches.
            columns = slice(*np.searchsorted(self.xs, (x - half_x - reach, x + half_x + reach)))
            rows = slice(*np.searchsorted(self.ys, (y - half_y - reach, y + half_y + reach)))
            beyond_x = np.abs(self.xs[columns] - x)[None, :] - half_x
            beyond_y = np.abs(self.ys[rows] - y)[:, None] - half_y
            points[rows, columns] &= _squared(beyond_x, beyond_y) >= reach * reach
        return points

    def is_free(self, x: float, y: float) -> bool:
        """Whether a body of the kind may stand at a point, m."""
        all_x, all_y, half_x, half_y, gap = self.obstacles.T
        reach = gap + self.radius
        squared = _squared(np.abs(all_x - x) - half_x, np.abs(all_y - y) - half_y)
        is_clear = bool((squared >= reach * reach).all())
        return self.within.contains(x, y) and is_clear

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest free grid point, m.

        Of equally near ones it is the southernmost, then the westernmost. Raises ValueError if none
        is free.
        """
        points = self._free_points(self._taken, self._grid())
        # From now on the grid of this ground, not of its copies, has what was taken.
        self._grid = cache(lambda: points)
        self._taken = []
        squared = _squared(np.abs(self.xs - x)[None, :], np.abs(self.ys - y)[:, None])
        # argmin takes the first of equal ones: rows go from south to north, columns from west to
        # east. If no point is free it takes one that is not.
        distance = np.where(points, squared, np.inf)
        row, column = divmod(int(np.argmin(distance)), len(self.xs))
        if not points[row, column]:
            raise ValueError("the orchard is full: no free place is left")
        return float(self.xs[column]), float(self.ys[row])


def _place(seed: int, kind: str, number: int, ground: _Ground, shared: Iterable[_Ground]) -> Start:
    """Return the start of a body, and take its place on all grounds that are `shared`.

    `ground`: where the body may stand. `shared`: the grounds of all bodies that must stay off it.
    """
    name = name_of(kind, number)
    given = GIVEN[kind]
    if number <= len(given):
        places: Sequence[tuple[float, float]] = [given[number - 1]]
    else:
        places = _random_places(ground.within, seed, name)
    x, y = _first_free(places, ground)
    for shared_ground in shared:
        shared_ground.take((x, y, 0.0, 0.0, KINDS[kind].radius + CLEAR))
    return Start(name, kind, Pose(x, y, _yaw(seed, name, kind)))


def _first_free(places: Sequence[tuple[float, float]], ground: _Ground) -> tuple[float, float]:
    """Return the first of some places that is free, else the free grid point nearest to the first
    of them, m.
    """
    for x, y in places:
        if ground.is_free(x, y):
            return x, y
    return ground.nearest(*places[0])


def _random_places(area: Rect, seed: int, name: str) -> list[tuple[float, float]]:
    """Return TRIES random places in an area, m, in whole centimetres, for the body of a name."""
    width = area.east - area.west
    height = area.north - area.south
    places = []
    for number in range(TRIES):
        u, v = draw(seed, f"place of {name}", number, 2)
        places.append((round(area.west + u * width, 2), round(area.south + v * height, 2)))
    return places


def _yaw(seed: int, name: str, kind: str) -> float:
    """Return a yaw, rad: people face along a heading, animals anywhere, weeds east."""
    (u,) = draw(seed, f"yaw of {name}", 0)
    if kind in PEOPLE:
        return tuple(HEADINGS.values())[int(len(HEADINGS) * u)]
    if kind in ANIMALS:
        return wrap(TURN * u)
    return EAST


def _in_order(scenario: Scenario) -> list[tuple[str, int]]:
    """Return kind and number of all people and animals: first those that have given places."""
    counts = {
        "worker": scenario.people.workers,
        "visitor": scenario.people.visitors,
        "dog": scenario.animals.dogs,
        "cat": scenario.animals.cats,
    }
    bodies = []
    for kind, count in counts.items():
        for number in range(1, count + 1):
            bodies.append((kind, number))
    return sorted(bodies, key=_has_no_given_place)


def _has_no_given_place(body: tuple[str, int]) -> bool:
    """Whether a place is drawn for a person or an animal. `body`: kind and number.

    As a key of sorting it puts those with given places first, because False sorts before True.
    """
    kind, number = body
    return number > len(GIVEN[kind])


def _ways(machines: Sequence[Start]) -> list[Rect]:
    """Return the ground ahead of each picker that is kept free, so that it can start."""
    half_length = KINDS["picker"].length / 2
    half_width = KINDS["picker"].width / 2
    ways = []
    for machine in machines:
        if machine.kind != "picker":
            continue
        x, y, yaw = machine.pose
        if yaw == EAST:
            west = x + half_length
        else:
            west = x - half_length - AHEAD_OF_PICKER
        ways.append(Rect(west, y - half_width, west + AHEAD_OF_PICKER, y + half_width))
    return ways


def _area(rect: Rect) -> Obstacle:
    """Return a rectangle as an obstacle without clearance."""
    x = (rect.west + rect.east) / 2
    y = (rect.south + rect.north) / 2
    return x, y, (rect.east - rect.west) / 2, (rect.north - rect.south) / 2, 0.0


def _steps(first: float, last: float) -> np.ndarray:
    """Return the coordinates of a grid from `first` to at most `last`, GRID apart, (n,), m."""
    return first + GRID * np.arange(int((last - first) / GRID) + 1)


def _squared(beyond_x: np.ndarray, beyond_y: np.ndarray) -> np.ndarray:
    """Return the square of the distance from boxes, m2.

    `beyond_x`, `beyond_y`: how far points lie beyond the sides of the boxes along x and y, m;
    negative between two sides. Both shapes are broadcast.
    """
    outside_x = np.maximum(beyond_x, 0.0)
    outside_y = np.maximum(beyond_y, 0.0)
    squared: np.ndarray = outside_x * outside_x + outside_y * outside_y
    return squared
