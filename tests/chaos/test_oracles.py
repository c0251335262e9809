"""What schedules look at: each test breaks one thing, and the oracle for it complains.

A schedule (chaos/simulated) runs a scene, a small orchard of `SCENES`, over a simulated network,
with faults. Its oracles compare all that it publishes, records and counts with local mode. The
harvest of each scene in local mode is stored, with keyframes: snapshots from which schedules begin.
A moment is a tick at which something happens in it.
"""

from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import msgspec
import pytest

from chaos.simulated.begin import wrong_begin
from chaos.simulated.census import ANSWERS, DEEDS, MESSAGES, OF_HARVEST, REQUESTS, Census, summed_up
from chaos.simulated.course import Course
from chaos.simulated.drawing import draw
from chaos.simulated.harvest import OF_BINS, harvest_of, made, stored_counts
from chaos.simulated.link import Delays
from chaos.simulated.observer import Observer
from chaos.simulated.plan import CLIENT, RUN_PY, Fault, Plan
from chaos.simulated.scenes import SCENES
from chaos.simulated.trial import carry_out
from chaos.simulated.written import first_difference
from orchard.contract.events import Event
from orchard.futures.moments import WatchedRun
from orchard.record.logger import FrameQueue
from orchard.report.metrics import HarvestFigures
from orchard.server import barriers
from orchard.server.commands import Advised
from orchard.sim.engine import Engine
from orchard.tables.tables import BodyRows
from orchard.wire.keys import PHYSICS

ROOT = Path(__file__).parents[2]
# The scene of these tests.
SCENE = "rolling"


def shortly_before(what: str, *faults: Fault, ticks: int = 60, **others) -> Plan:
    """Return a plan that begins at the last keyframe before an event of a kind."""
    harvest = harvest_of(SCENE)
    begin = harvest.last_keyframe(harvest.moments[what][0])
    given = {"has_logger": False, "has_router": False, "delays": Delays()} | others
    return Plan(1, SCENE, ticks, hosts=2, faults=faults, begin=begin, **given)


# -- what is stored


@pytest.mark.parametrize("scene", SCENES)
def test_local_mode_harvests_each_scene_as_it_is_stored(scene):
    assert harvest_of(scene).differences == []


@pytest.mark.parametrize("scene", SCENES)
def test_the_stored_counts_of_bins_are_those_of_the_rows(scene):
    """A full bin is left by its picker and taken by a carrier.

    The carrier has brought an empty bin, and unloads the full one.
    """
    bins = stored_counts()[scene].bins
    assert set(bins) == set(OF_BINS)
    assert bins["row picked"] == SCENES[scene]["rows"]
    assert bins["unloaded"] == bins["bin full"]
    assert bins["coupled"] == 2 * bins["bin full"]
    assert bins["uncoupled"] == 2 * bins["bin full"]


def test_stored_counts_find_a_harvest_wrong_in_each_mode():
    """No deed is done. Local mode is wrong in the same way, so only the stored counts differ."""
    expected = msgspec.structs.replace(stored_counts()[SCENE], ticks=500)
    with patch.object(Engine, "_deeds", lambda self, actions: []):
        _, counts = made(SCENE, expected)
    assert "0 times 'coupled', not 6" in counts.differences(stored_counts()[SCENE])


# -- what a schedule sees


def test_schedules_begin_shortly_before_something_happens():
    """In a harvest only each hundredth tick has an event, so most ticks would test little."""
    plans = [draw(seed) for seed in range(100)]
    events = [
        any(
            plan.begin <= tick < plan.end
            for what in (*OF_HARVEST, "failed", "repaired", "harvested")
            for tick in harvest_of(plan.scene).moments.get(what, ())
        )
        for plan in plans
    ]
    assert events.count(True) >= 85
    assert {plan.scene for plan in plans} == set(SCENES)


def test_all_kinds_of_the_reference_of_messages_are_counted():
    text = (ROOT / "docs" / "messages.md").read_text()
    messages = text.split("\n## Messages\n")[1].split("\n## ")[0]
    assert [line[4:] for line in messages.splitlines() if line.startswith("### ")]
    assert {line[4:] for line in messages.splitlines() if line.startswith("### ")} == set(MESSAGES)
    for heading, kinds in (("deeds", DEEDS), ("requests", REQUESTS), ("answers", ANSWERS)):
        part = text.split(f"\n### The {heading}\n")[1].split("\n### ")[0]
        assert {line.split("`")[1] for line in part.splitlines() if line.startswith("- `")} == set(
            kinds
        )


def test_what_occurs_in_a_schedule_is_counted():
    """In this schedule a picker leaves its full bin, which sends for a carrier."""
    verdict = carry_out(shortly_before("uncoupled", Fault("survey", CLIENT, 5, 0.0, 0.1)))
    assert verdict.complaints == []
    counts = summed_up([verdict.occurred])
    assert counts["events"]["uncoupled"] == 1
    assert counts["deeds"]["uncouple"] == 1
    assert counts["requests"]["come"] == 1
    assert counts["messages"]["Orchard"] == 1
    assert counts["events"]["charging"] == 0
    assert counts["messages"]["Advice"] == 0
    assert counts["faults"] == {"survey, client": 1}
    assert verdict.is_near


