"""The instances of the benchmark: files that a program can read without this one.

An instance is an orchard with its splits, its jobs as the robots' plans have them, and for each
seed what is drawn, what is proven, and the best schedule that is known. docs/benchmark.md explains
each field.
"""

from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Any, Literal

import msgspec
from msgspec.structs import replace

from orchard.dispatch.rollout import HEADWAY, ORDERED
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import TIME_STEP, Scenario, check, with_changes
from orchard.plans.jobs import TimedJob, Use, jobs_of, ticks
from orchard.plans.motions import JobMotions, motions_of
from orchard.study.benchmark import holdups
from orchard.study.benchmark.holdups import TimedDrive, TimedTurn
from orchard.study.benchmark.play import GivenOrders

SET = "1.0"
UNITS = {
    "time": f"ticks of {TIME_STEP:g} s, unless a name ends in _seconds",
    "at": "ticks from the carrier's stop at the lane on; below 0 before it",
    "distance": "m, x east and y north",
}
RULES = [
    "A picker does its jobs in their order. It begins the first one at 0, and the next one going_on"
    " ticks after the carrier's stop.",
    "Ready ticks after a picker has begun a job, a carrier can stop at its lane, if the picker got"
    " its places at once.",
    "A carrier leaves the head of its line some `ordered` ticks after its order. It stops at the"
    " job's lane exits[line].approach ticks later, if it waits nowhere.",
    "A carrier gets the job's place only once the picker is out of the row: a tick after the picker"
    " has the last of its places in `crossings`.",
    "A use is a place, the tick at which its robot comes there, and the ticks for which it has the"
    " place. One robot has a place at a time; others wait in their order.",
    "A carrier is in the bay to_bay ticks after its stop, for in_bay ticks, and one at a time."
    " The next one is there `headway` ticks later. to_head ticks after it came to the bay a carrier"
    " is at the head of its line.",
    "The harvest ends when the last carrier stands in the queue, to_rest ticks after the bay.",
    "Of a row the seed draws the picking time; ready of a seed has it.",
    "A robot fails after it has worked for so long since its last repair, and then stands.",
]
TRAILER_RULES = [
    "There are `trailers` at the bay. A carrier in the bay waits until one stands there; only then"
    " its in_bay begins, at whose end its bin is on the trailer that has most bins.",
    "A trailer with `trailer_bins` bins, or with the last bin of the harvest, is away for"
    " `trailer_away` ticks. The harvest ends when the last trailer is back, if that is later.",
]
Split = Literal["train", "test", "hidden"]


class TimedUse(msgspec.Struct, array_like=True, frozen=True):
    """A place that a robot has alone: from which tick (see UNITS), and for how many ticks."""

    place: str
    at: int
    ticks: int


class LineExit(msgspec.Struct, frozen=True, omit_defaults=True):
    """How a carrier comes from a line of the queue."""

    approach: int
    uses: list[TimedUse]
    #: From the line's head to a head again, where a robot may be held up.
    drives: list[TimedDrive] = []
    turns: list[TimedTurn] = []
    #: Of a line in which carriers charge: from the bay until the carrier is at its head.
    to_charge: int = 0


class InstanceJob(msgspec.Struct, frozen=True, omit_defaults=True):
    """An exchange of bins, in ticks: see `RULES`, and `orchard.plans.jobs.TimedJob`."""

    picker: str
    row: int
    side: str
    #: The place of the roads at which the carrier stops.
    place: str
    ready: int
    going_on: int
    crossings: list[TimedUse]
    exits: list[LineExit]
    way: list[TimedUse]
    to_bay: int
    in_bay: int
    to_head: int
    to_rest: int
    #: In ticks since the picker went on, where a robot may be held up.
    picker_drives: list[TimedDrive] = []
    picker_turns: list[TimedTurn] = []


class InstanceRow(msgspec.Struct, frozen=True):
    """A row of trees: lengths in m, y of its middle, x of its west end."""

    number: int
    y: float
    west: float
    length: float
    mean_picking_seconds: float


class RecordedOrder(msgspec.Struct, array_like=True, frozen=True):
    """An order: at a tick a carrier is sent to a bin, which is that of a picker."""

    tick: int
    bin: str
    carrier: str
    picker: str


