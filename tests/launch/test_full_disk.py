"""A disk that is full loses what goes there, and says so, but neither the harvest nor its
result.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import ROOT, summary_of
from local_runs import local_hash
from patience import PATIENCE

from orchard.field.scenario import Scenario

# Simulated s. The scenery alone, which is recorded first, is larger than the disk of 400 kB.
DURATION = 40.0
# Simulated s, where nothing is recorded.
SHORT = 5.0
FULL = "No space left on device"


@pytest.fixture
def small_disk(tmp_path):
    """Mount a disk that is soon full."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "none", disk], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("this machine mounts no disk for a test")
    try:
        yield disk
    finally:
        subprocess.run(["umount", "--lazy", disk], check=True)


def harvest(
    disk: Path, seconds: float, *arguments: object, **streams: object
) -> subprocess.CompletedProcess:
    """Harvest on a disk. Return the process that has ended."""
    scenario = ROOT / "config" / "orchard.yaml"
    command = [
        sys.executable,
        ROOT / "run.py",
        scenario,
        "--rows",
        3,
        "--duration",
        seconds,
        *arguments,
    ]
    environment = os.environ | {"COLUMNS": "200", "ORCHARD_RUNS": str(disk / "runs")}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    return subprocess.run(
        list(map(str, command)), cwd=disk, text=True, timeout=PATIENCE, env=environment, **streams
    )


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_a_full_disk_loses_recordings_but_not_the_result(small_disk, tmp_path, mode):
    """A line says that the recording is lost, and another one that the snapshots are."""
    path = tmp_path / "summary.json"
    # Enough that snapshots follow after the recording has filled the disk.
    slow = "--speed", 10
    done = harvest(small_disk, DURATION, "--mode", mode, "--summary", path, *slow)
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert summary_of(path)["hash"] == local_hash(Scenario(rows=3), round(DURATION * 10))
    assert summary_of(path)["hash"] in done.stdout
    for words in ("the rest of the run is not recorded", "a snapshot could not be written"):
        (line,) = [line for line in output.splitlines() if words in line]
        assert FULL in line
    assert "starting it again" not in output
    assert "Traceback" not in output
    left = [
        file.name
        for file in (small_disk / "runs").rglob("*")
        if file.suffix == ".new" or ".packed" in file.name
    ]
    assert left == []


def test_a_log_that_fills_its_disk_ends_no_run(small_disk, tmp_path):
    """/dev/full takes nothing, as a full disk does. What cannot go to stdout goes to stderr."""
    path = tmp_path / "summary.json"
    with open("/dev/full", "w") as full:
        done = harvest(
            small_disk, SHORT, "--mode", "local", "--record", "none", "--summary", path, stdout=full
        )
    hash_ = local_hash(Scenario(rows=3), round(SHORT * 10))
    assert done.returncode == 0, done.stderr
    assert summary_of(path)["hash"] == hash_
    assert done.stderr.count(f"stdout cannot be written: {FULL}") == 1
    assert hash_ in done.stderr


def test_the_summary_is_written_where_nothing_can_be_printed(small_disk, tmp_path):
    path = tmp_path / "summary.json"
    with open("/dev/full", "w") as full:
        done = harvest(
            small_disk, SHORT, "--record", "none", "--summary", path, stdout=full, stderr=full
        )
    assert done.returncode == 1, "the result was printed nowhere"
    assert summary_of(path)["hash"] == local_hash(Scenario(rows=3), round(SHORT * 10))


def test_a_pipe_that_is_closed_early_ends_nothing():
    """With `| head` the pipe closes early, and a study must still write its files."""
    program = (
        "import sys; from orchard.terminal.output import console; "
        "console.print('a'); print('goes on', file=sys.stderr); console.end()"
    )
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as closed:
        done = subprocess.run(
            [sys.executable, "-c", program],
            cwd=ROOT,
            stdout=closed,
            stderr=subprocess.PIPE,
            text=True,
            timeout=PATIENCE,
        )
    assert done.returncode == 0
    assert (
        done.stderr
        == "stdout cannot be written: Broken pipe; the run goes on without it\ngoes on\n"
    )


def test_unprinted_output_does_not_change_the_exit_code():
    """Python by itself would end with code 120 if output at its end cannot be printed."""
    program = "from orchard.terminal.output import console; print('a line'); console.end()"
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-c", program]
        streams = {"stdout": full, "stderr": subprocess.PIPE}
        done = subprocess.run(
            command, cwd=ROOT, **streams, text=True, timeout=PATIENCE, env=buffered
        )
    assert done.returncode == 0
    assert done.stderr == ""