# -- what a user does


@pytest.mark.parametrize("what", ["kill", "fork"])
def test_a_resumed_or_forked_run_goes_on_as_in_local_mode(what):
    assert carry_out(shortly_before("uncoupled", Fault(what, RUN_PY, 20))).complaints == []


def test_a_run_that_is_reset_begins_again_and_lasts_as_long():
    verdict = carry_out(shortly_before("uncoupled", Fault("reset", CLIENT, 20)))
    assert verdict.complaints == []
    assert verdict.summary["ticks"] < verdict.plan.begin


def test_an_emergency_stop_is_that_of_local_mode():
    """The stop, at tick 10 for 3 s, holds after physics is killed 0.1 s later, too."""
    faults = Fault("stop robots", CLIENT, 10, 0.0, 3.0), Fault("kill", PHYSICS, 10, 0.1)
    verdict = carry_out(shortly_before("uncoupled", *faults, ticks=300))
    assert verdict.complaints == []
    assert "stopped" in verdict.occurred["events"]


def test_a_fork_whose_only_snapshot_is_torn_begins_anew():
    """At tick 20 the run goes on as a fork, whose first snapshot is torn 1 ms after tick 21. It
    begins anew, and does all its 60 ticks.
    """
    faults = Fault("fork", RUN_PY, 20), Fault("torn snapshot", PHYSICS, 21, 1e-3)
    plan = Plan(1, SCENE, 60, 1, has_logger=False, has_router=False, delays=Delays(), faults=faults)
    verdict = carry_out(plan)
    assert verdict.complaints == []
    assert verdict.summary["ticks"] == 60


@pytest.mark.parametrize(
    ("stop_at", "torn_at", "delays"),
    [
        (10, Fault("torn snapshot", PHYSICS, 20), Delays(1e-2)),
        (40, Fault("torn snapshot", PHYSICS, 41, 6e-4), Delays(1e-4, slow=1.0, share=0.02)),
    ],
)
def test_figures_before_a_torn_snapshot_are_of_the_run_before(stop_at, torn_at, delays):
    """Physics goes back to an older snapshot, which does not have the stop.

    Or, with slow links, the run hears of the stop only after physics is back.
    """
    stop = Fault("stop robots", CLIENT, stop_at, 0.02, 3.0)
    plan = shortly_before("uncoupled", stop, torn_at, ticks=120, delays=delays)
    assert carry_out(plan).complaints == []


def figures_at(tick: int, stopped_at: int) -> dict:
    """Return the figures of local mode at a tick. `stopped_at`: the tick of a picker's stop."""
    run = WatchedRun(harvest_of(SCENE).snapshot(100))
    while run.tick < tick:
        if run.tick == stopped_at:
            run.local.engine.stop(["picker_01"])
        run.figures.update(run.local.tick())
    return run.figures.figures()


# The tick of the figures, when they arrive (virtual s), and whether the oracle takes them.
@pytest.mark.parametrize(
    ("tick", "arrives_at", "are_known"),
    [(115, 2.0, True), (115, 60.0, False), (140, 2.0, False)],
    ids=["soon", "late", "of a later tick"],
)
def test_figures_of_a_forgotten_stop_are_of_its_ticks_and_soon(tick, arrives_at, are_known):
    """Physics goes back to a snapshot before the stop, and so forgets it.

    Figures with the stop are right only for ticks simulated before that, and if they come soon. The
    run is at tick 100, is stopped at 110, comes to 119, and goes back to 100 after 1 s.
    """
    now = [0.0]
    course = Course(SCENE, lambda: now[0])
    harvest = harvest_of(SCENE)
    course.begin(harvest.snapshot(100).scenario, 100, is_reset=False)
    stops = [Event(110, "stopped", "picker_01")]
    course.add(110, stops, {}, b"", is_whole=False)
    course.add(119, [], {}, b"", is_whole=False)
    now[0] = 1.0
    course.begin(harvest.snapshot(100).scenario, 100, is_reset=False)
    course.parts[-1].steps.clear()
    course.is_whole = True
    now[0] = arrives_at
    course.hear_figures(figures_at(tick, stopped_at=110))
    assert (list(course.differences(with_figures=True)) == []) == are_known


def test_refusals_forgotten_since_a_written_snapshot_are_found():
    """Physics does a tick again with fewer refusals, and dies before the snapshot is written."""
    observer = Observer(SCENE, Census(), lambda: 0.0)

    def goes_on_at(tick: int, refused: int) -> SimpleNamespace:
        run = SimpleNamespace(
            keep=lambda: None,
            engine=SimpleNamespace(tick=tick),
            refusal_totals=SimpleNamespace(total=lambda: {"malformed": refused}),
        )
        observer._watch_refusals(SimpleNamespace(run=run), is_reset=False)
        return run

    first = goes_on_at(10, 3)
    first.keep()
    observer.is_kept(10)
    second = goes_on_at(5, 1)
    second.engine.tick = 10
    second.keep()
    assert observer.complaints == []
    goes_on_at(10, 2)
    assert observer.complaints == ["what was refused is forgotten: malformed"]


