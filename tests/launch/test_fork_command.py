"""The command `orchard fork`: what it prints and writes, and what it refuses in words.

A fork goes on from a moment of a run. With `--futures` it goes on several times, each time with
another seed, as it was and with a change. With `--bisect` it searches for the last moment from
which the futures still end well.
"""

import re
import shlex
import signal

import pytest
from code_blocks import block
from command_line import orchard, running, scenario_file, summary_of, wait_until_simulated
from hypothesis import given
from hypothesis import strategies as st
from local_runs import SHORT, SMALL, local_hash, played
from patience import PATIENCE

from orchard.contract.messages import pack
from orchard.folders import runs_folder
from orchard.local import Local
from orchard.sim.snapshot import KEYFRAME, SNAPSHOT, as_file, store, ticks_of
from orchard.terminal.values import clock, moment

LOCAL = ("--mode", "local", "--record", "none")


@pytest.fixture(scope="module")
def harvest(tmp_path_factory):
    """Harvest with many processes and a keyframe every 20 s. Return the recording and the summary.

    A keyframe is a snapshot that stays after the run, so that it can be forked.
    """
    folder = tmp_path_factory.mktemp("harvest")
    recording = runs_folder() / "parent.rrd"
    summary = folder / "parent.json"
    options = ("--hosts", 1, "--keyframes", 20, "--record", recording, "--summary", summary)
    orchard(scenario_file(folder, SHORT), *options)
    return recording, summary_of(summary)


def test_keyframes_stay_and_an_unchanged_fork_has_the_hash(harvest, tmp_path):
    """A fork of many processes without changes has the hash of its parent, and nearly all figures.

    There is a keyframe every 20 s, so every 200 ticks.
    """
    recording, parent = harvest
    ticks = ticks_of(recording.with_suffix(".snapshots"))
    assert ticks == list(range(0, parent["ticks"], 200))
    path = tmp_path / "fork.json"
    table = tmp_path / "tables"
    outputs = ("--record", tmp_path / "f.rrd", "--summary", path, "--table", table)
    done = orchard("fork", recording, "--at", "1:23.5", "--hosts", 2, *outputs)
    fork = summary_of(path)
    assert fork["hash"] == parent["hash"]
    may_differ = {
        "hosts",
        "wall_seconds",
        "times_real_time",
        "asked_share",
        "messages_refused",
        "recording_parts",
        "recording_gaps",
        "forked_from",
    }
    for figure in set(fork) - may_differ:
        assert fork[figure] == parent[figure], figure
    # 1:23.5 min are 83.5 s. The first picture is that of the tick after.
    assert fork["forked_from"] == {"run": "parent", "seconds": 83.5}
    assert fork["recording_gaps"] == [[0.0, 83.6]], "its recording begins with it"
    assert f"hash {parent['hash']}" in done.stdout


def test_a_fork_is_a_run_of_its_own_that_can_be_forked_again(harvest, tmp_path):
    """The fork of the fork begins at 120 s and ends after 130 s, so picker_02 stands for 10 s."""
    recording, parent = harvest
    path = tmp_path / "fork.json"
    to_path = (*LOCAL, "--summary", path)
    orchard("fork", recording, "--at", 60, "--set", "carriers=+1", "--seed", 7, *to_path)
    fork = summary_of(path)
    assert fork["finished"]
    assert fork["scenario"]["carriers"] == 2
    assert fork["scenario"]["seed"] == 7
    assert fork["violations"] == []
    # What a harvest loses is known against the optimum, and that of the fork would need two
    # carriers from the beginning on.
    assert parent["lost_seconds"]
    assert fork["lost_seconds"] == {}

    stopped = ("--at", "2:00", "--stop", "picker_02", "--duration", 130)
    orchard("fork", "last", *stopped, *to_path)
    assert 1000 < summary_of(path)["ticks"] < 1310
    orchard("fork", "last", "--at", "2:05", "--duration", 126, *LOCAL)
    assert summary_of(path)["stopped_seconds"] == {"picker_02": 10.0}


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_resumed_stopped_and_killed_runs_can_be_forked(tmp_path, end):
    """The first fork is made while its parent still runs, the second when it has ended."""
    file = scenario_file(tmp_path, SMALL)
    path = tmp_path / "fork.json"
    to_path = ("--duration", 12, *LOCAL, "--summary", path)
    with running(file, "--speed", 20, "--keyframes", 5, *LOCAL) as run:
        wait_until_simulated(run, 11.0)
        (folder,) = runs_folder().glob(f"*-{run.pid}.snapshots")
        orchard("fork", folder, "--at", 7, *to_path)
        assert summary_of(path)["hash"] == local_hash(SMALL, 120)
        run.send_signal(end)
        run.communicate(timeout=PATIENCE)
    orchard("fork", folder.stem, "--at", "0:08", *to_path)
    assert summary_of(path)["hash"] == local_hash(SMALL, 120)


