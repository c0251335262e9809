"""What holds robots up on their way, in the files of the benchmark: failures, people and animals,
and batteries. Each rule says what another program must do with the numbers.
"""

from collections.abc import Iterator

import msgspec

from orchard.event_model.bystanders import Bystanders
from orchard.event_model.draws import has_failures
from orchard.field.layout import Layout
from orchard.field.picking import failure
from orchard.field.queue import PITCH
from orchard.field.scenario import TIME_STEP
from orchard.plans.failures import CLEAR_OF_TURNS
from orchard.plans.jobs import ticks
from orchard.plans.motions import Motion
from orchard.plans.robot import ASK

MOTION_RULES = [
    "A drive is the tick at which it begins, its ticks, its metres, and whether the robot may fail"
    " on it. A turn is the tick at which it begins, its ticks, and whether a bin is on the bar.",
    "exits[line] has the drives and turns of a carrier, from the head of that line to a head"
    " again. The ticks of picker_drives and picker_turns count from when the picker went on, or"
    " from 0, with rows that take their mean times.",
    "A robot that stands on its way does all that comes after it later by as much. Carriers do not"
    " overtake: a carrier comes to the next of its places after those that had the place before.",
]
FAILURE_RULES = [
    "A robot works while it drives, where it may fail. It stands where it is once it has worked"
    " for the seconds of its next failure. It keeps the places that it left up to `keeps` ticks"
    " before.",
]
PEOPLE_RULES = [
    "`meetings` are those with people and animals: how many metres a robot drives since the last"
    " one, and for how many ticks it stands then.",
    "Before each turn a robot stands for `look` ticks. `looks` has the turns of a robot before"
    " which it may be more: the turn's number, from 0, the ticks without a bin on the bar, and"
    " those with one.",
]
BATTERY_RULES = [
    "A battery is full at first, and lasts for `battery` ticks of drives and turns. A carrier that"
    " stands uses the share `standing` of that, and nothing in the queue. At first each carrier"
    " drives up for `place` ticks for each one before it in its line.",
    "A carrier with at most the share `reserve` when its bin is empty goes to charge. The second"
    " half of the exits are those of the charging lines, in the order of the lines. A carrier can"
    " be there to_charge ticks after it came to the bay, and goes on its next job from there.",
    "A charger that is free goes to the carrier that is nearest to a head of those that wait,"
    " until its battery is full. A flat one needs `charging` ticks. Then the carrier can be sent"
    " again.",
]
# How many failures and meetings of each robot a file lists, and of how many turns the looks. No
# harvest of the set needs more.
FAILURES = 24
MEETINGS = 32
LOOKS = 400


class TimedDrive(msgspec.Struct, array_like=True, frozen=True):
    """A drive of a robot, in ticks."""

    at: int
    ticks: int
    metres: float
    may_fail: bool


class TimedTurn(msgspec.Struct, array_like=True, frozen=True):
    """A turn of a robot on the spot, in ticks."""

    at: int
    ticks: int
    is_towing: bool


def may_be_held_up(layout: Layout) -> bool:
    """Whether anything may hold a robot up on its way, or a carrier must charge."""
    scenario = layout.scenario
    return has_failures(scenario) or scenario.has_batteries or Bystanders.of(layout).density > 0.0


def rules_of(layout: Layout) -> list[str]:
    """Return the rules of what may hold robots up in an orchard."""
    if not may_be_held_up(layout):
        return []
    rules = [*MOTION_RULES]
    if has_failures(layout.scenario):
        rules += FAILURE_RULES
    if Bystanders.of(layout).density:
        rules += PEOPLE_RULES
    if layout.scenario.has_batteries:
        rules += BATTERY_RULES
    return rules


def constants_of(layout: Layout) -> dict[str, float]:
    """Return the constants in these rules: ticks, shares of a battery, and a number of chargers."""
    constants: dict[str, float] = {}
    scenario = layout.scenario
    if has_failures(scenario):
        constants["keeps"] = ticks(CLEAR_OF_TURNS / layout.machines["carrier"].speed)
    if Bystanders.of(layout).density:
        constants["look"] = ASK
    battery = scenario.carrying.battery
    if battery.hours is not None:
        constants["battery"] = ticks(3600.0 * battery.hours)
        constants["place"] = ticks(PITCH / layout.machines["carrier"].speed)
        constants["charging"] = ticks(3600.0 * battery.hours_to_charge)
        constants["chargers"] = scenario.chargers
        constants["reserve"] = battery.reserve
        constants["standing"] = battery.standing
    return constants


def timed_drives(motion: Motion) -> list[TimedDrive]:
    """Return the drives of a robot as a file has them."""
    drives = []
    for drive in motion.drives:
        begins = round(drive.at / TIME_STEP)
        lasts = round(drive.seconds / TIME_STEP)
        drives.append(TimedDrive(begins, lasts, round(drive.metres, 3), drive.may_fail))
    return drives


def timed_turns(motion: Motion) -> list[TimedTurn]:
    """Return the turns of a robot as a file has them."""
    turns = []
    for turn in motion.turns:
        begins = round(turn.at / TIME_STEP)
        turns.append(TimedTurn(begins, round(turn.seconds / TIME_STEP), turn.is_towing))
    return turns


def failures_of(layout: Layout) -> dict[str, list[tuple[float, float]]]:
    """Return the failures that the seed of a layout draws: robot -> work before, and repair, s."""
    rules = {
        "picker": layout.scenario.picking.failure,
        "carrier": layout.scenario.carrying.failure,
    }
    failures = {}
    for name, kind in _robots(layout):
        rule = rules[kind]
        if rule.mean_between is None:
            continue
        of_robot = []
        for number in range(FAILURES):
            work, repair = failure(
                layout.scenario.seed, name, number, rule.mean_between, rule.mean_repair
            )
            of_robot.append((round(work, 2), round(repair, 2)))
        failures[name] = of_robot
    return failures


def meetings_of(layout: Layout) -> dict[str, list[tuple[float, int]]]:
    """Return the meetings that the seed of a layout draws: robot -> metres before, and ticks."""
    bystanders = Bystanders.of(layout)
    meetings: dict[str, list[tuple[float, int]]] = {}
    if bystanders.density:
        for name, _ in _robots(layout):
            of_robot = []
            for number in range(MEETINGS):
                metres = round(bystanders.metres_to(name, number), 3)
                of_robot.append((metres, bystanders.meeting_ticks(name, number)))
            meetings[name] = of_robot
    return meetings


def looks_of(layout: Layout) -> dict[str, list[tuple[int, int, int]]]:
    """Return before which turns a robot may stand for longer than ASK ticks, as the seed draws it.

    Robot -> the number of each turn, its ticks without a bin, and those with one.
    """
    bystanders = Bystanders.of(layout)
    looks: dict[str, list[tuple[int, int, int]]] = {}
    if bystanders.density:
        for name, _ in _robots(layout):
            of_robot = []
            # Turns count from 1 in the draws.
            drawn = bystanders.turning_ticks(name, 1, LOOKS + 1)
            for number, (alone, towing) in enumerate(drawn):
                if max(alone, towing) > ASK:
                    of_robot.append((number, alone, towing))
            looks[name] = of_robot
    return looks


def _robots(layout: Layout) -> Iterator[tuple[str, str]]:
    """Yield the name and the kind of each picker and carrier."""
    for start in layout.starts:
        if start.kind in ("picker", "carrier"):
            yield start.name, start.kind
