"""A run.py process that the soak starts and ends: its processes by role, its log and its summary."""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "runs" / "chaos"  # logs and recordings
STOP_SECONDS = 15.0  # within which a run must stop when it is asked to


class Harvest:
    """A run.py process. Use it with `with`, which leaves no process behind. Its output goes to `log`, which stays until `tidy`."""

    def __init__(self, arguments: Sequence[str], name: str) -> None:
        """`arguments`: of run.py. `name`: of the log and of the other files."""
        FOLDER.mkdir(parents=True, exist_ok=True)
        self.log, self._summary, self._recording = (FOLDER / f"{name}.{ending}" for ending in ("log", "json", "rrd"))
        self._arguments, self._name = arguments, name

    def __enter__(self) -> "Harvest":
        self.tidy()
        record = [] if "--record" in self._arguments else ["--record", str(self._recording)]
        command = [sys.executable, "-u", "run.py", *self._arguments, *record, "--summary", str(self._summary)]
        with self.log.open("w") as file:
            self._popen = subprocess.Popen(command, cwd=ROOT, stdout=file, stderr=subprocess.STDOUT, start_new_session=True)
        return self

    def __exit__(self, *_: object) -> None:
        children = self._children()
        if self._popen.poll() is None:
            self._popen.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._popen.wait(STOP_SECONDS)
        for process in children:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        if self._popen.poll() is None:
            self._popen.kill()
        self._popen.wait()

    @property
    def exit_code(self) -> int | None:
        """The exit code of run.py; None while it runs."""
        return self._popen.poll()

    def processes(self, role: str) -> list[psutil.Process]:
        """Return the processes of `processes/{role}.py`. Their order stays the same when one is started again."""
        found = []
        for process in self._children():
            with suppress(psutil.Error):
                command = process.cmdline()
                if f"processes.{role}" in command and process.status() != psutil.STATUS_ZOMBIE:
                    found.append((command, process))
        return [process for _, process in sorted(found, key=lambda pair: pair[0])]

    def summary(self) -> dict[str, Any] | None:
        """Return the summary of the run; None if it wrote none."""
        with suppress(OSError, json.JSONDecodeError):
            summary: dict[str, Any] = json.loads(self._summary.read_text())
            return summary
        return None

    def tidy(self) -> None:
        """Remove all files of the run."""
        for path in FOLDER.glob(f"{self._name}.*"):
            path.unlink()
        if hasattr(self, "_popen"):
            for folder in (ROOT / "runs").glob(f"harvest-*-{self._popen.pid}.snapshots"):
                shutil.rmtree(folder, ignore_errors=True)

    def _children(self) -> list[psutil.Process]:
        with suppress(psutil.NoSuchProcess):
            return list(psutil.Process(self._popen.pid).children(recursive=True))
        return []