def test_the_commands_of_the_documents_about_forks_work(harvest, tmp_path):
    """The document forks a run, compares futures, and asks until when a change would have helped.

    The words of its three commands after `orchard fork RUN` are used for the harvest of this file,
    with another limit than the 500 s of the document.
    """
    recording, parent = harvest
    lines = block("docs/how-to.md", "fork a run").splitlines()
    forked_once, compared, bisected = (shlex.split(line)[3:] for line in lines)
    path = tmp_path / "summary.json"

    orchard("fork", recording, *forked_once, *LOCAL, "--summary", path)
    gained_seconds = parent["sim_seconds"] - summary_of(path)["sim_seconds"]
    assert gained_seconds > 0.0

    out = orchard("fork", recording, *compared, "--summary", path).stdout
    gained = clock(round(10 * gained_seconds))
    assert (
        f"With carriers=2 the harvest ends {gained} ± 0:00 min earlier (one pair of futures)."
    ) in out
    as_it_was, changed = summary_of(path)["futures"].values()
    assert len(as_it_was) == len(changed) == 1
    assert summary_of(path)["futures"]["as it was"][0]["sim_seconds"] == parent["sim_seconds"]
    assert_is_expected_first(out, summary_of(path)["futures"], summary_of(path)["expected_futures"])

    # A future ends well if it gains half of what the change gains from the beginning on.
    limit = parent["sim_seconds"] - gained_seconds / 2.0
    picture = tmp_path / "futures.svg"
    words = [
        word.replace("500", str(limit)).replace("futures.svg", str(picture)) for word in bisected
    ]
    out = orchard("fork", recording, *words, "--summary", path).stdout
    summary = summary_of(path)
    decided = summary["decided_seconds"]
    assert f": decided after {clock(round(10 * decided))}: the future ends well" in out

    # The last moment from which a future ends well is the decided one, and the next moment that was
    # tried is at most 1 s later.
    moments = [float(at) for at in summary["futures"]]
    well = []
    for at, futures in summary["futures"].items():
        if any(future["sim_seconds"] <= limit for future in futures):
            well.append(float(at))
    assert max(well) == decided
    assert min(at for at in moments if at > decided) - decided <= 1.0
    assert "end well, %" in picture.read_text()


def assert_is_expected_first(out, futures, expected):
    """Assert that the event model answered before the simulator, and nearly the same."""
    words = "Expected by the event model: With carriers=2 the harvest ends"
    assert out.index(words) < out.index("\nWith carriers=2 the harvest ends")
    assert "expected to end at, s" in out
    for branch, simulated in futures.items():
        end = simulated[0]["sim_seconds"]
        assert expected[branch][0]["sim_seconds"] == pytest.approx(end, abs=2.0)


@pytest.mark.parametrize("at", ["4:20", "4:27"])
def test_the_last_of_many_moments_is_tried_too(harvest, at):
    """The harvest ends soon after 4:27 min, and its last keyframe is at 4:20 min.

    Every harvest delivers more than 0.1 bins an hour, so each future ends well.
    """
    words = ("--bisect", "bins_per_hour<0.1", "--at", at, "--futures", 1)
    out = orchard("fork", harvest[0], *words).stdout
    assert f"not decided: the future ends well from {at}, the last moment." in out


def test_a_future_that_is_cut_off_tells_no_end(harvest):
    """Such a future is not expected either: the event model tells ends only."""
    words = ("--at", 60, "--futures", 1, "--stop", "picker_02", "--duration", 70)
    out = orchard("fork", harvest[0], *words).stdout
    assert "With picker_02 stopped no pair of futures is harvested to its end." in out
    assert "xpected" not in out


