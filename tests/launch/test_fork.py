"""A run goes on from any of its moments with something changed: what may change, where it begins,
and what a user is told.
"""

import re
import shlex
import signal
from contextlib import suppress

import pytest
from code_blocks import block
from command_line import orchard, running, scenario_file, summary_of, wait_until_simulated
from hypothesis import example, given, settings
from hypothesis import strategies as st
from local_runs import SHORT, SMALL, local_hash, played
from patience import PATIENCE
from stage import empty_orchard

from orchard.contract.agent import Action
from orchard.contract.messages import pack
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.folders import runs_folder
from orchard.fork import forked
from orchard.futures.moments import WatchedRun
from orchard.local import Local
from orchard.report.metrics import collisions
from orchard.sim.snapshot import KEYFRAME, SNAPSHOT, as_file, store, ticks_of
from orchard.terminal.values import clock, moment

TWO_WAY = Scenario(
    **empty_orchard().model_dump()
    | {
        "route": "two-way",
        "rows": 4,
        "carriers": 3,
        "row_length": 30.0,
    }
)
LATEST = 1800  # a tick at which a harvest of it still goes on


def run_out(local: Local) -> WatchedRun:
    """Run it to its end, which is none of a jam."""
    run = WatchedRun(local.snapshot())
    run.go_on(60_000)
    engine = run.local.engine
    assert (engine.over, run.figures.jam, engine.violations(), collisions(engine.world)) == (
        True,
        [],
        [],
        0,
    )
    return run


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
@given(st.integers(0, LATEST), st.sampled_from(CHANGES))
def test_a_harvest_ends_well_after_any_change_at_any_moment(tick, changes):
    before = played(TWO_WAY, tick)
    try:
        run = run_out(before.fork(**changes))
    except ScenarioError as error:
        refusal = str(error)
    else:
        room = run.local.engine.layout.scenario.queue_room
        assert run.local.engine.layout.scenario == with_changes(TWO_WAY, queue_room=room, **changes)
        assert room == (3 if changes.get("carriers", 3) < 3 else None), (
            "the queue never becomes shorter"
        )
        return
    assert "changes: " in refusal
    assert re.search("carriers.*cannot be taken away|has no place at this moment", refusal)


FLEET = with_changes(
    TWO_WAY, pickers=4, carriers=4, picking_speed=0.5
)  # a single line, which would be shorter for three


@settings(max_examples=5)
@example([(24, 4), (1, 3)], "two-way")
@given(
    st.lists(st.tuples(st.integers(1, 500), st.integers(1, 6)), min_size=2, max_size=4),
    st.sampled_from(["one-way", "two-way"]),
)
def test_carriers_are_taken_away_and_added_time_and_again(changes, route):
    run = played(with_changes(FLEET, route=route), 0)
    for ticks, carriers in changes:
        with suppress(ScenarioError):
            run = run.fork(carriers=carriers)
        played(run, run.engine.tick + ticks)
    run_out(run)


def test_a_fork_without_changes_has_the_hash_of_its_parent():
    parent = played(SMALL, 300)
    fork = played(parent.fork(), 500)
    assert parent.engine.tick == 300
    assert fork.engine.hash == played(parent, 500).engine.hash == local_hash(SMALL, 500)


def test_a_fork_leaves_agents_behind_that_were_given_to_play():
    class Standing:
        Memory = dict  # nothing that a picker remembers

        def tick(self, seen, mail, memory):
            return Action(memory={"ticks": 1})

    parent = played(SMALL, 100)
    parent.play("picker_01", Standing())
    run_out(played(parent, 200).fork())


def test_a_carrier_that_is_taken_away_was_free():
    """A carrier that is taken away was free and the others keep their jobs."""
    parent = played(TWO_WAY, 300)
    jobs = [
        memory.job.bin
        for name, memory in parent.memories.items()
        if name.startswith("carrier") and memory.job
    ]
    assert 0 < len(jobs) < 3
    fork = parent.fork(carriers=3 - 1)
    memories = [memory for name, memory in fork.memories.items() if name.startswith("carrier")]
    assert len(memories) == 2
    assert len([memory for memory in memories if memory.job]) == len(jobs)
    with pytest.raises(
        ScenarioError,
        match=r"carriers = 1: cannot be taken away|carriers = 1: 2 cannot be taken away",
    ):
        played(TWO_WAY, 1400).fork(carriers=1)


