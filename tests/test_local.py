"""What a run in one process says of itself: before it begins, and when it is over."""

import pytest
from stage import empty_orchard

from orchard import Action, Local, Scenario, Snapshot
from orchard.contract.messages import pack, unpack

# Two carriers whose batteries last 0.05 h = 3 min, also while they stand. Both stop at the rows
# with a flat battery, and no carrier fetches a bin any more: the run jams.
FLAT = {
    "pickers": 3,
    "carriers": 2,
    "picking_speed": 0.5,
    "carrying": {"battery": {"hours": 0.05, "standing": 1.0, "reserve": 0.6}},
}


def test_before_the_first_tick_bodies_see_what_they_see_at_it():
    run = Local(Scenario(rows=3))
    truth = run.engine.truth()["picker_01"].scan.tolist()
    odometry = run.engine.odometry()["picker_01"].scan.tolist()
    seen = run.seen["picker_01"].scan.tolist()
    first = run.engine.observe()["picker_01"].scan.tolist()
    assert truth == odometry
    assert odometry == seen
    assert seen == first


def test_a_resumed_run_tells_the_truth_before_its_next_tick():
    run = Local(Scenario(rows=3))
    run.tick()
    resumed = Local.resume(run.snapshot())
    known = run.engine.observe()["picker_01"].scan.tolist()
    assert resumed.engine.truth()["picker_01"].scan.tolist() == known


def test_a_jam_ends_a_run_as_the_command_ends_it(soon_jammed):
    """So does a run that is resumed from its snapshot; a fork with something changed goes on."""
    run = Local(empty_orchard(**FLAT))
    while not run.ended:
        assert run.engine.tick < 10_000
        run.tick()
    assert run.ended == "jammed"
    assert not run.engine.over
    assert "carrier_01 (standing with a flat battery)" in run.jam
    kept = unpack(pack(run.snapshot()), Snapshot)
    resumed = Local.resume(kept)
    assert resumed.ended == "jammed"
    assert resumed.jam == run.jam
    assert run.fork(pickers=3).ended == "", "what was changed may end the jam"


def test_a_loop_until_the_harvest_ends_after_a_jam_with_words(soon_jammed):
    """The loop asks whether the harvest is over, and never whether the run has ended.

    `tick` refuses to go on after twice the time that counts as a jam: 2 * 120 s with `soon_jammed`.
    """
    run = Local(empty_orchard(**FLAT))

    def run_to_the_end():
        while not run.engine.over:
            assert run.engine.tick < 20_000
            run.tick()

    with pytest.raises(RuntimeError) as refused:
        run_to_the_end()
    words = str(refused.value)
    assert words.startswith("the run has ended (jammed): nothing has gone on for 240 s")
    assert "carrier_01 (standing with a flat battery)" in words
    assert "while not run.ended" in words
    before = run.engine.tick
    run.act(run.ask())
    assert run.engine.tick == before + 1, "`act` and `ask` still go on"


def test_a_harvested_run_goes_on_as_long_as_one_wants(soon_jammed):
    """For 2,500 ticks nothing is picked or fetched: more than twice the 120 s of a jam."""
    run = Local(empty_orchard(pickers=3, carriers=2, row_length=30.0))
    while not run.ended:
        assert run.engine.tick < 10_000
        run.tick()
    harvested = run.engine.tick
    for _ in range(2500):
        run.tick()
    assert run.ended == "harvested"
    assert run.engine.tick == harvested + 2500


def test_a_harvest_ends_as_harvested():
    run = Local(empty_orchard(pickers=3, carriers=2, row_length=30.0))
    while not run.ended:
        assert run.engine.tick < 10_000
        run.tick()
    assert run.ended == "harvested"
    assert run.engine.over
    assert run.jam == []


class Failing:
    """An agent that raises an error."""

    Memory = dict

    def tick(self, seen, mail, memory) -> Action:
        raise RuntimeError("no idea")


def test_a_run_ends_when_all_pickers_are_broken():
    run = Local(empty_orchard(pickers=2))
    for name in ("picker_01", "picker_02"):
        run.play(name, Failing())
    for _ in range(20):
        run.tick()
    assert run.ended == "broken"
    assert Local.resume(run.snapshot()).ended == "broken"
