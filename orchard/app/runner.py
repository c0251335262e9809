"""Starts `run.py`, follows what it says, and stops it: one run at a time, whoever looks."""

import contextlib
import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from orchard.app.headline import Headline, of_summary, read_headline
from orchard.app.order import Files, Order, command
from orchard.field.scenario import to_yaml
from orchard.view.files import parts_of
from orchard.view.web import free_pair, serve_web

KEPT_LINES = 500
PATIENCE = 6.0  # s that a run may take to end after it was asked to; a sound one takes less than 3


@contextlib.contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Who is started within this hears of Ctrl-C when it wants to: Python would swallow one that comes while it loads `site`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class RunState(StrEnum):
    """What a run is doing."""

    running = "running"
    stopping = "stopping"
    finished = "finished"
    stopped = "stopped"
    failed = "failed"

    @property
    def is_over(self) -> bool:
        return self not in (RunState.running, RunState.stopping)


@dataclass(frozen=True)
class RunReport:
    """How a run is at one moment. What is seen at once is of one moment: a run may end between two questions about it."""

    run: "Run"
    state: RunState
    headline: Headline | None
    summary: dict[str, Any] | None

    @property
    def is_over(self) -> bool:
        return self.state.is_over


class Run:
    """One run of `run.py`."""

    def __init__(self, order: Order, files: Files) -> None:
        self.order, self.files, self.port = order, files, free_pair()
        self._said: tuple[int, tuple[str, ...]] = (0, ())
        self.headline: Headline | None = None
        self.summary: dict[str, Any] | None = None
        self.asked_to_stop = self._is_hushed = False
        self.begun = time.monotonic()
        self._web: subprocess.Popen[bytes] | None = None
        files.scenario.write_text(to_yaml(order.scenario))
        self._process = self._open()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _open(self) -> subprocess.Popen[str]:
        """A session of its own: Ctrl-C at the page's terminal reaches it through `stop`. The user's own classes are found from
        the directory in which the page was started."""
        null, pipe, wide = subprocess.DEVNULL, subprocess.PIPE, os.environ | {"COLUMNS": "200"}
        line = command(self.order, self.files, self.port)
        with _ctrl_c_held_back():
            return subprocess.Popen(
                line, env=wide, stdin=null, stdout=pipe, stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True
            )

    def _listen(self) -> None:
        """Until it ends; summary, headline and recording are there before `report` says that it has ended."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._hear(line)
        self._process.wait()
        with contextlib.suppress(OSError, ValueError, KeyError):
            self.summary = json.loads(self.files.summary.read_text())
            self.headline = of_summary(self.summary)
        if self.files.recording.exists():
            self._web = serve_web(self.port, *map(str, parts_of(self.files.recording)))

    def _hear(self, line: str) -> None:
        """Keep a line; where Python was interrupted while it started is nobody's business."""
        self._is_hushed = self._is_hushed or (self.asked_to_stop and line.startswith("Traceback"))
        if not self._is_hushed:
            self.headline = read_headline(line) or self.headline
            self._said = (self._said[0] + 1, (*self._said[1], line.rstrip())[-KEPT_LINES:])

    def said(self) -> tuple[int, tuple[str, ...]]:
        """How many lines it has printed, and the last ones."""
        return self._said

    @property
    def is_over(self) -> bool:
        return not self._listener.is_alive()

    def report(self) -> RunReport:
        """How it is now. The state is asked for first: where it tells of the end, the rest is final."""
        state = self._state()
        return RunReport(self, state, self.headline, self.summary)

    def _state(self) -> RunState:
        if not self.is_over:
            return RunState.stopping if self.asked_to_stop else RunState.running
        if self._process.returncode == 0 and self.summary is not None:
            return RunState.stopped if self.asked_to_stop and not self.summary["finished"] else RunState.finished
        return RunState.stopped if self.asked_to_stop else RunState.failed

    def stop(self) -> None:
        """Ask it to end; a second time is not needed, for one that does not listen is killed."""
        if self.asked_to_stop or self.is_over:
            return
        self.asked_to_stop = True
        self._process.send_signal(signal.SIGINT)
        threading.Thread(target=self._insist, daemon=True).start()

    def _insist(self) -> None:
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def close(self) -> None:
        """End it, and what shows its recording."""
        self.stop()
        self._listener.join(PATIENCE + 2.0)
        if self._web is not None:
            self._web.terminate()
            self._web.wait()


class Runner:
    """The run that goes on, or the last one."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run: Run | None = None

    @property
    def is_busy(self) -> bool:
        return self.run is not None and not self.run.is_over

    def start(self, order: Order) -> None:
        """Start a run. Raises OSError where its files cannot be written, and RuntimeError while another one goes on."""
        if self.is_busy:
            raise RuntimeError("another run goes on; stop it first")
        self.close()
        self.folder.mkdir(parents=True, exist_ok=True)
        self.run = Run(order, self._fresh_files())

    def _fresh_files(self) -> Files:
        """Named after the time; two runs within a second get two names."""
        name = f"harvest-{datetime.now():%Y%m%d-%H%M%S}"
        for more in ("", *(f"-{n}" for n in range(2, 100))):
            files = Files(self.folder.resolve(), name + more)
            with contextlib.suppress(FileExistsError):
                files.scenario.touch(exist_ok=False)
                return files
        raise FileExistsError(f"{self.folder}: too many runs of {name}")

    def close(self) -> None:
        if self.run is not None:
            self.run.close()
