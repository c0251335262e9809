"""The start poses of people, animals and weeds: the given place if it is free, else the nearest free place. Metres.

A place is free if the circle around the body's box is clear of all obstacles, so the body fits at any yaw. Poses are hashed.
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

CLEAR = 0.3  # m between a placed body and an obstacle
AHEAD_OF_PICKER = 1.5  # m ahead of its front edge are kept free
TRACK = Rect(
    -48.0, 26.0, -22.0, 32.0
)  # contains the area that the tractor sweeps, also while it turns
GRID = 0.25  # m: the grid step of the search for the nearest free place
KEPT_GROUNDS = 4  # of orchards that differ by more than the seed
TRIES = 20  # random places to try; if none is free, the free place nearest to the first of them is taken

# docs/reference.md, "The things in it"; all further bodies get random places
GIVEN = {
    "worker": ((-20.0, 22.0), (25.0, 25.0), (36.0, 18.0), (-44.0, -15.0)),
    "visitor": ((-47.0, 8.0), (-6.0, 22.0), (44.0, 6.0)),
    "dog": ((20.0, -11.0), (20.0, 15.0)),
    "cat": ((-47.0, -11.0),),
    "weed": (),
}

Obstacle = tuple[
    float, float, float, float, float
]  # m: x, y, half length along x, half width along y, clearance


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
    walls: np.ndarray,
    inside: Rect,
    rows: Rect,
    keep_off: Rect,
) -> list[Start]:
    """Return the starts of all people, animals and weeds, each clear of all before it; the same seed gives the same starts.

    `machines`: the robots, which must face east or west. `walls`: (n, 4), m: x, y, half length along x, half width along y of each fixed
    obstacle. `inside`: the ground between the fences. `rows`: that between the first and the last tree line, where no person is placed.
    `keep_off`: no person or animal is placed there. Raises ValueError if no free place is left.
    """
    boxes = [(machine.pose, KINDS[machine.kind]) for machine in machines]
    solid = [(*wall, CLEAR) for wall in walls.tolist()] + [
        (at.x, at.y, kind.length / 2, kind.width / 2, CLEAR) for at, kind in boxes
    ]
    areas = [_area(rect) for rect in (keep_off, TRACK, *_ways(machines))]
    grounds = {
        kind: copy(ground)
        for kind, ground in _bare_grounds(tuple(solid), tuple(areas), inside, rows).items()
    }
    solid_grounds = [ground for kind, ground in grounds.items() if kind in PEOPLE + ANIMALS]
    crowd = [
        _place(scenario.seed, kind, number, grounds[kind], solid_grounds)
        for kind, number in _in_order(scenario)
    ]
    beds = (
        grounds["weed north"],
        grounds["weed south"],
    )  # odd numbers above the rows, even numbers below
    return crowd + [
        _place(scenario.seed, "weed", i + 1, beds[i % 2], [beds[i % 2]])
        for i in range(scenario.weeds)
    ]


@lru_cache(maxsize=KEPT_GROUNDS)
def _bare_grounds(
    solid: tuple[Obstacle, ...], areas: tuple[Obstacle, ...], inside: Rect, rows: Rect
) -> Mapping[str, "_Ground"]:
    """The grounds of all kinds before anything is placed. They are kept: only what is placed on them depends on the seed."""
    grounds = {kind: _Ground(inside, kind, [*solid, *areas]) for kind in ANIMALS}
    grounds |= {kind: _Ground(inside, kind, [*solid, *areas, _area(rows)]) for kind in PEOPLE}
    # weeds are not solid, and people and animals may stand on them
    north, south = (
        Rect(inside.west, rows.north, inside.east, inside.north),
        Rect(inside.west, inside.south, inside.east, rows.south),
    )
    return grounds | {
        "weed north": _Ground(north, "weed", solid),
        "weed south": _Ground(south, "weed", solid),
    }


class _Ground:
    """Where a kind may be placed. Places are nearly always found without the grid, so it is made when it is first needed."""

    def __init__(self, within: Rect, kind: str, obstacles: Sequence[Obstacle]) -> None:
        self.within, self.radius = within, KINDS[kind].radius
        self.xs, self.ys = _steps(within.west, within.east), _steps(within.south, within.north)
        self.obstacles = np.array(obstacles)
        self._grid = cache(partial(self._closed, obstacles))  # one for all copies
        self._taken: list[Obstacle] = []  # what is not in the grid yet

    def take(self, obstacle: Obstacle) -> None:
        self.obstacles = np.vstack([self.obstacles, obstacle])
        self._taken = [*self._taken, obstacle]

    def _closed(
        self, obstacles: Iterable[Obstacle], before: np.ndarray | None = None
    ) -> np.ndarray:
        """Return which grid points are free, (ys, xs) bool: of all, or of those that were `before`."""
        points = (
            np.ones((len(self.ys), len(self.xs)), dtype=bool) if before is None else before.copy()
        )
        for x, y, half_x, half_y, gap in obstacles:
            reach = gap + self.radius
            columns = slice(*np.searchsorted(self.xs, (x - half_x - reach, x + half_x + reach)))
            rows = slice(*np.searchsorted(self.ys, (y - half_y - reach, y + half_y + reach)))
            beside = (
                np.abs(self.xs[columns] - x)[None, :] - half_x,
                np.abs(self.ys[rows] - y)[:, None] - half_y,
            )
            points[rows, columns] &= _squared(*beside) >= reach * reach
        return points

    def free(self, x: float, y: float) -> bool:
        ox, oy, half_x, half_y, gap = self.obstacles.T
        is_clear = _squared(np.abs(ox - x) - half_x, np.abs(oy - y) - half_y) >= (
            gap + self.radius
        ) * (gap + self.radius)
        return self.within.contains(x, y) and bool(is_clear.all())

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """The nearest free grid point; of equally near ones the southernmost, then the westernmost."""
        points = self._closed(self._taken, self._grid())
        self._grid, self._taken = cache(lambda: points), []
        distance = np.where(
            points, _squared(np.abs(self.xs - x)[None, :], np.abs(self.ys - y)[:, None]), np.inf
        )
        row, column = divmod(int(np.argmin(distance)), len(self.xs))
        if not points[row, column]:
            raise ValueError("the orchard is full: no free place is left")
        return float(self.xs[column]), float(self.ys[row])


def _place(seed: int, kind: str, number: int, ground: _Ground, shared: Iterable[_Ground]) -> Start:
    name = name_of(kind, number)
    places = GIVEN[kind][number - 1 : number] or _random_places(ground.within, seed, name)
    x, y = next((place for place in places if ground.free(*place)), None) or ground.nearest(
        *places[0]
    )
    for each in shared:
        each.take((x, y, 0.0, 0.0, KINDS[kind].radius + CLEAR))
    return Start(name, kind, Pose(x, y, _yaw(seed, name, kind)))


def _random_places(area: Rect, seed: int, name: str) -> tuple[tuple[float, float], ...]:
    width, height = area.east - area.west, area.north - area.south
    chances = [draw(seed, f"place of {name}", number, 2) for number in range(TRIES)]
    return tuple(
        (round(area.west + u * width, 2), round(area.south + v * height, 2)) for u, v in chances
    )


def _yaw(seed: int, name: str, kind: str) -> float:
    """People face along one of the four headings, animals anywhere, weeds east."""
    (u,) = draw(seed, f"yaw of {name}", 0)
    if kind in PEOPLE:
        return tuple(HEADINGS.values())[int(4.0 * u)]
    return wrap(TURN * u) if kind in ANIMALS else EAST


def _in_order(scenario: Scenario) -> list[tuple[str, int]]:
    people, animals = scenario.people, scenario.animals
    counts = {
        "worker": people.workers,
        "visitor": people.visitors,
        "dog": animals.dogs,
        "cat": animals.cats,
    }
    guests = [(kind, number) for kind, count in counts.items() for number in range(1, count + 1)]
    return sorted(guests, key=lambda guest: guest[1] > len(GIVEN[guest[0]]))


def _ways(machines: list[Start]) -> list[Rect]:
    half_length, half_width = KINDS["picker"].length / 2, KINDS["picker"].width / 2
    pickers = [machine.pose for machine in machines if machine.kind == "picker"]
    wests = [
        (x + half_length if yaw == EAST else x - half_length - AHEAD_OF_PICKER, y)
        for x, y, yaw in pickers
    ]
    return [Rect(x, y - half_width, x + AHEAD_OF_PICKER, y + half_width) for x, y in wests]


def _area(rect: Rect) -> Obstacle:
    return (
        (rect.west + rect.east) / 2,
        (rect.south + rect.north) / 2,
        (rect.east - rect.west) / 2,
        (rect.north - rect.south) / 2,
        0.0,
    )


def _steps(first: float, last: float) -> np.ndarray:
    return first + GRID * np.arange(int((last - first) / GRID) + 1)


def _squared(beside: np.ndarray, along: np.ndarray) -> np.ndarray:
    beside, along = np.maximum(beside, 0.0), np.maximum(along, 0.0)
    squared: np.ndarray = beside * beside + along * along
    return squared
