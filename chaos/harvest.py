"""A run.py process that the soak starts, kills and ends: its processes by role, its log and its
summary.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from chaos.disk import Disk
from orchard.field.scenario import Scenario, to_yaml
from orchard.sim.kernels.cache import kernels_folder

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "runs" / "chaos"  # logs, and the folders of runs
STOP_SECONDS = 15.0  # within which a run must stop when it is asked to


class Harvest:
    """A run.py process.

    Use it with `with`, which leaves no process behind. Its output goes to `log`, which stays until
    `tidy`.

    It has a folder of its own, in which it keeps notes, snapshots, recordings and compiled kernels:
    it disturbs no other run.
    """

    def __init__(
        self, scenario: Scenario, arguments: Sequence[str], name: str, has_disk: bool = False
    ) -> None:
        """`arguments`: of run.py, without the scenario. `name`: of log and folder.

        `has_disk`: whether its folder shall be a disk of its own.
        """
        self.log = FOLDER / f"{name}.log"
        self._summary = FOLDER / f"{name}.json"
        self._folder = FOLDER / name
        self._scenario = scenario
        self._arguments = arguments
        self._has_disk = has_disk
        self.disk = Disk(self._folder)
        self._kernels = self._folder / "kernels"

    def __enter__(self) -> "Harvest":
        self.tidy()
        self._folder.mkdir(parents=True)
        if self._has_disk:
            self.disk.mount()
        (self._folder / "run.py").symlink_to(ROOT / "run.py")
        if (kept := kernels_folder()) and kept.is_dir():
            shutil.copytree(kept, self._kernels / kept.name)
        (file := self._folder / "scenario.yaml").write_text(to_yaml(self._scenario))
        self._start(str(file))
        return self

    def _start(self, *begin: str) -> None:
        """Start run.py. The log continues."""
        command = [
            sys.executable,
            "-u",
            str(self._folder / "run.py"),
            *begin,
            *self._arguments,
            "--summary",
            str(self._summary),
        ]
        with self.log.open("a") as file:
            self._popen = subprocess.Popen(
                command,
                cwd=ROOT,
                env=os.environ | {"NUMBA_CACHE_DIR": str(self._kernels)},
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def kill_and_resume(self) -> bool:
        """Kill run.py and continue its run.

        Return whether that was possible: it must run, and have a snapshot.
        """
        if self._popen.poll() is not None or not any(
            self._folder.glob("runs/*.snapshots/*.snapshot")
        ):
            return False
        self._popen.kill()
        self._popen.wait()
        self._start("--resume", "last")
        return True

    def tear_kernel(self, chance: int) -> bool:
        """Change a bit of a compiled kernel.

        `chance`: selects the kernel and the bit. Return whether there is one.
        """
        if files := sorted(self._kernels.rglob("*.nbc")):
            flip_bit(files[chance % len(files)], chance)
        return bool(files)

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
        self.disk.unmount()

    @property
    def exit_code(self) -> int | None:
        """The exit code of run.py; None while it runs."""
        return self._popen.poll()

    def processes(self, role: str) -> list[psutil.Process]:
        """Return the processes of `processes/{role}.py`.

        Their order stays the same when one is started again.
        """
        found = []
        for process in self._children():
            with suppress(psutil.Error):
                command = process.cmdline()
                if (
                    f"orchard.processes.{role}" in command
                    and process.status() != psutil.STATUS_ZOMBIE
                ):
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
        for path in (self.log, self._summary):
            path.unlink(missing_ok=True)
        self.disk.unmount()  # of a soak that was killed
        shutil.rmtree(self._folder, ignore_errors=True)

    def _children(self) -> list[psutil.Process]:
        with suppress(psutil.NoSuchProcess):
            return list(psutil.Process(self._popen.pid).children(recursive=True))
        return []


def flip_bit(path: Path, chance: int) -> None:
    """Change one bit of a file, in its place."""
    with path.open("r+b") as file:
        at = chance % path.stat().st_size
        file.seek(at)
        (byte,) = file.read(1)
        file.seek(at)
        file.write(bytes([byte ^ 1 << chance % 8]))
