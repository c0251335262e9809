"""run.py for tests, as a person uses it."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import psutil

ROOT = Path(__file__).parent.parent
SECONDS = 240.0  # that any one run may take on a busy machine


def orchard(*arguments: object, seconds: float = SECONDS) -> subprocess.CompletedProcess:
    """Run it to its end."""
    command = [sys.executable, "run.py", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, env=os.environ | {"COLUMNS": "200"})


def line_with(words: str, process: subprocess.Popen) -> str:
    """The first line of what it prints that has these words; it says other things before, as that it compiles."""
    said = []
    for line in process.stdout:
        said.append(line)
        if words in line:
            return line
    raise AssertionError(f"it never said {words!r}, but {''.join(said)}")


@contextmanager
def running(*arguments: object):
    """Run it, until its first line of progress; nothing is left behind."""
    with starting(*arguments) as process:
        line_with("real time", process)
        yield process


@contextmanager
def starting(*arguments: object):
    """Run it; nothing is left behind."""
    command = [sys.executable, "-u", "run.py", *map(str, arguments)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        yield process
    finally:
        for child in [*psutil.Process(process.pid).children(recursive=True)] if process.poll() is None else []:
            child.kill()
        process.kill()
        process.communicate()


def wait_until_simulated(run: subprocess.Popen, seconds: float) -> None:
    """Read its lines of progress until so much time has been simulated."""
    assert any(float(line.split(" s ")[0]) >= seconds for line in run.stdout if "real time" in line)


def summary_of(path: Path) -> dict:
    return json.loads(path.read_text())
