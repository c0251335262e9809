"""The event model as data beside the one of generators.

The model of generators lacks three rules of the simulator, which are mended here before it is
compared: carriers ask a bin only now and then whether it is left; a bin is delivered when it is
empty, not when its carrier hears of it; and a carrier that is called on its way to the head stands,
so that the one behind it stands too.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from math import floor, inf
from typing import Any

import pytest
import simpy

from orchard.discrete.generators import GeneratorHarvest
from orchard.discrete.places import at, first_of
from orchard.discrete.robots import NEAR, Robot
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.results import Exchange
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.robot import ASK, LOOK_AGAIN, Gate, Step
from orchard.plans.steps import DriveTo, Unload

# s from when a bin is empty to when its carrier hears it.
UNHEARD = (Unload.ticks - Unload.until_empty) * TIME_STEP


def differences(layout: Layout, free_roads: bool = False) -> list[str]:
    """Do a harvest in both models, and return in what they differ: each tick counts."""
    told = EventHarvest(layout, free_roads=free_roads).run()
    with mended():
        expected = GeneratorHarvest(layout, free_roads=free_roads).run()
    exchanges = {}
    for picker, those in expected.exchanges.items():
        exchanges[picker] = [pytest.approx(vars(exchange)) for exchange in those]
    pairs = {
        "deliveries": (told.deliveries, pytest.approx(deliveries_of(expected))),
        "exchanges": (_data(told.exchanges), exchanges),
        "stood": (told.stood, pytest.approx(expected.stood)),
        "flat": (told.flat, expected.flat),
        "length": (told.seconds, pytest.approx(expected.seconds)),
        "waiting": (
            told.picker_waiting_seconds(),
            pytest.approx(expected.picker_waiting_seconds()),
        ),
        "utilisation": (told.carrier_utilisation(), pytest.approx(expected.carrier_utilisation())),
    }
    return [name for name, (figure, other) in pairs.items() if figure != other]


def _data(exchanges: dict[str, list[Exchange]]) -> dict[str, list[dict[str, Any]]]:
    return {picker: [vars(one) for one in those] for picker, those in exchanges.items()}


def deliveries_of(harvest: GeneratorHarvest) -> list[float]:
    """Return when each bin of the model of generators was empty, s."""
    return [seconds - UNHEARD for seconds in harvest.deliveries]


@contextmanager
def mended() -> Iterator[None]:
    """Let the model of generators keep these rules."""
    leave = GeneratorHarvest.leave
    take = Robot.take
    extend = Robot._extend
    pause_of = Robot._pause

    def leave_and_note(harvest: Any, picker: Robot) -> None:
        leave(harvest, picker)
        vars(harvest).setdefault("left_at", {})[picker.full_bin] = picker.tick

    def take_and_stand(robot: Any, plan: list[Step]) -> None:
        here = robot.x_now
        if robot.is_on_the_way and robot.end > here + NEAR:
            _stop_short(robot, here)
        take(robot, plan)

    def extend_or_stop_short(robot: Any, end: float) -> None:
        if end < robot.end - NEAR:
            _stop_short(robot, end)
        extend(robot, end)

    def pause_and_note(robot: Any, *values: Any, **options: Any) -> simpy.Event:
        pause = first_of(robot.env, [pause_of(robot, *values, **options)])
        robot.pause = pause
        return pause

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Robot, "take", take_and_stand)
        patch.setattr(Robot, "_extend", extend_or_stop_short)
        patch.setattr(Robot, "_pause", pause_and_note)
        patch.setattr(GeneratorHarvest, "leave", leave_and_note)
        patch.setattr(Robot, "_next_gate", _next_gate)
        yield


def _stop_short(robot: Any, at_place: float) -> None:
    """Let a robot's way on its line end before it was to, and who drives behind it look again."""
    robot.end = at_place
    on_line = robot.lines._on[robot.line]
    number = on_line.index(robot) + 1
    if number == len(on_line) or not on_line[number].is_on_the_way:
        return
    pause = on_line[number].pause
    at(robot.env, robot.env.now + (2 if robot.bin else 1), _end_now, pause)


def _end_now(pause: simpy.Event) -> None:
    """Let what waits for an event go on at once, before others act in this tick."""
    if pause.triggered or pause.callbacks is None:
        return
    pause._ok = True
    pause._value = None
    callbacks = pause.callbacks
    pause.callbacks = None  # type: ignore[assignment]
    for callback in callbacks:
        callback(pause)


def _next_gate(
    robot: Any, needs: list[tuple[float, Gate]], here: float, step: DriveTo
) -> tuple[float, float, simpy.Event | None]:
    """Return as `Robot._next_gate`, but let the carrier hear that its bin is left when it is told.

    It asks from where it would ask for the gate's places.
    """
    while needs and (here > needs[0][0] + NEAR or robot.places.has(needs[0][1].places)):
        del needs[0]
    if not needs:
        return inf, inf, None
    gate_at, gate = needs[0]
    before = gate_at - here - step.asks_before
    if before >= -NEAR:
        return gate_at, max(1, floor(before / (step.speed * TIME_STEP) + NEAR) + 1), None
    if gate.bin and not _is_told_left(robot, needs, gate.bin):
        ticks = LOOK_AGAIN - (robot.tick - robot.asked - ASK) % LOOK_AGAIN
        return gate_at, ticks, robot.env.timeout(ticks)
    robot.places.want(gate.places)
    return gate_at, inf, None


def _is_told_left(robot: Any, drive: list[tuple[float, Gate]], full_bin: str) -> bool:
    """Whether a carrier has heard that a bin is left.

    `drive`: its gates, which tell one drive from the next.
    """
    if getattr(robot, "asks_on", None) is not drive:
        robot.asks_on = drive
        robot.asked = robot.tick
    since = robot.tick - robot.asked
    left_at = vars(robot.model).get("left_at", {}).get(full_bin, inf)
    is_left = robot.model.left[full_bin].triggered and left_at < robot.tick
    if since > 0 and (since - ASK) % LOOK_AGAIN == 0 and is_left:
        # What wakes it for its next job stands for this one.
        robot.told_left_on = robot.new_plan
    return getattr(robot, "told_left_on", None) is robot.new_plan