# The options of a fork, and words of the error.
@pytest.mark.parametrize(
    ("words", "error"),
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
def test_a_fork_that_cannot_be_is_told_in_words(harvest, words, error):
    # A fork in local mode starts no processes, so the test is quick.
    may_be_local = not {"--futures", "--bisect", "--mode"} & {*words}
    mode = LOCAL if may_be_local else ()
    assert re.search(error, orchard("fork", harvest[0], *words, *mode, code=2).stderr)


def test_moments_that_cannot_be_are_told(harvest, tmp_path):
    """Keyframes are removed or damaged, and a fork of a run that is not there is refused.

    There is one every 20 s, so at ticks 0, 200, 400, 600. An earlier one takes the place of a
    damaged one.
    """
    folder = tmp_path / "copy.snapshots"
    folder.mkdir()
    for file in harvest[0].with_suffix(".snapshots").iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / f"tick-000000600{KEYFRAME}").write_bytes(b"torn")
    quick = (*LOCAL, "--duration", 62)
    err = orchard("fork", folder, "--at", 61, *quick).stderr
    assert f"not used: {folder}/tick-000000600.keyframe: not a snapshot" in err

    (folder / f"tick-000000400{KEYFRAME}").write_bytes(b"torn")
    assert "its own agents" not in orchard("fork", folder, "--at", 30, *quick).stderr

    for tick in (0, 200, 400):
        (folder / f"tick-{tick:09d}{KEYFRAME}").unlink()
    no_keyframe = "no keyframe up to 0:30; its first one is at 1:00"
    assert no_keyframe in orchard("fork", folder, "--at", 30, *quick, code=2).stderr
    bisected = ("--bisect", "jam", "--at", 30)
    assert no_keyframe in orchard("fork", folder, *bisected, code=2).stderr

    err = orchard("fork", "nowhere", "--at", 30, *quick, code=2).stderr
    assert "nowhere: no snapshots of such a run" in err


def test_a_run_with_a_stop_between_keyframes_is_told(tmp_path):
    """A fork goes on from the keyframe at 20 s to 25 s as if the robot had not been stopped there.

    The next keyframe shows that it was, so a line says that the moment is not that of the run.
    """

    def keep(run: Local) -> None:
        name, content = as_file(run.snapshot())
        store(name.replace(SNAPSHOT, KEYFRAME), content, tmp_path)

    local = played(SMALL, 200)
    keep(local)
    local.engine.stop(["picker_01"])
    keep(played(local, 300))
    done = orchard("fork", tmp_path, "--at", 25, "--duration", 26, *LOCAL)
    assert "after 0:20 the run was not left to its own agents" in done.stderr


def test_a_fork_says_which_agents_were_clients_elsewhere(tmp_path):
    """Another program drove picker_01, and its memory is nothing that a picker can read.

    The fork says so, and lets the scenario's own agent begin anew.
    """
    snapshot = played(SMALL, 200).snapshot()
    snapshot.elsewhere = ["picker_01"]
    snapshot.memories["picker_01"] = pack(["of another program"])
    name, content = as_file(snapshot)
    store(name.replace(SNAPSHOT, KEYFRAME), content, tmp_path)
    path = tmp_path / "fork.json"
    words = ("--at", 22, "--duration", 40, *LOCAL, "--summary", path)
    err = orchard("fork", tmp_path, *words).stderr
    assert (
        "clients elsewhere drove picker_01: here the agents of the scenario do; --without leaves"
        " them to clients again"
    ) in err
    assert summary_of(path)["broken_agents"] == []


@given(st.integers(0, 10**7))
def test_a_moment_is_read_as_it_is_written(tick):
    """As M:SS, and with hours as H:MM:SS. An hour has 36,000 ticks."""
    assert moment(clock(tick)) == tick
    in_the_hour = tick % 36_000
    with_minutes = clock(in_the_hour).rjust(len("0:00") + 1, "0")
    assert moment(f"2:{with_minutes}") == 2 * 36_000 + in_the_hour
