"""What may change when a run goes on from one of its moments, and how the harvest then ends.

A fork is a run that goes on from a moment of another one, its parent, with something changed.
"""

import re
from contextlib import suppress

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from local_runs import SHORT, SMALL, local_hash, played
from stage import empty_orchard

from orchard.contract.agent import Action
from orchard.field.problems import ScenarioError
from orchard.field.scenario import with_changes
from orchard.fork.forked import forked
from orchard.futures.moments import WatchedRun
from orchard.local import Local
from orchard.report.metrics import collisions

TWO_WAY = empty_orchard(route="two-way", rows=4, carriers=3, row_length=30.0)
# At this tick the harvest of TWO_WAY still goes on.
LATEST_TICK = 1800
# Ticks within which each harvest of this file is over.
MOST_TICKS = 60_000


def harvest_to_the_end(local: Local) -> WatchedRun:
    """Go on with a run until its harvest is over, without a jam, violation or collision."""
    run = WatchedRun(local.snapshot())
    run.go_on(MOST_TICKS)
    engine = run.local.engine
    assert engine.over
    assert run.figures.jam == []
    assert engine.violations() == []
    assert collisions(engine.world) == 0
    return run


# What a fork changes, by the keys of a scenario.
CHANGES = [
    {"carriers": 4},
    {"carriers": 2},
    {"carriers": 1},
    {"seed": 7, "picking.spread.distribution": "gamma", "picking_speed": 0.5},
    {"dispatch": "nearest"},
    {"dispatch": "rolling", "carriers": 4},
    {"people.workers": 2, "animals.dogs": 1, "weeds": 3, "tractor": True},
    {"carriers": 2, "people.visitors": 1},
]


@settings(max_examples=10)
@given(st.integers(0, LATEST_TICK), st.sampled_from(CHANGES))
def test_a_harvest_ends_well_after_any_change_at_any_moment(tick, changes):
    """A change is made, or refused for what robots do at that moment.

    The queue of a fork with fewer carriers keeps room for the three of the parent (`queue_room`).
    """
    parent = played(TWO_WAY, tick)
    try:
        fork = parent.fork(**changes)
    except ScenarioError as error:
        refusal = str(error)
        assert "changes: " in refusal
        assert re.search("carriers.*cannot be taken away|has no place at this moment", refusal)
        return
    run = harvest_to_the_end(fork)
    queue_room = 3 if changes.get("carriers", 3) < 3 else None
    expected = with_changes(TWO_WAY, queue_room=queue_room, **changes)
    assert run.local.engine.layout.scenario == expected


# Four carriers queue in a single line, which would be shorter for three.
FLEET = with_changes(TWO_WAY, pickers=4, carriers=4, picking_speed=0.5)


# In the example one of the four carriers is taken away after 24 ticks.
@settings(max_examples=5)
@example([(24, 4), (1, 3)], "two-way")
@given(
    st.lists(st.tuples(st.integers(1, 500), st.integers(1, 6)), min_size=2, max_size=4),
    st.sampled_from(["one-way", "two-way"]),
)
def test_carriers_are_taken_away_and_added_time_and_again(changes, route):
    """`changes`: each is the ticks that the run then goes on, and the number of carriers."""
    run = played(with_changes(FLEET, route=route), 0)
    for ticks, carriers in changes:
        with suppress(ScenarioError):
            run = run.fork(carriers=carriers)
        played(run, run.engine.tick + ticks)
    harvest_to_the_end(run)


def test_a_fork_without_changes_has_the_hash_of_its_parent():
    parent = played(SMALL, 300)
    fork = played(parent.fork(), 500)
    assert parent.engine.tick == 300
    assert fork.engine.hash == played(parent, 500).engine.hash
    assert played(parent, 500).engine.hash == local_hash(SMALL, 500)


def test_a_fork_leaves_agents_behind_that_were_given_to_play():
    """An object in place of picker_01 has a memory that no picker can read. The fork has a picker
    again, which begins anew.
    """

    class Standing:
        Memory = dict

        def tick(self, seen, mail, memory):
            return Action(memory={"ticks": 1})

    parent = played(SMALL, 100)
    parent.play("picker_01", Standing())
    harvest_to_the_end(played(parent, 200).fork())


def test_a_carrier_that_is_taken_away_was_free():
    """The carriers that stay keep their jobs."""
    parent = played(TWO_WAY, 300)

    def carrier_memories(run: Local) -> list:
        return [memory for name, memory in run.memories.items() if name.startswith("carrier")]

    def jobs(run: Local) -> list[str]:
        return [memory.job.bin for memory in carrier_memories(run) if memory.job]

    assert 0 < len(jobs(parent)) < 3
    fork = parent.fork(carriers=2)
    assert len(carrier_memories(fork)) == 2
    assert len(jobs(fork)) == len(jobs(parent))

    # At this tick at least two of the three carriers have a job.
    refusal = r"carriers = 1: cannot be taken away|carriers = 1: 2 cannot be taken away"
    with pytest.raises(ScenarioError, match=refusal):
        played(TWO_WAY, 1400).fork(carriers=1)