class KnownSchedule(msgspec.Struct, frozen=True):
    """The best schedule that is known."""

    seconds: float
    found_by: str
    #: Whether bins report before they are full.
    is_early: bool
    orders: list[RecordedOrder]


class InstanceDraw(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a seed draws."""

    seed: int
    #: Of each row, in the order of `rows`.
    picking_seconds: list[float]
    #: Of each job, in the order of `jobs`, ticks.
    ready: list[int]
    #: Robot -> its failures in their order: for how long it works before, and then stands, s.
    failures: dict[str, list[tuple[float, float]]]
    #: Robot -> its meetings with people and animals: metres before, and ticks for which it stands.
    meetings: dict[str, list[tuple[float, int]]] = {}
    #: Robot -> the turns before which it may stand for long: number, ticks alone, and with a bin.
    looks: dict[str, list[tuple[int, int, int]]] = {}
    proven_seconds: float
    best: KnownSchedule | None = None


class Instance(msgspec.Struct, frozen=True):
    """An orchard of the benchmark."""

    name: str
    split: Split
    set: str
    scenario: dict[str, Any]
    units: dict[str, str]
    rules: list[str]
    #: Times in ticks, shares, and numbers of trailers, of their bins and of chargers.
    constants: dict[str, int | float]
    rows: list[InstanceRow]
    #: Picker -> its rows, in their order.
    pickers: dict[str, list[int]]
    #: Carrier -> its line of the queue, from 0.
    carriers: dict[str, int]
    jobs: list[InstanceJob]
    draws: list[InstanceDraw]

    @property
    def whole_scenario(self) -> Scenario:
        """The scenario, with the first seed."""
        return check(self.scenario, self.name)

    def of_seed(self, seed: int) -> Scenario:
        """Return the scenario with another seed."""
        return with_changes(self.whole_scenario, seed=seed)


def instances() -> dict[str, Instance]:
    """Return all public instances by name, in their order."""
    folder = files("orchard.study.benchmark").joinpath(SET)
    known = dict[str, Instance]()
    for file in sorted(folder.iterdir(), key=lambda file: file.name):
        if file.name.endswith(".json"):
            instance = msgspec.json.decode(file.read_bytes(), type=Instance)
            known[instance.name] = instance
    return known


def instance_of(
    name: str, split: Split, values: dict[str, Any], proven: dict[int, float]
) -> Instance:
    """Return an instance without schedules.

    `values`: of its scenario. `proven`: seed -> the time below which no harvest can be, s.
    """
    layout = lay_out(check(values, name))
    at_mean_speeds = lay_out(_at_mean_speeds(layout.scenario))
    jobs = _jobs(jobs_of(at_mean_speeds))
    if holdups.may_be_held_up(layout):
        waiting_lines = len(layout.queue.used(layout.first_charging or layout.queue_places))
        jobs = _with_motions(jobs, motions_of(at_mean_speeds), waiting_lines)
    places = layout.queue.places
    rules = [*RULES]
    constants: dict[str, int | float] = {"ordered": ORDERED}
    if layout.scenario.load_out.has_trailers:
        rules += TRAILER_RULES
        constants |= _trailers(layout)
    rules += holdups.rules_of(layout)
    headway = ticks(HEADWAY / layout.machines["carrier"].speed)
    carriers = [start.name for start in layout.starts if start.kind == "carrier"]
    rows = []
    for lane in layout.lanes:
        seconds = round(lane.length / layout.scenario.mean_picking_speed, 3)
        rows.append(InstanceRow(lane.number, round(lane.y, 3), lane.west, lane.length, seconds))
    return Instance(
        name=name,
        split=split,
        set=SET,
        scenario=values,
        units=UNITS,
        rules=rules,
        constants=constants | {"headway": headway} | holdups.constants_of(layout),
        rows=rows,
        pickers={picker: list(block.rows) for picker, block in layout.blocks.items()},
        carriers={carrier: number // places for number, carrier in enumerate(carriers)},
        jobs=jobs,
        draws=[_draw(layout, seed, seconds) for seed, seconds in proven.items()],
    )


def _trailers(layout: Layout) -> dict[str, int]:
    """Return how many trailers there are, what each holds, and for how many ticks it is away."""
    trailers = layout.scenario.load_out.trailers
    return {
        "trailers": trailers.count or 0,
        "trailer_bins": trailers.bins or 0,
        "trailer_away": layout.machines["carrier"].trailer_ticks,
    }


def _at_mean_speeds(scenario: Scenario) -> Scenario:
    """Return a scenario in which each row takes its mean time."""
    return scenario.model_copy(update={"picking": scenario.picking.in_mean_times})


def _jobs(jobs: Sequence[TimedJob]) -> list[InstanceJob]:
    """Return jobs as a file has them."""
    in_file = []
    for job in jobs:
        exits = [LineExit(approach, _uses(uses)) for approach, uses in job.exits]
        in_file.append(
            InstanceJob(
                picker=job.picker,
                row=job.lane,
                side=job.side,
                place=f"{job.side}/D/{job.lane}",
                ready=job.ready,
                going_on=job.going_on,
                crossings=_uses(job.crossings),
                exits=exits,
                way=_uses(job.way),
                to_bay=job.to_bay,
                in_bay=job.in_bay,
                to_head=job.to_head,
                to_rest=job.to_rest,
            )
        )
    return in_file


def _with_motions(
    jobs: Sequence[InstanceJob], motions: Sequence[JobMotions], charging: int
) -> list[InstanceJob]:
    """Return jobs of a file with the drives and turns of their robots.

    `charging`: the number of the first line in which carriers charge.
    """
    moved = []
    for job, motion in zip(jobs, motions, strict=True):
        exits = []
        for line, line_exit in enumerate(job.exits):
            carrier = motion.carriers[line]
            to_charge = 0
            if line >= charging:
                to_charge = ticks(motion.to_heads[line])
            exits.append(
                replace(
                    line_exit,
                    drives=holdups.timed_drives(carrier),
                    turns=holdups.timed_turns(carrier),
                    to_charge=to_charge,
                )
            )
        moved.append(
            replace(
                job,
                exits=exits,
                picker_drives=holdups.timed_drives(motion.picker),
                picker_turns=holdups.timed_turns(motion.picker),
            )
        )
    return moved


def _uses(uses: Iterable[Use]) -> list[TimedUse]:
    """Return uses of places as a file has them."""
    return [TimedUse(use.place, round(use.at / TIME_STEP), use.ticks) for use in uses]


def _draw(layout: Layout, seed: int, proven: float) -> InstanceDraw:
    """Return what a seed draws."""
    drawn = lay_out(with_changes(layout.scenario, seed=seed))
    ready = [job.ready for job in jobs_of(drawn)]
    seconds = [round(lane.length / lane.picking_speed, 3) for lane in drawn.lanes]
    return InstanceDraw(
        seed=seed,
        picking_seconds=seconds,
        ready=ready,
        failures=holdups.failures_of(drawn),
        meetings=holdups.meetings_of(drawn),
        looks=holdups.looks_of(drawn),
        proven_seconds=proven,
    )


def as_file(instance: Instance) -> bytes:
    """Return the content of an instance's file: the same instance gives the same bytes.

    It is JSON with a line for each job, row and seed, for people who read it.
    """
    lines = []
    for name in instance.__struct_fields__:
        value = getattr(instance, name)
        if isinstance(value, list) and value and not isinstance(value[0], str):
            parts = [msgspec.json.encode(part).decode() for part in value]
            text = "[\n  " + ",\n  ".join(parts) + "]"
        else:
            text = msgspec.json.encode(value).decode()
        lines.append(f'"{name}": {text}')
    return ("{" + ",\n ".join(lines) + "}\n").encode()


def recorded(decisions: Iterable[GivenOrders]) -> list[RecordedOrder]:
    """Return the orders of decisions, in their order."""
    orders = []
    for decision in decisions:
        for order in decision.orders:
            picker = decision.pickers[order.bin]
            orders.append(RecordedOrder(decision.tick, order.bin, order.carrier, picker))
    return orders