def test_a_carrier_that_is_renamed_keeps_its_place_in_the_queue():
    """The last carrier takes the name of the one that is taken away, and returns to its own place.

    The one that is taken away waits in the queue, and the last one has a job.
    """
    parent = played(TWO_WAY, 2050)
    assert parent.memories["carrier_02"].job is None
    busy = parent.memories["carrier_03"]
    renamed = parent.fork(carriers=2).memories["carrier_02"]
    assert renamed.job == busy.job is not None
    assert (busy.queue_place, renamed.queue_place) == (0, 3), "0: the place of its number"


def test_carriers_whose_class_remembers_a_list_can_be_taken():
    run = played(
        SMALL.model_copy(update={"carriers": 2, "agents": {"carrier": "own_agents.Listing"}}), 20
    )
    assert run.fork(carriers=1).memories["carrier_01"] == ["waits"]


def test_another_seed_changes_only_what_is_drawn_later():
    """Another seed changes what is drawn from then on and nothing before."""
    varying = with_changes(
        SHORT,
        **{
            "picking.spread.distribution": "gamma",
            "picking_speed": 0.5,
            "picking.failure.mean_between": 120.0,
        },
    )
    parent = played(varying, 200)
    one = parent.fork(seed=5)
    other = parent.fork(seed=6)
    assert one.engine.digest == other.engine.digest == parent.engine.digest
    speeds = [run.memories["picker_01"].plan for run in (one, other)]
    assert speeds[0] != speeds[1]
    assert run_out(one).tick != run_out(other).tick


def test_losses_are_not_told_if_a_user_stopped_a_robot():
    run = WatchedRun(played(SHORT, 100).snapshot())
    run.local.engine.stop(["picker_01"])
    run.go_on(150)
    run.local.engine.reset()
    run.go_on(60_000)
    assert (run.ended, run.figures.summary()["lost_seconds"]) == ("harvested", {})


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
    assert (
        WatchedRun(
            played(with_changes(SMALL, row_length=200.0, picking_speed=0.1), 6100).snapshot()
        ).figures.jam
        == []
    )


# -- the command


@pytest.fixture(scope="module")
def harvest(tmp_path_factory):
    """A harvest of many processes with a keyframe every 20 s: its recording, and its summary."""
    folder = tmp_path_factory.mktemp("harvest")
    recording = runs_folder() / "parent.rrd"
    summary = folder / "parent.json"
    orchard(
        scenario_file(folder, SHORT),
        "--hosts",
        1,
        "--keyframes",
        20,
        "--record",
        recording,
        "--summary",
        summary,
    )
    return recording, summary_of(summary)


def test_keyframes_stay_and_an_unchanged_fork_has_the_hash(harvest, tmp_path):
    """Keyframes stay after a harvest and a fork of many processes without changes has its hash."""
    recording, parent = harvest
    ticks = ticks_of(recording.with_suffix(".snapshots"))
    assert ticks == list(range(0, parent["ticks"], 200))
    path = tmp_path / "fork.json"
    table = tmp_path / "tables"
    done = orchard(
        "fork",
        recording,
        "--at",
        "1:23.5",
        "--hosts",
        2,
        "--record",
        tmp_path / "f.rrd",
        "--summary",
        path,
        "--table",
        table,
    )
    fork = summary_of(path)
    assert fork["hash"] == parent["hash"]
    others = (
        "hosts wall_seconds times_real_time asked_share messages_refused recording_parts"
        " recording_gaps forked_from"
    )
    figures = set(fork) - set(others.split())
    assert {name: fork[name] for name in figures} == {name: parent[name] for name in figures}
    assert fork["forked_from"] == {"run": "parent", "seconds": 83.5}
    assert fork["recording_gaps"] == [[0.0, 83.6]], "its recording begins with it"
    assert f"hash {parent['hash']}" in done.stdout


