"""A command `orchard` that the page starts: its lines are read as they come, and it is asked to
stop as by Ctrl-C.

`HarvestCommand` (harvest_run.py) and `StudyRun` (study_run.py) are the two kinds of it. Of each
kind one goes on at a time (`Latest`), and all pages show it.
"""

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import msgspec

from orchard.field.scenario import Scenario, to_yaml
from orchard.folders import RUNS, regular

Result = TypeVar("Result")
KEPT_LINES = 500
# After these seconds a command that has not begun is asked to stop once more: a library may have
# swallowed the signal.
ASK_AGAIN_SECONDS = 6.0
# These seconds a command may take to end, with its files. On an idle machine it takes less than 3.
PATIENCE = 60.0


class RunState(StrEnum):
    """How far a command is. The page shows the word."""

    running = "running"
    stopping = "stopping"
    finished = "finished"
    cut = "cut short"
    stopped = "stopped"
    failed = "failed"

    @property
    def is_over(self) -> bool:
        """Whether the command has ended, in one way or another."""
        return self not in (RunState.running, RunState.stopping)


STATE_COLOURS = {
    "running": "primary",
    "stopping": "warning",
    "finished": "positive",
    "cut short": "warning",
    "stopped": "warning",
    "failed": "negative",
}


class Files:
    """The files of a command: in one folder, under one name.

    `views`: the blueprint of Rerun with the views of the page's picture.
    """

    def __init__(self, folder: Path, name: str) -> None:
        """`name`: of each of the files, before its ending."""
        self.folder = folder
        self.name = name
        self.scenario = folder / f"{name}.yaml"
        self.recording = folder / f"{name}.rrd"
        self.summary = folder / f"{name}.json"
        self.views = folder / f"{name}.rbl"


class PrintedLines(NamedTuple):
    """What a command has printed for a person.

    `line_count`: the number of lines so far. `lines`: the last KEPT_LINES of them.
    """

    line_count: int
    lines: tuple[str, ...]


class PageCommand:
    """A command in a process of its own, and what it prints.

    A thread reads what the command prints. It replaces `output` as a whole, so that a page reads a
    count that fits the lines.
    """

    #: Whether the command has printed a result, so that a signal reaches its own code.
    has_begun = False

    def __init__(self, scenario: Scenario, files: Files, line: list[str]) -> None:
        """Write the scenario to its file, and start the process.

        `line`: the command line. Raises OSError.
        """
        self.scenario = scenario
        self.files = files
        self.output = PrintedLines(0, ())
        self.asked_to_stop = False
        # Whether a traceback has begun, which is not shown.
        self._is_hushed = False
        files.scenario.write_text(to_yaml(scenario))
        self._process = _open(line, files.folder)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def message_of(self, line: str) -> str | None:
        """Take what a printed line tells.

        Return its words for a person; None if it is for programs only.
        """
        return line.rstrip()

    def finish(self) -> None:
        """Read what the command has left.

        Afterwards `is_over` is true, and nothing changes any more.
        """

    @property
    def is_complete(self) -> bool:
        """Whether the command has left a whole result. Each kind of command says what that is."""
        return False

    def read(self, path: Path, kind: type[Result]) -> Result | None:
        """Return what the command has left in a file.

        Return None if there is no file, or if it holds something else. Messages tell of the latter.
        """
        try:
            return msgspec.json.decode(regular(path).read_bytes(), type=kind)
        except FileNotFoundError:
            # The command has failed, and its own messages say why.
            return None
        except (OSError, ValueError, RecursionError) as error:
            self._add_message(f"{path} is passed over: {getattr(error, 'strerror', None) or error}")
            return None

    def _listen(self) -> None:
        """Read what the command prints until it ends, and then what it has left. In a thread."""
        assert self._process.stdout is not None
        with self._process:
            for line in self._process.stdout:
                self._hear(line)
        self.finish()

    def _hear(self, line: str) -> None:
        """Keep a line.

        After a stop request, drop a traceback: Python was interrupted while it started.
        """
        if self.asked_to_stop and line.startswith("Traceback"):
            self._is_hushed = True
        if self._is_hushed:
            return
        message = self.message_of(line)
        if message is not None:
            self._add_message(message)

    def _add_message(self, message: str) -> None:
        count, lines = self.output
        self.output = PrintedLines(count + 1, (*lines, message)[-KEPT_LINES:])

    @property
    def is_over(self) -> bool:
        """Whether the process has ended, and all that it has left is read."""
        return not self._listener.is_alive()

    @property
    def state(self) -> RunState:
        """The present state. Read it first: if the command is over, all else is final."""
        if not self.is_over:
            if self.asked_to_stop:
                return RunState.stopping
            return RunState.running
        if self._process.returncode == 0 and self.is_complete:
            return RunState.finished
        if self.asked_to_stop:
            return RunState.stopped
        return RunState.failed

    def stop(self) -> None:
        """Ask the command to end.

        It is killed if it has not ended after PATIENCE, so one call is enough.
        """
        if self.asked_to_stop or self.is_over:
            return
        self.asked_to_stop = True
        self._process.send_signal(signal.SIGINT)
        threading.Thread(target=self._insist, daemon=True).start()

    def _insist(self) -> None:
        """Ask once more if the signal may have been lost, and kill the process in the end."""
        if not self._ends_within(ASK_AGAIN_SECONDS) and not self.has_begun:
            self._process.send_signal(signal.SIGINT)
        if not self._ends_within(PATIENCE):
            self._process.kill()

    def _ends_within(self, seconds: float) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self._process.returncode is not None

    def close(self) -> None:
        """Stop the command, and wait until all that it has left is read.

        That takes PATIENCE and a little more at most: then the command has been killed.
        """
        self.stop()
        self._listener.join(PATIENCE + 2.0)


def _open(line: list[str], folder: Path) -> subprocess.Popen[str]:
    """Start a process in a session of its own.

    Ctrl-C at the page's terminal reaches the process only through `stop`. The process inherits a
    blocked SIGINT, which it unblocks: Python would lose a SIGINT while it loads `site`.
    """
    # Messages of up to 200 columns come as one line.
    environment = os.environ | {"COLUMNS": "200", RUNS: str(folder)}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return subprocess.Popen(
            line,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


Started = TypeVar("Started", bound=PageCommand)


class Latest(Generic[Started]):
    """Starts commands of one kind, one at a time. `command`: the last one; None at first."""

    def __init__(self, folder: Path, noun: str) -> None:
        """`noun`: a word for a command, with which its files in `folder` begin: harvest, study."""
        self.folder = folder
        self.noun = noun
        self.command: Started | None = None

    @property
    def going(self) -> Started | None:
        """The command that goes on; None if there is none, or if the last one is over."""
        if self.command is None or self.command.is_over:
            return None
        return self.command

    def start(self, kind: Callable[[Files], Started]) -> None:
        """Start a command with files of its own.

        Raises OSError, or RuntimeError while another one goes on.
        """
        if self.going is not None:
            raise RuntimeError(f"another {self.noun} is in progress; stop it first")
        self.close()
        self.command = kind(fresh_files(self.folder, self.noun))

    def stop(self) -> None:
        """Ask the last command to end, if there is one."""
        if self.command is not None:
            self.command.stop()

    def close(self) -> None:
        """Stop the last command, if there is one, and wait for its end."""
        if self.command is not None:
            self.command.close()


def fresh_files(folder: Path, noun: str) -> Files:
    """Return files that are named by a word and the time, to the microsecond.

    Makes the folder. Raises OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return Files(folder.resolve(), f"{noun}-{datetime.now():%Y%m%d-%H%M%S-%f}")
