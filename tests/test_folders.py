"""Files that are not what they seem: a named pipe never has the program wait."""

import os
import signal
from pathlib import Path

import pytest

from orchard.app.runs_view import past_runs
from orchard.bags.replay import read_commands
from orchard.field.geojson import import_rows
from orchard.field.problems import ScenarioError
from orchard.field.scenario import load
from orchard.study.store import Store

SECONDS = 10  # after which a reader that waits is ended


@pytest.fixture
def pipe(tmp_path) -> Path:
    """A named pipe to which nothing writes, and an alarm for a test that waits for it."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(SECONDS)
    os.mkfifo(tmp_path / "odd.json")
    yield tmp_path / "odd.json"
    signal.alarm(0)


@pytest.mark.parametrize(
    ("read", "why"),
    [(load, "is no regular file"), (import_rows, "is no regular file"), (read_commands, "bag: is no regular file"), (Store, "is no store")],
)
def test_a_named_pipe_is_refused(read, why, pipe):
    with pytest.raises((ScenarioError, ValueError), match=why):
        read(pipe)


def test_a_named_pipe_in_the_folder_of_runs_is_passed_over(pipe):
    assert past_runs(pipe.parent) == ([], ["odd.json is passed over: is no regular file"])