def test_a_fork_is_a_run_of_its_own_that_can_be_forked_again(harvest, tmp_path):
    path = tmp_path / "fork.json"
    orchard(
        "fork",
        harvest[0],
        "--at",
        60,
        "--set",
        "carriers=+1",
        "--seed",
        7,
        "--mode",
        "local",
        "--record",
        "none",
        "--summary",
        path,
    )
    fork = summary_of(path)
    assert (
        fork["finished"],
        fork["scenario"]["carriers"],
        fork["scenario"]["seed"],
        fork["violations"],
    ) == (True, 2, 7, [])
    assert harvest[1]["lost_seconds"]
    assert fork["lost_seconds"] == {}, "the optimum is that of two carriers from the beginning on"
    stopped = "--at", "2:00", "--stop", "picker_02", "--duration", 130
    orchard("fork", "last", *stopped, "--mode", "local", "--record", "none", "--summary", path)
    assert 1000 < summary_of(path)["ticks"] < 1310
    orchard(
        "fork", "last", "--at", "2:05", "--duration", 126, "--mode", "local", "--record", "none"
    )
    assert summary_of(path)["stopped_seconds"] == {"picker_02": 10.0}


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_resumed_stopped_and_killed_runs_can_be_forked(tmp_path, end):
    file = scenario_file(tmp_path, SMALL)
    path = tmp_path / "fork.json"
    with running(
        file, "--mode", "local", "--speed", 20, "--keyframes", 5, "--record", "none"
    ) as run:
        wait_until_simulated(run, 11.0)
        (folder,) = runs_folder().glob(f"*-{run.pid}.snapshots")
        orchard(
            "fork",
            folder,
            "--at",
            7,
            "--mode",
            "local",
            "--duration",
            12,
            "--record",
            "none",
            "--summary",
            path,
        )
        assert summary_of(path)["hash"] == local_hash(SMALL, 120)
        run.send_signal(end)
        run.communicate(timeout=PATIENCE)
    orchard(
        "fork",
        folder.stem,
        "--at",
        "0:08",
        "--mode",
        "local",
        "--duration",
        12,
        "--record",
        "none",
        "--summary",
        path,
    )
    assert summary_of(path)["hash"] == local_hash(SMALL, 120)


def test_the_commands_of_the_documents_about_forks_work(harvest, tmp_path):
    """They fork a run, compare its futures, and find until when a change would have helped."""
    one, compared, bisected = (
        shlex.split(line)[3:] for line in block("docs/how-to.md", "fork a run").splitlines()
    )
    path = tmp_path / "found.json"
    picture = tmp_path / "futures.svg"
    orchard("fork", harvest[0], *one, "--mode", "local", "--record", "none", "--summary", path)
    gained = harvest[1]["sim_seconds"] - summary_of(path)["sim_seconds"]
    assert gained > 0.0
    told = orchard("fork", harvest[0], *compared, "--summary", path).stdout
    assert (
        f"With carriers=2 the harvest ends {clock(round(10 * gained))} ± 0:00 min earlier (one pair"
        " of futures)." in told
    )
    futures = summary_of(path)["futures"]
    assert [len(some) for some in futures.values()] == [1, 1]
    assert futures["as it was"][0]["sim_seconds"] == harvest[1]["sim_seconds"]
    limit = harvest[1]["sim_seconds"] - gained / 2.0
    asked = [
        word.replace("500", str(limit)).replace("futures.svg", str(picture)) for word in bisected
    ]
    told = orchard("fork", harvest[0], *asked, "--summary", path).stdout
    found = summary_of(path)
    decided = found["decided_seconds"]
    assert f": decided after {clock(round(10 * decided))}: the future ends well" in told
    ends = {
        float(at): any(one["sim_seconds"] <= limit for one in some)
        for at, some in found["futures"].items()
    }
    assert max(at for at, well in ends.items() if well) == decided
    assert min(at for at in ends if at > decided) - decided <= 1.0
    assert "end well, %" in picture.read_text()


