"""run.py for tests, as a person uses it.

It is forked from a process that has imported its modules (`forked_processes.py`), so it starts
fast. Only the test of the tutorial, in `tests/docs`, starts it as a user does.
"""

import json
import os
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
from forked_processes import PATHS, ROOT, Forked
from patience import PATIENCE

from orchard.field.scenario import Scenario, to_yaml

# Where own agents and policies of the tests are found.
PATH = os.pathsep.join(PATHS)


def orchard(
    *arguments: object, code: int | None = 0, seconds: float = PATIENCE, folder: Path = ROOT
) -> subprocess.CompletedProcess:
    """Run `orchard` in a folder to its end, which must have this exit code; None: any.

    The processes that it starts are forked, too. Code 2 is a user's mistake, and must end without a
    traceback.
    """
    words = [*map(str, arguments)]
    # In narrow terminals Rich breaks lines, and tests would not find their words.
    process = Forked(
        "run", words, os.environ | {"COLUMNS": "200", "PYTHONPATH": PATH}, forks=True, folder=folder
    )
    out, err = process.communicate(timeout=seconds)
    assert code in (process.returncode, None), out + err
    assert code != 2 or "Traceback" not in err, err
    return subprocess.CompletedProcess(["run.py", *words], process.returncode, out, err)


def python(
    *words: object, code: int = 0, cwd: Path = ROOT, seconds: float = PATIENCE, **environment: str
) -> subprocess.CompletedProcess:
    """Run a Python program to its end, which must have this exit code."""
    there = os.environ | {"COLUMNS": "200"} | environment
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env=there,
        capture_output=True,
        text=True,
        timeout=seconds,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def scenario_file(folder: Path, scenario: Scenario) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(to_yaml(scenario))
    return path


def line_with(words: str, process: subprocess.Popen | Forked) -> str:
    """Return the first line of a process that has these words.

    It prints other lines before, such as that it compiles.
    """
    lines = []
    for line in process.stdout:
        lines.append(line)
        if words in line:
            return line
    raise AssertionError(f"it never said {words!r}, but {''.join(lines)}")


@contextmanager
def running(*arguments: object):
    """Start `orchard`, and wait for its first line of progress. It is ended after the context."""
    with starting(*arguments) as process:
        line_with("real time", process)
        yield process


@contextmanager
def starting(*arguments: object):
    """Start `orchard` as a user types it. All processes of it are ended after the context."""
    process = Forked("run", [*map(str, arguments)], os.environ | {"PYTHONPATH": PATH}, leads=True)
    try:
        yield process
    finally:
        # It has just ended.
        with suppress(psutil.NoSuchProcess):
            for child in (
                [*psutil.Process(process.pid).children(recursive=True)]
                if process.poll() is None
                else []
            ):
                child.kill()
        process.kill()
        # The test has read it to its end.
        with suppress(ValueError):
            process.communicate()


def wait_until_simulated(run: subprocess.Popen | Forked, seconds: float) -> None:
    """Read lines of progress until so much time has been simulated."""
    assert any(float(line.split()[0]) >= seconds for line in run.stdout if "real time" in line)


def summary_of(path: Path) -> dict:
    return json.loads(path.read_text())
