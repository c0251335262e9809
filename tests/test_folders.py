"""What every process rests on: how it reads files, and when Python collects its garbage.

A named pipe in place of a file must be refused, for a process that opens one waits for ever. And
`orchard.memory` keeps Python's cycle collector from what a process has made before its ticks begin.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from patience import PATIENCE

from orchard.field.problems import ScenarioError

# s of wall time after which a reader that waits for the pipe is interrupted, as by Ctrl-C. A reader
# that refuses the pipe takes milliseconds.
SECONDS = 10


@pytest.fixture
def pipe(tmp_path) -> Path:
    """Make a named pipe to which nothing writes, and an alarm for a test that waits for it."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(SECONDS)
    os.mkfifo(tmp_path / "odd.json")
    yield tmp_path / "odd.json"
    signal.alarm(0)


@pytest.fixture
def read(request):
    """Return a function, or skip the test if its package was removed.

    It is a fixture, so that the import is over before the alarm of `pipe` is set: imports may take
    longer than that.
    """
    module, name = request.param
    return getattr(pytest.importorskip(module), name)


@pytest.mark.parametrize(
    ("read", "why"),
    [
        (("orchard.field.scenario", "load"), "is no regular file"),
        (("orchard.surveys.importing", "import_survey"), "is no regular file"),
        (("orchard.bags.replay", "read_commands"), "bag: is no regular file"),
        (("orchard.study.store", "Store"), "is no store"),
    ],
    indirect=["read"],
)
def test_a_named_pipe_is_refused(read, why, pipe):
    with pytest.raises((ScenarioError, ValueError), match=why):
        read(pipe)


@pytest.mark.parametrize("read", [("orchard.app.past_runs", "past_runs")], indirect=True)
def test_a_named_pipe_in_the_folder_of_runs_is_passed_over(read, pipe):
    assert read(pipe.parent) == ([], ["odd.json is passed over: is no regular file"])


def test_what_was_there_before_a_process_settled_stays():
    """After `settle` the collector passes over older objects, and frees none that is in use."""
    program = """
from orchard.memory import settle
kept = [bytes([n % 256]) * 1000 for n in range(20_000)]
settle()
assert all(each == bytes([n % 256]) * 1000 for n, each in enumerate(kept))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE)


def test_the_collector_runs_seldom_from_the_first_import():
    program = (
        "import orchard.processes, gc, orchard.memory; assert gc.get_threshold()[0] =="
        " orchard.memory.YOUNG"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE)