def test_an_added_carrier_has_a_slow_error_from_the_first():
    run = Local(with_changes(TWO_WAY, carriers=2, queue_room=3, **{"sensors.gnss.bias": 0.02}))
    for _ in range(20):
        run.tick()
    before = run.engine.world
    after = run.fork(carriers=3).engine.world
    assert after.bias[after.index["carrier_03"]].any()
    assert (after.bias[after.index["carrier_02"]] == before.bias[before.index["carrier_02"]]).all()


@pytest.mark.parametrize("at", ["4:20", "4:27"])
def test_the_last_of_many_moments_is_tried_too(harvest, at):
    """The last of many moments is tried too also where nothing was kept."""
    told = orchard(
        "fork", harvest[0], "--bisect", "bins_per_hour<0.1", "--at", at, "--futures", 1
    ).stdout
    assert f"not decided: the future ends well from {at}, the last moment." in told


def test_a_future_that_is_cut_off_tells_no_end(harvest):
    """A future that duration cuts off tells nothing of when the harvest ends."""
    told = orchard(
        "fork", harvest[0], "--at", 60, "--futures", 1, "--stop", "picker_02", "--duration", 70
    ).stdout
    assert "With picker_02 stopped no pair of futures is harvested to its end." in told


def test_carriers_are_never_busier_than_all_the_time():
    run = WatchedRun(Local(TWO_WAY).snapshot())
    run.go_on(2200)  # two of three carriers are back in the queue
    fewer = WatchedRun(forked(run.snapshot(), {"carriers": 1}))
    assert (
        0.5
        < fewer.figures.figures()["carrier_utilisation"]
        == run.figures.figures()["carrier_utilisation"]
        < 1.0
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--at", "90:00"], r"parent.snapshots: 90:00 is after the end of the run, at \d:\d\d"),
        (["--at", "1:75"], "--at: 1:75: expected a simulated time, in s or as M:SS or H:MM:SS"),
        (["--at", "1:75:00"], "--at: 1:75:00: expected a simulated time"),
        (["--at", 60, "--set", "carriers"], "--set carriers: expected KEY=VALUE"),
        (
            ["--at", 60, "--set", "dispatch=+1"],
            "--set dispatch: it has no number to which something can be added",
        ),
        (
            ["--at", 60, "--set", "carriers=2", "--set", "carriers=3"],
            "--set carriers=3: carriers is given twice; once is allowed",
        ),
        (["--at", 60, "--rows", 5], "command line: rows = 5: cannot change under way"),
        (["--at", 60, "--stop", "robot"], "robot"),
        (
            ["--at", 60, "--set", "dispatch=nosuch.Thing"],
            "command line: dispatch = nosuch.Thing: cannot be used: ModuleNotFoundError",
        ),
        (
            ["--at", 60, "--futures", 2, "--set", "seed=4"],
            "--set seed: each future has a seed of its own; change something else",
        ),
        ([], "--at: is missing: the moment at which the fork begins"),
        (
            ["--at", 60, "--futures", 2, "--seed", 3],
            "--futures: leave out --seed: each future is a run of its own, in local mode",
        ),
        (
            ["--bisect", "jam", "--view", "--web", 9090],
            "--bisect: leave out --view, --web: each future is a run of its own, in local mode",
        ),
        (
            ["--at", 60, "--futures", 2, "--stop", "picker"],
            "--duration: is missing: a harvest does not end while robots stand",
        ),
        (
            ["--at", 60, "--stop", "picker_02"],
            "--duration: is missing: a harvest does not end while robots stand: picker_02",
        ),
        (
            ["--at", 60, "--stop", "picker_02", "--mode", "lockstep"],
            "--duration: is missing: a harvest does not end while robots stand",
        ),
        (["--at", 60, "--duration", 60], "--duration: the run would end before --at"),
        (
            ["--bisect", "jam", "--picture", "futures.txt"],
            "^--picture: futures.txt: a picture's name ends in .svg or .png",
        ),
        (
            ["--at", 60, "--futures", 2, "--picture", "futures.svg"],
            "--picture: it shows the futures of --bisect: give that, too",
        ),
        (
            ["--bisect", "jams"],
            "--bisect jams: expected jam, collision, or a figure of the summary",
        ),
        (
            ["--bisect", "speed<3"],
            "--bisect speed<3: expected jam, collision, or a figure of the summary",
        ),
    ],
)
def test_a_fork_that_cannot_be_is_told_in_words(harvest, words, told):
    quick = (
        []
        if {"--futures", "--bisect", "--mode"} & {*words}
        else ["--mode", "local", "--record", "none"]
    )
    assert re.search(told, orchard("fork", harvest[0], *words, *quick, code=2).stderr)


