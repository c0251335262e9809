"""The machine of the event model: what it shares, where it stops, and what it tells.

Harvests of one orchard share its program, the steps of all robots as ops. The jobs of carriers are
translated into ops when they are first ordered, so a program grows while harvests use it.
"""

import ast
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from quiet import NOBODY

from orchard.event_model import start
from orchard.event_model.batch import compiled as batch_compiled
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import compiled, machine
from orchard.event_model.results import JAM
from orchard.event_model.trace import trace
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.report.losses import with_endless_batteries

SMALL = NOBODY | {"rows": 5, "pickers": 3, "carriers": 3, "row_length": 30.0}


def small(dispatch: str) -> Layout:
    """Return a layout of a small orchard with this policy."""
    return lay_out(Scenario(**SMALL, dispatch=dispatch, route="two-way"))


def figures(harvest: EventHarvest) -> tuple[Any, ...]:
    """Return all that a harvest comes to, so that two can be compared."""
    return (
        harvest.deliveries,
        harvest.seconds,
        harvest.picker_waiting_seconds(),
        harvest.carrier_utilisation(),
        harvest.exchanges,
    )


def test_a_second_seed_uses_the_jobs_that_were_translated() -> None:
    values = SMALL | {
        "dispatch": "predictive",
        "picking_speed": 0.4,
        "picking": {"spread": {"distribution": "gamma"}},
    }
    first, second = (EventHarvest(lay_out(Scenario(**values, seed=seed))) for seed in (1, 2))
    assert first.program is second.program
    assert first.run().deliveries != second.run().deliveries


def test_a_harvest_sees_jobs_that_another_has_translated() -> None:
    """Both share a program, which grows after the second harvest has begun."""
    values = NOBODY | {"rows": 10, "pickers": 5, "carriers": 5, "dispatch": "predictive"}
    layouts = [lay_out(Scenario(**values, row_length=31.0, seed=seed)) for seed in (1, 2)]
    alone = EventHarvest(lay_out(Scenario(**values, row_length=31.0, seed=2))).run()
    start._prepared.cache_clear()
    first, second = map(EventHarvest, layouts)
    rows = len(second.model.ops)
    first.run()
    assert len(first.model.ops) > rows, "the program has not grown"
    assert figures(second.run()) == figures(alone)


def test_harvests_in_threads_that_share_a_program_are_the_same() -> None:
    """Eight harvests begin with one program that has no jobs yet, and run in four threads."""
    values = NOBODY | {"rows": 12, "pickers": 6, "carriers": 6, "dispatch": "nearest"}
    layouts = [lay_out(Scenario(**values, row_length=29.0, seed=seed)) for seed in range(8)]
    alone = [figures(EventHarvest(layout).run()) for layout in layouts]
    start._prepared.cache_clear()
    shared = [EventHarvest(layout) for layout in layouts]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(EventHarvest.run, shared))
    assert [figures(harvest) for harvest in together] == alone


def test_a_harvest_that_was_stopped_goes_on() -> None:
    """`run` goes on by JAM ticks at a time, and asks a function before each whether it may. Here it
    may once in each call, so the harvest is stopped more than twice.
    """
    layout = lay_out(Scenario(**SMALL, dispatch="predictive", picking_speed=0.02))
    whole = EventHarvest(layout).run()
    assert whole.seconds > 2 * JAM * TIME_STEP
    parts = EventHarvest(layout)
    for _ in range(100):
        rounds = iter([True, False])
        parts.run(lambda rounds=rounds: next(rounds))
    assert figures(parts) == figures(whole)


def test_a_harvest_that_is_done_in_parts_is_the_same() -> None:
    layout = small("predictive")
    whole = EventHarvest(layout).run()
    parts = EventHarvest(layout)
    # Parts of 3.7 s, until long after the end.
    for tick in range(0, 20_000, 37):
        parts.advance(tick)
    assert figures(parts) == figures(whole)


