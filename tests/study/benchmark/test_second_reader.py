"""The second reader of the benchmark's files, where robots wait: small orchards that are made so.

In few orchards of the set a carrier waits for long, so those do not show whether it waits rightly.
"""

import json
import re
from collections import defaultdict
from importlib.resources import files
from pathlib import Path

import pytest
from msgspec.structs import replace
from quiet import NOBODY
from second_reader import TICK, Reader

from orchard.event_model.trace import trace
from orchard.field.layout import lay_out
from orchard.field.scenario import check
from orchard.study.benchmark.instances import SET, KnownSchedule, as_file, instance_of, recorded
from orchard.study.benchmark.play import Played, built_in_harvest

FOLDER = Path(str(files("orchard.study.benchmark"))) / SET
SEED = 7
SMALL = NOBODY | {
    "rows": 8,
    "pickers": 4,
    "carriers": 4,
    "picking_speed": 0.5,
    "row_length": 60.0,
    "route": "two-way",
    "rows_to_pickers": "balanced",
    "seed": SEED,
}
FAR = {"metres": 400.0, "speed": 4.0, "seconds": 60.0}
TWO_TRAILERS = {"load_out": FAR | {"trailers": {"count": 2, "bins": 2}}}
BATTERIES = {
    "metres_per_bin": 20.0,
    "carriers": 3,
    "carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.5}},
    "chargers": 1,
}
# What differs from SMALL, and at which places robots wait in it, for how many s at least. A place
# is a trailer, the bay, a lane's place on a road ("west/F/4"), a carrier's stop at a picker, or a
# charger. Robots also wait behind others, and because they fail, meet people or look around.
WAITS = {
    "one trailer of one bin": (
        {"load_out": FAR | {"trailers": {"count": 1, "bins": 1}}},
        {"trailer": 1000.0, "bay": 1000.0},
    ),
    "two trailers": (TWO_TRAILERS, {"trailer": 50.0, "bay": 100.0}),
    "several bins a row, and trailers": (
        TWO_TRAILERS | {"metres_per_bin": 20.0, "carriers": 3},
        {"trailer": 200.0, "bay": 100.0, "west/F/4": 20.0},
    ),
    "several bins a row": ({"metres_per_bin": 20.0}, {"west/D/1": 50.0, "west/F/4": 50.0}),
    "bins that are emptied slowly": (
        {"handling": {"coupling": 5.0, "uncoupling": 5.0, "unloading": 90.0}},
        {"bay": 500.0},
    ),
    "swift machines": (
        {
            "handling": {"unloading": 90.0},
            "carrying": {"speed": 2.0},
            "picking": {"driving_speed": 1.5},
        },
        {"bay": 500.0},
    ),
    "carriers that are early": (
        {"rows": 4, "picking_speed": 0.2},
        {"picker_01 0": 30.0, "east/D/1": 30.0},
    ),
    "carriers that drive to the load-out": (
        {"load_out": {"metres": 200.0, "speed": 2.0, "seconds": 30.0}},
        {"bay": 5.0, "west/D/1": 30.0},
    ),
    "rows that take unlike times": (
        {"picking": {"spread": {"distribution": "gamma", "cv": 0.3}}},
        {"west/F/6": 15.0},
    ),
    "one-way roads": ({"route": "one-way"}, {"west/F/8": 5.0, "west/F/6": 5.0}),
    "carriers that fail": (
        {"carrying": {"failure": {"mean_between": 600.0, "mean_repair": 90.0}}},
        {"failures": 500.0, "behind": 150.0},
    ),
    "pickers that fail": (
        {"picking": {"failure": {"mean_between": 100.0, "mean_repair": 60.0}}},
        {"failures": 600.0},
    ),
    "people": (
        {"people": {"workers": 20, "visitors": 10}, "metres_per_bin": 20.0},
        {"meetings": 100.0, "looks": 100.0},
    ),
    "carriers that charge": (BATTERIES, {"charger": 800.0}),
}


def played_and_filed(more: dict) -> tuple[Played, dict]:
    """Return the harvest of `predictive` in an orchard, and what its file says of it.

    `more`: what differs from SMALL. The file has no real bound, so 1 s stands for it.
    """
    played = built_in_harvest(lay_out(check(SMALL | more, "small")), "predictive")
    assert played.seconds is not None
    best = KnownSchedule(played.seconds, "predictive", True, recorded(played.decisions))
    instance = instance_of("small-waits", "test", SMALL | more, {SEED: 1.0})
    (draw,) = instance.draws
    return played, json.loads(as_file(replace(instance, draws=[replace(draw, best=best)])))


@pytest.mark.parametrize("name", WAITS)
def test_another_program_lets_robots_wait_as_the_model(name):
    """Its harvest is as long as that of the event model, within 1 %.

    If robots waited for less than WAITS says, the orchard would not show what it is made for.
    """
    more, waits = WAITS[name]
    played, file = played_and_filed(more)
    reader = Reader(file, 0)
    assert reader.run() * TICK == pytest.approx(played.seconds, rel=0.01)
    assert {
        place for place, seconds in waits.items() if reader.waited[place] * TICK < seconds
    } == set()


def test_another_program_charges_batteries_as_the_model():
    """Each carrier has a full battery as often as in the event model, and within 30 s of it."""
    _, file = played_and_filed(BATTERIES)
    reader = Reader(file, 0)
    reader.run()
    wanted = full_batteries(SMALL | BATTERIES | {"dispatch": "predictive"})
    assert sum(map(len, wanted.values())) >= 6
    assert {*reader.full} == {*wanted}
    for carrier, seconds in wanted.items():
        assert [tick * TICK for tick in reader.full[carrier]] == pytest.approx(seconds, abs=30.0)


def full_batteries(values: dict) -> dict[str, list[float]]:
    """Return when each carrier's battery is full in the event model: carrier -> s."""
    full = defaultdict(list)
    before = {}
    for line in trace(lay_out(check(values, "batteries"))):
        clock, robot, words = re.split(r"\s+", line, maxsplit=2)
        hours, minutes, seconds = clock.split(":")
        if before.get(robot) == "waits until its battery is full":
            full[robot].append(3600 * int(hours) + 60 * int(minutes) + float(seconds))
        before[robot] = words
    return full


def test_another_program_needs_what_holds_robots_up():
    """Without failures the reader is wrong by more than the tolerance of the tests."""
    more, _ = WAITS["carriers that fail"]
    played, file = played_and_filed(more)
    file["draws"][0]["failures"] = {}
    assert Reader(file, 0).run() * TICK < 0.95 * played.seconds


def test_another_program_needs_whom_robots_meet():
    """With people and animals it is nearer to each harvest than without them."""
    file = json.loads((FOLDER / "small-people-test.json").read_text())
    for number, draw in enumerate(file["draws"]):
        seconds = draw["best"]["seconds"]
        missed = abs(Reader(file, number).run() * TICK - seconds)
        draw["meetings"] = {}
        draw["looks"] = {}
        assert missed < 0.8 * abs(Reader(file, number).run() * TICK - seconds)
