"""Start a run, read its output and stop it. All pages share one run at a time."""

import contextlib
import json
import os
import signal
import subprocess
import threading
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import msgspec

from orchard.app.course import Course
from orchard.app.run_controls import Files, RunSettings, command
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, to_yaml
from orchard.folders import RUNS
from orchard.report.progress import Headline, headline_of
from orchard.view.blueprint import for_page
from orchard.view.files import parts_of
from orchard.view.web import free_pair, is_open, page_url, serve_web

KEPT_LINES = 500
AGAIN = 6.0  # s after which a run that has not begun is asked to stop once more: while it is imported, a library may swallow the signal
PATIENCE = 60.0  # s that a run may take to end after a stop request, with its summary; a healthy run on an idle machine takes less than 3


class RunState(StrEnum):
    """The state of a run."""

    running = "running"
    stopping = "stopping"
    finished = "finished"
    stopped = "stopped"
    failed = "failed"


@dataclass(frozen=True)
class RunReport:
    """A run at one moment. All views of an update use one report, because a run may end between two reads."""

    run: "Run"
    state: RunState
    headline: Headline | None
    summary: dict[str, Any] | None

    @property
    def is_over(self) -> bool:
        return self.state not in (RunState.running, RunState.stopping)


class Run:
    """One run. `said`: the number of lines printed so far, and the last KEPT_LINES of them."""

    def __init__(self, scenario: Scenario, settings: RunSettings, files: Files) -> None:
        self.scenario, self.settings, self.files = scenario, settings, files
        self.port, self.views_port = free_pair(), free_pair()
        self.said: tuple[int, tuple[str, ...]] = (0, ())
        self.headline: Headline | None = None
        self.summary: dict[str, Any] | None = None
        self._course: dict[str, list[float]] = {"seconds": [], "bins_delivered": []}  # what the lines of progress say
        self.asked_to_stop = self._is_hushed = False
        files.scenario.write_text(to_yaml(scenario))
        for_page(lay_out(scenario)).save("orchard", files.views)
        self._servers = [serve_web(self.views_port, str(files.views))]  # of the views, and later of the recording
        self._process = self._open()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _open(self) -> subprocess.Popen[str]:
        """Start the process in its own session, so that Ctrl-C at the page's terminal reaches it only through `stop`.

        The user's own classes are found from the directory in which the page was started. The process inherits a blocked SIGINT, which it
        unblocks: Python would lose a SIGINT while it loads `site`.
        """
        null, pipe, wide = subprocess.DEVNULL, subprocess.PIPE, os.environ | {"COLUMNS": "200", RUNS: str(self.files.folder)}
        line = command(self.settings, self.files, self.port)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return subprocess.Popen(
                line, env=wide, stdin=null, stdout=pipe, stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _listen(self) -> None:
        """Read lines until the run ends. Summary, headline and recording are ready before `report` says that the run is over."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._hear(line)
        self._process.wait()
        with contextlib.suppress(OSError, ValueError, KeyError):
            self.summary = json.loads(self.files.summary.read_text())
            self.headline = headline_of(self.summary)
        if self.files.recording.exists():
            self._servers.append(serve_web(self.port, *map(str, parts_of(self.files.recording))))

    def _hear(self, line: str) -> None:
        """Keep a line. After a stop request, drop a traceback and all that follows: Python was interrupted while it started."""
        self._is_hushed = self._is_hushed or (self.asked_to_stop and line.startswith("Traceback"))
        if not self._is_hushed:
            words = line.rstrip()
            with contextlib.suppress(msgspec.DecodeError, KeyError):  # any other line
                self.headline = msgspec.json.decode(line, type=dict[str, Headline])["progress"]
                words = str(self.headline)
                self._course["seconds"].append(self.headline.sim_seconds)
                self._course["bins_delivered"].append(self.headline.bins_delivered)
            self.said = (self.said[0] + 1, (*self.said[1], words)[-KEPT_LINES:])

    @property
    def picture(self) -> str:
        """The address of the picture, live or recorded; '' while its servers do not answer."""
        ports = self.port, self.port + 1, self.views_port + 1
        return page_url(self.port, self.views_port) if all(map(is_open, ports)) else ""

    @property
    def course(self) -> Course:
        """The course of the run as far as it is known."""
        known = self._course if self.summary is None else self.summary["history"]
        return Course({name: list(values) for name, values in known.items()}, self.scenario)

    @property
    def is_over(self) -> bool:
        return not self._listener.is_alive()

    def report(self) -> RunReport:
        """Return the present report. The state is read first: if the run is over, the other values are final."""
        return RunReport(run=self, state=self._state(), headline=self.headline, summary=self.summary)

    def _state(self) -> RunState:
        if not self.is_over:
            return RunState.stopping if self.asked_to_stop else RunState.running
        if self._process.returncode == 0 and self.summary is not None:
            return RunState.stopped if self.asked_to_stop and not self.summary["finished"] else RunState.finished
        return RunState.stopped if self.asked_to_stop else RunState.failed

    def stop(self) -> None:
        """Ask the run to end. It is killed if it has not ended after PATIENCE, so one call is enough."""
        if self.asked_to_stop or self.is_over:
            return
        self.asked_to_stop = True
        self._process.send_signal(signal.SIGINT)
        threading.Thread(target=self._insist, daemon=True).start()

    def _insist(self) -> None:
        if not self._ends_within(AGAIN) and self.headline is None:
            self._process.send_signal(signal.SIGINT)
        if not self._ends_within(PATIENCE):
            self._process.kill()

    def _ends_within(self, seconds: float) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self._process.returncode is not None

    def close(self) -> None:
        """End the run and the servers of its picture."""
        self.stop()
        self._listener.join(PATIENCE + 2.0)
        for server in self._servers:
            with server:
                server.terminate()


class Runner:
    """Holds the current run, or the last one. `folder`: of the files of all runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run: Run | None = None

    @property
    def is_busy(self) -> bool:
        return self.run is not None and not self.run.is_over

    def start(self, scenario: Scenario, settings: RunSettings) -> None:
        """Start a run. Raises OSError if its files cannot be written, RuntimeError while another run is in progress, ValueError."""
        if self.is_busy:
            raise RuntimeError("another run is in progress; stop it first")
        if settings.problems:
            raise ValueError("; ".join(f"{name} {words}" for name, words in settings.problems.items()))
        self.close()
        self.folder.mkdir(parents=True, exist_ok=True)
        self.run = Run(scenario, settings, self._fresh_files())

    def _fresh_files(self) -> Files:
        """Files named after the time. Two runs within a second get different names."""
        name = f"harvest-{datetime.now():%Y%m%d-%H%M%S}"
        for more in ("", *(f"-{n}" for n in range(2, 100))):
            files = Files(self.folder.resolve(), name + more)
            with contextlib.suppress(FileExistsError):
                files.scenario.touch(exist_ok=False)
                return files
        raise FileExistsError(f"{self.folder}: too many runs named {name}")

    def close(self) -> None:
        if self.run is not None:
            self.run.close()