def test_a_carrier_that_is_renamed_keeps_its_place_in_the_queue():
    """carrier_02 waits in the queue and is taken away, so carrier_03, which works, takes its name.

    A queue place of 0 means that of the carrier's number, so the renamed one remembers a 3.
    """
    parent = played(TWO_WAY, 2050)
    assert parent.memories["carrier_02"].job is None
    busy = parent.memories["carrier_03"]
    renamed = parent.fork(carriers=2).memories["carrier_02"]
    assert busy.job is not None
    assert renamed.job == busy.job
    assert busy.queue_place == 0
    assert renamed.queue_place == 3


def test_carriers_whose_class_remembers_a_list_can_be_taken():
    run = played(
        SMALL.model_copy(update={"carriers": 2, "agents": {"carrier": "own_agents.Listing"}}), 20
    )
    assert run.fork(carriers=1).memories["carrier_01"] == ["waits"]


def test_another_seed_changes_only_what_is_drawn_later():
    varying = with_changes(
        SHORT,
        **{
            "picking.spread.distribution": "gamma",
            "picking_speed": 0.5,
            "picking.failure.mean_between": 120.0,
        },
    )
    parent = played(varying, 200)
    seed_5 = parent.fork(seed=5)
    seed_6 = parent.fork(seed=6)
    assert seed_5.engine.digest == parent.engine.digest
    assert seed_6.engine.digest == parent.engine.digest
    # A plan has the speed at which the next bin is picked, which is drawn.
    assert seed_5.memories["picker_01"].plan != seed_6.memories["picker_01"].plan
    assert harvest_to_the_end(seed_5).tick != harvest_to_the_end(seed_6).tick


def test_losses_are_not_told_if_a_user_stopped_a_robot():
    run = WatchedRun(played(SHORT, 100).snapshot())
    run.local.engine.stop(["picker_01"])
    run.go_on(150)
    run.local.engine.reset()
    run.go_on(60_000)
    assert run.ended == "harvested"
    assert run.figures.summary()["lost_seconds"] == {}


def test_a_robot_may_be_stopped_and_an_unknown_one_is_named():
    fork = played(played(SMALL, 100).fork(stop=["picker_02"]), 300)
    i = fork.engine.layout.index["picker_02"]
    assert fork.engine.world.stopped[i]
    assert fork.engine.world.distance[i] == played(SMALL, 100).engine.world.distance[i]
    with pytest.raises(ValueError, match="picker_09"):
        fork.fork(stop=["picker_09"])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (
            {"rows": 4},
            (
                r"changes: rows = 4: cannot change under way: the orchard, its roads and what fills"
                r" a bin stay as they are"
            ),
        ),
        (
            {"pickers": 3},
            "which picker picks which rows is settled when a run begins; a picker can be stopped",
        ),
        ({"sensors.gnss.white": 0.01}, "robots are on courses that were made for it"),
        ({"carrying.failure.mean_between": 900.0}, "robots are on courses that were made for it"),
        (
            {"carriers": 12},
            "carriers = 12: .* the lines of the queue would be others, .*; expected at most 5",
        ),
        ({"dispatch": "fastest"}, "changes: dispatch = 'fastest': must be"),
    ],
)
def test_what_cannot_change_is_named_with_the_reason(changes, why):
    with pytest.raises(ScenarioError, match=why):
        played(SMALL, 20).fork(**changes)


def test_a_run_without_figures_is_not_jammed_at_once():
    # No bin is delivered in the first 610 s. A run counts as jammed after 600 s without a delivery;
    # but a run without figures does not know when the last one was.
    slow = with_changes(SMALL, row_length=200.0, picking_speed=0.1)
    assert WatchedRun(played(slow, 6100).snapshot()).figures.jam == []


def test_an_added_carrier_has_a_slow_error_from_the_first():
    """The bias of its GNSS receiver is drawn for it, and those of the others stay."""
    run = Local(with_changes(TWO_WAY, carriers=2, queue_room=3, **{"sensors.gnss.bias": 0.02}))
    for _ in range(20):
        run.tick()
    before = run.engine.world
    after = run.fork(carriers=3).engine.world
    assert after.bias[after.index["carrier_03"]].any()
    assert (after.bias[after.index["carrier_02"]] == before.bias[before.index["carrier_02"]]).all()


def test_carriers_are_never_busier_than_all_the_time():
    """Three carriers have worked. Their share of busy time stays when there is only one: as if it
    had done all the work, it would be more than 1.
    """
    run = WatchedRun(Local(TWO_WAY).snapshot())
    # By this tick two of three carriers are back in the queue, so they can be taken away.
    run.go_on(2200)
    fewer = WatchedRun(forked(run.snapshot(), {"carriers": 1}))
    before = run.figures.figures()["carrier_utilisation"]
    after = fewer.figures.figures()["carrier_utilisation"]
    assert after == before
    assert 0.5 < after < 1.0
