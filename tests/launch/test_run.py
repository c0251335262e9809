"""run.py as a person uses it: one command, real processes."""

import json
import re
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest
from command_line import orchard, running, scenario_file, summary_of, wait_until_simulated
from local_runs import SMALL, driven_by, local_hash
from patience import PATIENCE
from recordings import seconds_of

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

# s, simulated. Rows of 30 m are picked at 1 m/s, so two bins are full by 31 s, and a carrier brings
# an empty one.
FIRST_CALLS = 45
# s, simulated. With seeds 1 to 5 the first bin of 3 rows and 2 pickers is unloaded before.
FIRST_UNLOADING = 300
# An orchard in which several carriers offer themselves for a bin that calls.
FEW = SMALL.model_copy(update={"pickers": 3, "carriers": 3, "row_length": 30.0})
# Figures of the summary that tell how a run was carried out, and not what happened in it.
OF_THE_MODE = {
    "mode",
    "hosts",
    "wall_seconds",
    "times_real_time",
    "recording_parts",
    "recording_gaps",
    "messages_dropped",
}


@dataclass(frozen=True)
class HarvestRun:
    """What a harvest has left: its summary, its recording, and what it has printed."""

    summary: dict[str, Any]
    recording: Path
    printed: str


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Return the file of the scenario FEW."""
    return scenario_file(tmp_path_factory.mktemp("few"), FEW)


def processes_of(run: subprocess.Popen) -> list[psutil.Process]:
    """Return the processes of a run beside `run.py` itself."""
    children = psutil.Process(run.pid).children(recursive=True)
    return [
        child
        for child in children
        if any(word.startswith("orchard.processes.") for word in child.cmdline())
    ]


def run_as_in_local_mode(folder, scenario, seconds, *words):
    """Run `orchard` for some seconds. Return its summary.

    Its hash must be that of a run of `scenario` in this process.
    """
    path = folder / "summary.json"
    orchard("--record", "none", "--duration", seconds, "--summary", path, *words)
    summary = summary_of(path)
    assert summary["hash"] == local_hash(scenario, seconds * 10)
    return summary


@pytest.fixture(scope="module")
def local(tmp_path_factory, few):
    """Harvest FEW in local mode. Return the summary."""
    path = tmp_path_factory.mktemp("local") / "summary.json"
    orchard(few, "--mode", "local", "--record", "none", "--summary", path)
    return summary_of(path)


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory, few):
    """Harvest FEW in lockstep. Return what the harvest has left."""
    folder = tmp_path_factory.mktemp("lockstep")
    done = orchard(few, "--record", folder / "run.rrd", "--summary", folder / "summary.json")
    return HarvestRun(summary_of(folder / "summary.json"), folder / "run.rrd", done.stdout)


def test_a_harvest_in_lockstep_is_that_of_local_mode(local, lockstep):
    assert lockstep.summary["hash"] == local["hash"]
    assert what_happened(local) == what_happened(lockstep.summary)


def what_happened(summary):
    """Return the figures that do not depend on the mode."""
    return {name: value for name, value in summary.items() if name not in OF_THE_MODE}


def test_the_summary_tells_how_good_the_harvest_was(lockstep):
    summary = lockstep.summary
    assert summary["finished"] is True
    assert summary["rows_picked"] == summary["bins_delivered"] == summary["rows"] == 3
    assert summary["ticks"] == pytest.approx(10 * summary["sim_seconds"])
    assert 0 < summary["bins_per_hour"] <= summary["limit_bins_per_hour"]
    assert 0 < summary["schedule_sim_seconds"] <= summary["sim_seconds"]
    assert summary["bottleneck"] in ("pickers", "carriers", "unloading")
    assert 0 < summary["carrier_utilisation"] < 1
    assert 5 < summary["picker_waiting_seconds"] < 300, (
        "an exchange takes some seconds, even if the carrier is there"
    )
    assert summary["distance_metres"]["picker"] > 3 * 30
    assert {
        "hash",
        "mode",
        "seed",
        "wall_seconds",
        "agents",
        "hosts",
        "weeds_flattened",
    } <= summary.keys()
    assert {"collisions", "collisions_of_people_and_animals"} <= summary.keys()
    assert "What limits it: " in lockstep.printed
    assert "To try next: " in lockstep.printed
    assert summary["hash"] in lockstep.printed


def test_the_hash_is_last_after_the_command_to_open_it(lockstep):
    watch_line, hash_line = lockstep.printed.strip().splitlines()[-2:]
    assert hash_line == f"hash {lockstep.summary['hash']}"
    assert re.fullmatch(r"To watch it: \S+ run\.py view \S+", watch_line)
    assert watch_line.endswith(str(lockstep.recording))


def test_the_recording_holds_the_whole_run(lockstep):
    summary = lockstep.summary
    assert seconds_of(lockstep.recording) == pytest.approx(summary["sim_seconds"], abs=1.0)
    lacks = {key: summary[key] for key in ("recording_parts", "recording_gaps", "messages_dropped")}
    assert lacks == {"recording_parts": ["run.rrd"], "recording_gaps": [], "messages_dropped": 0}


def test_progress_is_json_for_programs_in_every_mode():
    for mode in ("local", "lockstep"):
        words = ["--rows", 3, "--mode", mode, "--hosts", 1, "--speed", 10, "--duration", 10]
        done = orchard(*words, "--record", "none", "--progress", "json")
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        assert lines and all(json.loads(line)["progress"]["rows"] == 3 for line in lines), (
            done.stdout
        )


def test_the_hash_does_not_depend_on_processes(tmp_path, few):
    """Each agent has a process of its own here.

    `make soak` tries more seeds and numbers of processes, also with a recording.
    """
    second_seed = FEW.model_copy(update={"seed": 2})
    words = [few, "--seed", 2, "--hosts", "each"]
    summary = run_as_in_local_mode(tmp_path, second_seed, FIRST_CALLS, *words)
    assert summary["hosts"] == len(lay_out(FEW).agents)
    assert summary["rows_picked"] >= 2, "carriers come"


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("hosts", [1, 2, 5, "each"])
@pytest.mark.parametrize("record", [True, False])
def test_soak_the_hash_does_not_depend_on_processes(tmp_path, hosts, seed, record):
    recording = tmp_path / "run.rrd" if record else "none"
    words = ["--rows", 3, "--seed", seed, "--hosts", hosts, "--record", recording]
    scenario = Scenario(rows=3, seed=seed)
    summary = run_as_in_local_mode(tmp_path, scenario, FIRST_UNLOADING, *words)
    assert summary["bins_delivered"] >= 1


def test_ctrl_c_stops_everything_and_closes_the_recording(tmp_path):
    recording = tmp_path / "run.rrd"
    with running("--rows", 3, "--record", recording, "--speed", 8) as run:
        children = processes_of(run)
        assert len(children) == 4, "physics, two hosts of agents, logger"
        wait_until_simulated(run, 1.0)
        run.send_signal(signal.SIGINT)
        printed, _ = run.communicate(timeout=PATIENCE)
        assert run.returncode == 0
        assert not any(
            child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children
        )
    assert "To watch it" in printed
    assert seconds_of(recording) > 0.5
    folder = re.search(r"To go on: .* --resume (\S+)", printed).group(1)
    run_as_in_local_mode(tmp_path, Scenario(rows=3), 30, "--resume", folder, "--mode", "local")


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_a_run_whose_pickers_are_all_broken_ends_at_once(tmp_path, mode):
    """The class `Unmakeable` of the pickers raises an error when it is made. The run ends after the
    first second.
    """
    scenario = scenario_file(tmp_path, driven_by(picker="Unmakeable"))
    path = tmp_path / "summary.json"
    done = orchard(
        scenario, "--mode", mode, "--record", "none", "--summary", path, "--duration", 60, code=1
    )
    assert summary_of(path)["ended"] == "broken"
    assert summary_of(path)["ticks"] == 10
    assert "Ended because all pickers were broken, after 0:01 min" in done.stdout
    assert "broken: picker_01, since tick 0" in done.stderr
