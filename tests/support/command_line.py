"""run.py for tests, as a person uses it; what it imports is there already (`forked_processes.py`). `tests/docs` starts it as it stands."""

import json
import os
import subprocess
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
from forked_processes import Forked

ROOT = Path(__file__).parents[2]
SECONDS = 240.0  # that any one run may take on a busy machine


def orchard(*arguments: object, seconds: float = SECONDS) -> subprocess.CompletedProcess:
    """Run it to its end."""
    words = [*map(str, arguments)]
    process = Forked("run", words, os.environ | {"COLUMNS": "200"})
    out, err = process.communicate(timeout=seconds)
    return subprocess.CompletedProcess(["run.py", *words], process.returncode, out, err)


def line_with(words: str, process: subprocess.Popen | Forked) -> str:
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
    process = Forked("run", [*map(str, arguments)], {**os.environ}, leads=True)
    try:
        yield process
    finally:
        with suppress(psutil.NoSuchProcess):  # it has just ended
            for child in [*psutil.Process(process.pid).children(recursive=True)] if process.poll() is None else []:
                child.kill()
        process.kill()
        with suppress(ValueError):  # the test has read it to its end
            process.communicate()


def wait_until_simulated(run: subprocess.Popen | Forked, seconds: float) -> None:
    """Read its lines of progress until so much time has been simulated."""
    assert any(float(line.split(" s ")[0]) >= seconds for line in run.stdout if "real time" in line)


def summary_of(path: Path) -> dict:
    return json.loads(path.read_text())
