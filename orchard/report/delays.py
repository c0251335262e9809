"""How long robots wait in the long run because others are where they want to go. docs/bounds.md explains it."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.agents.steps import DriveTo, Face, FetchEmpty, Free, Need
from orchard.agents.timing import head, timetable
from orchard.field.geometry import HEADINGS, Pose

PICKER, WORKS, PASSES = range(3)  # what is in a place: a picker, a carrier that turns there, one that only drives through
OUT, HOME, CROSSING = range(3)  # where a wait delays the harvest: the carrier before it delivers, the carrier after that, the picker


class Stay(NamedTuple):
    """A robot's stay in a place, without traffic. Times from the beginning of its plan, s."""

    place: str
    begins: float  #: when it must have the place
    seconds: float
    kind: int  #: `PICKER`, `WORKS` or `PASSES`


class Trip(NamedTuple):
    """The stays of a carrier and of a picker at one exchange."""

    row: int
    delivered: float  #: when the carrier has delivered the empty bin, s
    carrier: list[Stay]
    picker: list[Stay]

    def parts(self) -> Iterator[tuple[int, Stay]]:
        """All stays, each with what a wait for it delays."""
        yield from ((HOME if stay.begins >= self.delivered else OUT, stay) for stay in self.carrier)
        yield from ((CROSSING, stay) for stay in self.picker)


def trip(route: OneWay, row: int, next_row: int, side: Side, delivered: float, bay: float) -> Trip:
    """Return the stays at the exchange of a row. The bay is a place too, which a carrier takes for `bay` seconds."""
    fetch, way = route.fetch(1, row, side, "", ""), route.crossing(row, next_row, side)
    x = side.sign * min(side.sign * route.end(row, side), side.sign * route.hold(row, side))  # before the picker crosses the roads
    start = Pose(x, route.layout.lane(row).y, HEADINGS[side.heading("EAST")])
    carrier = [*stays(fetch, head(route)), Stay("bay", delivered, bay, WORKS)]
    return Trip(row, delivered, carrier, [stay._replace(kind=PICKER) for stay in stays(way, start)])


def stays(steps: list[Step], start: Pose) -> list[Stay]:
    """Return the stays of a robot that does these steps without a stop. It waits for a place no earlier than where it must have it."""
    since: dict[str, float] = {}
    turns, found = list[float](), list[Stay]()
    for step, pose, begins, ends in timetable(steps, start):
        turns += [begins] if isinstance(step, Face) and ends > begins else []
        for time, is_taken, place in sorted(_changes(step, pose, begins)):
            if is_taken:
                since.setdefault(place, time)
            elif place in since:
                taken = since.pop(place)
                found.append(Stay(place, taken, time - taken, WORKS if any(taken <= turn < time for turn in turns) else PASSES))
    return found


def _changes(step: Step, pose: Pose, begins: float) -> Iterator[tuple[float, bool, str]]:
    """The times at which a step takes places (True) and gives them back (False)."""
    if isinstance(step, DriveTo):
        here, target = (pose.x, step.x) if step.x is not None else (pose.y, step.y or 0.0)
        for is_taken, gates in ((False, step.frees), (True, step.needs)):
            ways = [((gate.at - here) * (1.0 if target >= here else -1.0), gate.places) for gate in gates]
            yield from (
                (begins + max(0.0, way) / step.speed, is_taken, p) for way, places in ways if way <= abs(target - here) for p in places
            )
    elif isinstance(step, Need | Free):
        yield from ((begins, isinstance(step, Need), place) for place in step.places)
    elif isinstance(step, FetchEmpty):
        yield begins, True, step.place


class TrafficDelays:
    """The mean waits at each of some exchanges, which follow each other at random, as a function of the rate of the harvest."""

    def __init__(self, trips: Sequence[Trip], shares: Sequence[float], carriers: int) -> None:
        """`shares`: of each of these exchanges in all; their sum is 1."""
        rows = [(i, one.row, part, stay) for i, one in enumerate(trips) for part, stay in one.parts()]
        trip, row, part, kind = (
            np.array(column) for column in zip(*((i, row, part, stay.kind) for i, row, part, stay in rows), strict=True)
        )
        place = np.unique([stay.place for *_, stay in rows], return_inverse=True)[1]
        seconds = np.array([stay.seconds for *_, stay in rows])
        moments = np.zeros((2, place.max() + 1, row.max() + 1, 3))  # means of the seconds of a bin in each place, and of their squares
        for power in (0, 1):
            np.add.at(moments[power], (place, row, kind), seconds ** (power + 1) * np.array(shares)[trip])
        others = moments.sum(axis=2)[:, place] - moments[:, place, row]  # a robot does not wait for those of its own exchange
        met = 1.0 - 1.0 / carriers  # the share of the carriers that one of them can meet
        waits_for = np.array([[0.0, 1.0, 1.0], [1.0, met, met], [1.0, met, 0.0]])  # carriers that pass follow each other, and do not wait
        self._busy, self._squares = (others * waits_for[kind]).sum(axis=2)
        self._trips, self._part = len(trips), 3 * trip + part

    def at(self, rate: float) -> np.ndarray:
        """Return the mean waits, s, at a rate, bins/s: (exchanges, 3), of the parts `OUT`, `HOME` and `CROSSING`."""
        waits = rate * self._squares / 2.0 / np.maximum(1.0 - rate * self._busy, 1e-9)
        return np.bincount(self._part, waits, 3 * self._trips).reshape(-1, 3)