# -- what is broken


def test_deeds_that_are_lost_fail_nearly_all_schedules():
    """Physics hears no deed. In some schedules no deed is due, so not all of them can fail."""
    plans = [draw(seed) for seed in range(20)]
    actions = barriers.LockstepBarrier.actions

    def without(self):
        return {
            name: msgspec.structs.replace(action, deeds=[])
            for name, action in actions(self).items()
        }

    lockstep = [plan for plan in plans if plan.mode == "lockstep"]
    with patch.object(barriers.LockstepBarrier, "actions", without):
        failed = [plan.seed for plan in lockstep if carry_out(plan).complaints]
    assert len(failed) >= 0.8 * len(lockstep)


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_deed_asked_for_in_vain_is_found_without_local_mode(mode):
    with patch.object(Engine, "_deeds", lambda self, actions: []):
        complaints = carry_out(shortly_before("uncoupled", mode=mode)).complaints
    assert any("asks for deeds in vain" in complaint for complaint in complaints)


def test_figures_that_are_wrong_are_found():
    count = HarvestFigures._count

    def twice(self, event):
        count(self, event)
        self.busy_ticks += event.what == "uncoupled"

    with patch.object(HarvestFigures, "_count", twice):
        complaints = carry_out(shortly_before("uncoupled")).complaints
    assert "another summary than local mode" in complaints
    assert any(complaint.startswith("other figures") for complaint in complaints)


def test_an_event_that_is_reported_twice_is_found():
    step = Engine.step

    def twice(self, *arguments):
        return [event for event in step(self, *arguments) for _ in range(2)]

    with patch.object(Engine, "step", twice):
        complaints = carry_out(shortly_before("uncoupled")).complaints
    assert any(complaint.startswith("other events or messages") for complaint in complaints)


def test_a_tick_that_is_twice_in_a_table_is_found():
    """Every 40th tick is written twice. Without that the same schedule has no complaint."""
    keep = BodyRows.keep

    def twice(self, engine):
        for _ in range(1 + (engine.tick % 40 == 0)):
            keep(self, engine)

    plan = shortly_before("uncoupled", has_tables=True)
    assert carry_out(plan).complaints == []
    with patch.object(BodyRows, "keep", twice):
        complaints = carry_out(plan).complaints
    assert any(complaint.startswith("tables: ") for complaint in complaints)


def test_a_wrong_event_in_a_table_is_named_where_counts_agree():
    found = [(5, "bin full", "picker_01"), (9, "coupled", "picker_01")]
    wanted = [(5, "bin full", "picker_01"), (9, "coupled", "picker_02")]
    assert first_difference(found, wanted) == (
        "(9, 'coupled', 'picker_01'), not (9, 'coupled', 'picker_02')"
    )
    assert first_difference(found, found[:1]) == "(9, 'coupled', 'picker_01'), not None"
    assert first_difference(found, found) == ""


@pytest.mark.parametrize("count", [0, 2])
def test_a_tick_that_is_missing_or_twice_in_a_recording_is_found(count):
    """Every 40th tick is recorded `count` times. With once the same schedule has no complaint."""
    put = FrameQueue.put

    def often(self, frame):
        for _ in range(count if frame.tick % 40 == 0 else 1):
            put(self, frame)

    plan = shortly_before("uncoupled", has_logger=True)
    assert carry_out(plan).complaints == []
    with patch.object(FrameQueue, "put", often):
        complaints = carry_out(plan).complaints
    assert any(complaint.startswith("recording: ") for complaint in complaints)


def test_advice_that_drives_for_too_long_is_found():
    actions = Advised.actions

    def longer(self, tick, own, newest):
        return actions(self, tick - 1, own, newest)

    with patch.object(Advised, "actions", longer):
        plan = shortly_before("uncoupled", Fault("advise", CLIENT, 5, 0.0, 0.5))
        complaints = carry_out(plan).complaints
    assert any("is driven by advice" in complaint for complaint in complaints)


# The tick at which physics goes on, the ticks of the snapshots that it has kept, those that are
# torn, and the complaint.
@pytest.mark.parametrize(
    ("tick", "kept", "torn", "words"),
    [
        (30, [10, 20, 30], set(), ""),
        (20, [10, 20, 30], {30}, ""),
        (10, [10, 20, 30], {30}, "physics went back to tick 10, though it has kept tick 20"),
        (0, [10, 20, 30], {20, 30}, ""),
        (20, [10, 20, 30], set(), "physics went back to tick 20, though it has kept tick 30"),
        (40, [10, 20, 30], set(), "physics goes on at tick 40, of which it has kept no snapshot"),
    ],
)
def test_physics_goes_one_snapshot_back_and_no_more(tick, kept, torn, words):
    """It goes on from its newest snapshot. If that is torn, it goes on from the one before; if that
    is torn too, it begins anew, at tick 0.
    """
    assert wrong_begin(tick, kept, torn) == words