def test_moments_that_cannot_be_are_told(harvest, tmp_path):
    """Moments without a keyframe damaged ones and runs that are not there are told."""
    folder = tmp_path / "copy.snapshots"
    folder.mkdir()
    for file in harvest[0].with_suffix(".snapshots").iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / f"tick-000000600{KEYFRAME}").write_bytes(b"torn")
    quick = "--mode", "local", "--record", "none", "--duration", 62
    assert (
        f"not used: {folder}/tick-000000600.keyframe: not a snapshot"
        in orchard("fork", folder, "--at", 61, *quick).stderr
    )
    (folder / f"tick-000000400{KEYFRAME}").write_bytes(b"torn")
    assert "its own agents" not in orchard("fork", folder, "--at", 30, *quick).stderr
    for tick in (0, 200, 400):
        (folder / f"tick-{tick:09d}{KEYFRAME}").unlink()
    assert (
        "no keyframe up to 0:30; its first one is at 1:00"
        in orchard("fork", folder, "--at", 30, *quick, code=2).stderr
    )
    assert (
        "no keyframe up to 0:30; its first one is at 1:00"
        in orchard("fork", folder, "--bisect", "jam", "--at", 30, code=2).stderr
    )
    assert (
        "nowhere: no snapshots of such a run"
        in orchard("fork", "nowhere", "--at", 30, *quick, code=2).stderr
    )


def test_a_run_with_a_stop_between_keyframes_is_told(tmp_path):
    """A run in which a robot was stopped between two keyframes is told."""

    def keep(run: Local) -> None:
        name, content = as_file(run.snapshot())
        store(name.replace(SNAPSHOT, KEYFRAME), content, tmp_path)

    local = played(SMALL, 200)
    keep(local)
    local.engine.stop(["picker_01"])
    keep(played(local, 300))
    done = orchard(
        "fork", tmp_path, "--at", 25, "--mode", "local", "--record", "none", "--duration", 26
    )
    assert "after 0:20 the run was not left to its own agents" in done.stderr


def test_a_fork_says_which_agents_were_clients_elsewhere(tmp_path):
    """A fork says which agents were clients elsewhere and lets those of the scenario begin anew."""
    snapshot = played(SMALL, 200).snapshot()
    snapshot.elsewhere = ["picker_01"]
    snapshot.memories["picker_01"] = pack(["of another program"])
    name, content = as_file(snapshot)
    store(name.replace(SNAPSHOT, KEYFRAME), content, tmp_path)
    path = tmp_path / "fork.json"
    words = ("fork", tmp_path, "--at", 22, "--mode", "local", "--record", "none", "--duration", 40)
    told = orchard(*words, "--summary", path).stderr
    assert (
        "clients elsewhere drove picker_01: here the agents of the scenario do; --without leaves"
        " them to clients again" in told
    )
    assert summary_of(path)["broken_agents"] == []


@given(st.integers(0, 10**7))
def test_a_moment_is_read_as_it_is_written(tick):
    assert moment(clock(tick)) == tick
    assert moment(f"2:{clock(tick % 36_000).rjust(5, '0')}") == 72_000 + tick % 36_000
