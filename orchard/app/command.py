"""A command `orchard` of the page: its lines are read as they come, and it is asked to stop as by
Ctrl-C.
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
from typing import Generic, TypeVar

import msgspec

from orchard.field.scenario import Scenario, to_yaml
from orchard.folders import RUNS, regular

Result = TypeVar("Result")
KEPT_LINES = 500
# S after which a command that has not begun is asked once more: a library may swallow the signal.
AGAIN = 6.0
# S that a command may take to end, with its files; on an idle machine it takes less than 3.
PATIENCE = 60.0


class RunState(StrEnum):
    running = "running"
    stopping = "stopping"
    finished = "finished"
    stopped = "stopped"
    failed = "failed"

    @property
    def is_over(self) -> bool:
        return self not in (RunState.running, RunState.stopping)


STATE_COLOURS = {
    "running": "primary",
    "stopping": "warning",
    "finished": "positive",
    "stopped": "warning",
    "failed": "negative",
}


class Files:
    """The files of a command: in one folder, under one name.

    `views`: those of the page's picture.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.scenario = folder / f"{name}.yaml"
        self.recording = folder / f"{name}.rrd"
        self.summary = folder / f"{name}.json"
        self.views = folder / f"{name}.rbl"


class PageCommand:
    """A process of its own.

    `said`: the number of lines printed so far, and the last KEPT_LINES of them.
    """

    has_begun = False

    def __init__(self, scenario: Scenario, files: Files, line: list[str]) -> None:
        self.scenario, self.files = scenario, files
        self.said: tuple[int, tuple[str, ...]] = (0, ())
        self.asked_to_stop = self._is_hushed = False
        files.scenario.write_text(to_yaml(scenario))
        self._process = _open(line, files.folder)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def words_of(self, line: str) -> str | None:
        """Take what a line tells.

        Return its words for a person; None if it is for programs only.
        """
        return line.rstrip()

    def finish(self) -> None:
        """Read what the command has left.

        Afterwards `is_over` is true, and nothing changes any more.
        """

    @property
    def is_complete(self) -> bool:
        return False

    def read(self, path: Path, kind: type[Result]) -> Result | None:
        """Return what the command has left in a file; None if there is none, or if it holds
        something else.
        """
        try:
            return msgspec.json.decode(regular(path).read_bytes(), type=kind)
        except FileNotFoundError:  # it has failed
            return None
        except (OSError, ValueError, RecursionError) as error:
            self._say(f"{path} is passed over: {getattr(error, 'strerror', None) or error}")
            return None

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process:
            for line in self._process.stdout:
                self._hear(line)
        self.finish()

    def _hear(self, line: str) -> None:
        """Keep a line.

        After a stop request, drop a traceback: Python was interrupted while it started.
        """
        self._is_hushed = self._is_hushed or (self.asked_to_stop and line.startswith("Traceback"))
        if not self._is_hushed and (words := self.words_of(line)) is not None:
            self._say(words)

    def _say(self, words: str) -> None:
        self.said = (self.said[0] + 1, (*self.said[1], words)[-KEPT_LINES:])

    @property
    def is_over(self) -> bool:
        return not self._listener.is_alive()

    @property
    def state(self) -> RunState:
        """The present state. Read it first: if the command is over, all else is final."""
        if not self.is_over:
            return RunState.stopping if self.asked_to_stop else RunState.running
        if self._process.returncode == 0 and self.is_complete:
            return RunState.finished
        return RunState.stopped if self.asked_to_stop else RunState.failed

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
        if not self._ends_within(AGAIN) and not self.has_begun:
            self._process.send_signal(signal.SIGINT)
        if not self._ends_within(PATIENCE):
            self._process.kill()

    def _ends_within(self, seconds: float) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self._process.returncode is not None

    def close(self) -> None:
        self.stop()
        self._listener.join(PATIENCE + 2.0)


def _open(line: list[str], folder: Path) -> subprocess.Popen[str]:
    """Start the process in its own session, so that Ctrl-C at the page's terminal reaches it only
    through `stop`.

    It inherits a blocked SIGINT, which it unblocks: Python would lose a SIGINT while it loads
    `site`.
    """
    null, pipe, wide = (
        subprocess.DEVNULL,
        subprocess.PIPE,
        os.environ | {"COLUMNS": "200", RUNS: str(folder)},
    )
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return subprocess.Popen(
            line,
            env=wide,
            stdin=null,
            stdout=pipe,
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

    def __init__(self, folder: Path, what: str) -> None:
        """`what`: a word for a command, with which its files in `folder` begin: harvest, study."""
        self.folder, self.what = folder, what
        self.command: Started | None = None

    @property
    def going(self) -> Started | None:
        return None if self.command is None or self.command.is_over else self.command

    def start(self, kind: Callable[[Files], Started]) -> None:
        """Start a command with files of its own.

        Raises OSError, or RuntimeError while another one goes on.
        """
        if self.going is not None:
            raise RuntimeError(f"another {self.what} is in progress; stop it first")
        self.close()
        self.command = kind(fresh_files(self.folder, self.what))

    def stop(self) -> None:
        if self.command is not None:
            self.command.stop()

    def close(self) -> None:
        if self.command is not None:
            self.command.close()


def fresh_files(folder: Path, what: str) -> Files:
    """Return files named after the time, to the microsecond."""
    folder.mkdir(parents=True, exist_ok=True)
    return Files(folder.resolve(), f"{what}-{datetime.now():%Y%m%d-%H%M%S-%f}")