def test_a_trace_tells_a_job_from_the_order_to_the_way_home() -> None:
    lines = [line.split(maxsplit=2) for line in trace(small("nearest"))]
    job = [words for _, robot, words in lines if robot == "carrier_01"]
    first = job[: job.index("is free for the next call")]
    deeds = [words for words in first if not words.startswith(("drives", "turns"))]
    assert "leaves the empty bin for the picker" in deeds
    assert deeds.index("couples the full bin") < deeds.index("unloads")
    times = [time for time, _, _ in lines]
    assert times[0] == "0:00:00.0"
    assert times == sorted(times)
    assert any(words.startswith("picks along row 2 to x = ") for _, _, words in lines)


def test_what_the_model_does_not_know_is_refused() -> None:
    layout = lay_out(Scenario(**SMALL, sensors={"odometry": {"distance": 0.02}}))
    with pytest.raises(ValueError, match="errors of sensors; run the simulator"):
        EventHarvest(layout)


# Packages whose constants are compiled into the code that is kept on the disk. If one of them
# changes, the code must be compiled anew: so its file's name has a checksum of the modules of
# `CONSTANTS_OF`.
PACKAGES_OF_CONSTANTS = (
    "orchard.behaviour.",
    "orchard.dispatch.",
    "orchard.event_model.",
    "orchard.plans.",
)


def imported_by(path: Path) -> list[str]:
    """Return the modules of PACKAGES_OF_CONSTANTS from which a file imports."""
    nodes = ast.walk(ast.parse(path.read_text()))
    names = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return [name for name in names if name.startswith(PACKAGES_OF_CONSTANTS)]


def test_each_compiled_constant_counts_for_the_kept_code() -> None:
    """The kernel's own files all count, so their constants are not looked for."""
    counted = {module.__name__ for module in compiled.CONSTANTS_OF}
    for path in Path(machine.__file__).parent.glob("*.py"):
        for name in imported_by(path):
            if not name.startswith("orchard.event_model.kernel"):
                assert name in counted, f"{path.name} takes constants of {name}"


def test_each_constant_of_a_batch_counts_for_its_kept_code() -> None:
    """A batch takes some functions from elsewhere, and their constants count, too."""
    counted = {module.__name__: module for module in batch_compiled.CONSTANTS_OF}
    sources = [*Path(str(batch_compiled.__file__)).parent.glob("*.py")]
    sources.remove(Path(str(batch_compiled.__file__)))
    compiled_files = [path for path in sources if "@inner" in path.read_text()]
    assert compiled_files
    # The only module outside of the two packages with functions that a batch compiles.
    compiled_files.append(Path(str(counted["orchard.event_model.bystanders"].__file__)))
    for path in compiled_files:
        for name in imported_by(path):
            is_of_batch = name.startswith("orchard.event_model.batch")
            # A signature is in the name of the kept file.
            is_signature = name == "orchard.event_model.kernel.entry"
            if not is_of_batch and not is_signature:
                assert name in counted, f"{path.name} takes constants of {name}"


def test_a_carrier_behind_one_that_is_called_stands_too() -> None:
    """A called carrier stands for two ticks, to ask its bin. So the one behind it stands, too.

    If it drove on, it would come to its place early, and be called another time. In the simulator
    all ten have been sent by tick 100. `is_free`: whether a carrier can still be called.
    """
    values = NOBODY | {"rows": 10, "pickers": 10, "carriers": 10, "dispatch": "predictive"}
    harvest = EventHarvest(lay_out(Scenario(**values)))
    harvest.advance(100)
    assert not harvest.model.robots.is_free.any()


def test_a_battery_that_lasts_for_ever_is_not_none() -> None:
    """Both scenarios read the same as text, but the plans of carriers differ."""
    layout = small("nearest")
    endless = with_endless_batteries(
        lay_out(Scenario(**SMALL, dispatch="nearest", carrying={"battery": {"hours": 8.0}}))
    )
    assert start.prepare(endless).program is not start.prepare(layout).program
