"""An exchange of bins at the end of a row: how long each part of it takes without traffic. docs/bounds.md explains it.

All drives and turns take their time, and so do bins that are handled and answers that robots wait for. Times in seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from orchard.agents.robot import PATIENCE, Step
from orchard.agents.route import OneWay, Side
from orchard.agents.steps import Alone, Deliver, FetchEmpty, LeaveBin, Need, TakeBin, Unload
from orchard.agents.timing import approach_seconds, duration, head, timetable
from orchard.discrete.bystanders import ASK
from orchard.discrete.robots import COUPLE, UNCOUPLE
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import UNLOADING_SECONDS
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.report.delays import Stay, stays

HANDLING: dict[type[Step], int] = {  # ticks of steps that neither drive nor turn: bins that are handled, and answers
    Need: ASK,
    LeaveBin: UNCOUPLE,
    Deliver: UNCOUPLE + PATIENCE + ASK,
    TakeBin: COUPLE,
    Unload: PATIENCE + ASK,  # beside the unloading itself
}
HANDOVER = (UNCOUPLE + COUPLE + ASK) * TIME_STEP  # s from a carrier's stop until the picker has its bin and the bin's place


@dataclass(frozen=True)
class Exchange:
    """A row of a picker, and the exchange of bins at its end: the time that each part takes without traffic, s."""

    lane: int
    next_lane: int  #: of the row that the picker picks after it
    side: Side
    picking: float  #: to pick the row
    leaving: float  #: from the end of the row until the picker has left the full bin
    coming_out: float  #: from there until it stands where it gets an empty bin, and gives the lane's place back
    going_on: float  #: from there, with the empty bin, to the head of the next row; first the carrier must be out of its way
    approach: float  #: from a carrier's departure at the queue's head until it stands there with the empty bin
    from_hold: float  #: for a carrier that came early and holds before the lane's place, the same from its hold
    cycle: float  #: of the carrier's whole job, back to the queue's head

    def wait(self, early: bool, delay: float = 0.0) -> float:
        """Return the time from the full bin that is left until the picker has an empty one, if a carrier is free at once.

        `early`: the carrier leaves as soon as the picker is in the row, or later, so that it arrives when the picker has come out.
        `delay`: the time for which the carrier waits on its way for others.
        """
        way = self.approach + delay - (self.picking + self.leaving if early else 0.0)
        return max(way, self.coming_out + self.from_hold) + HANDOVER


def exchanges(route: OneWay, block: Block, rounds: int = 1) -> list[Exchange]:
    """Return the exchanges of a picker that picks its rows so many times."""
    rows = block.rows * rounds
    ends = [(row, after, route.side(i, block.start)) for i, (row, after) in enumerate(zip(rows, (*rows[1:], rows[0]), strict=True))]
    made = {end: _exchange(route, *end) for end in dict.fromkeys(ends)}
    return [made[end] for end in ends]


def _exchange(route: OneWay, row: int, next_row: int, side: Side) -> Exchange:
    layout, job = route.layout, route.fetch(1, row, side, "", "")
    start = Pose(route.end(row, side), layout.lane(row).y, HEADINGS[side.heading("EAST")])
    way = route.crossing(row, next_row, side)
    before, out = _until(LeaveBin, way), _until(FetchEmpty, way)
    leaving, come_out = duration(before, start) + handling([*before, LeaveBin()]), duration(out, start) - duration(before, start)
    approach, carrier = approach_seconds(route, row, side), stays(job, head(route))
    held = [stay.begins for stay in carrier if stay.place == side.place("D", row)]  # from where the carrier must have the lane's place
    going_on = duration(way, start) - duration(out, start) + handling(way[len(out) :]) + _own_carrier(carrier, approach, way, start)
    cycle = duration(job, head(route)) + handling(job) + UNLOADING_SECONDS
    from_hold = approach - held[0] if held else 0.0
    return Exchange(row, next_row, side, layout.picking_seconds(row), leaving, come_out, going_on, approach, from_hold, cycle)


def _until(kind: type[Step], steps: list[Step]) -> list[Step]:
    """Return the steps up to the first one of a kind."""
    return steps[: next(i for i, step in enumerate(steps) if isinstance(step, kind))]


def handling(steps: Sequence[Step]) -> float:
    """Return the time that steps take beside all drives and turns, s: for bins, and for answers."""
    return sum(HANDLING.get(type(step), 0) for step in steps) * TIME_STEP


def _own_carrier(carrier: list[Stay], approach: float, way: list[Step], start: Pose) -> float:
    """For how long a picker with its new bin waits on its way for the carrier that brought it, s. `carrier`: the carrier's stays.

    They leave out the time for bins and answers. So by them the picker has its bin at `brought`.
    """
    handed, brought = duration(_until(FetchEmpty, way), start), approach + HANDOVER - handling([Deliver(""), Need([])])
    waits = [0.0]
    for step, _, begins, _ in timetable(way, start):
        places = step.places if isinstance(step, Need) else [step.place] if isinstance(step, Alone) else []
        wanted = brought + begins - handed
        waits += [stay.begins + stay.seconds - wanted for stay in carrier if stay.place in places and stay.begins < wanted]
    return max(waits)
