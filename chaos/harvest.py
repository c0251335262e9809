"""A run.py process that the soak starts, kills and ends.

It finds the processes of the run by their role, and has its log and its summary.
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

    It has a folder of its own, with a link to run.py: there it keeps notes, snapshots, recordings
    and compiled kernels. So it disturbs no other run.
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
        compiled = kernels_folder()
        if compiled is not None and compiled.is_dir():
            # To compile them takes longer than most runs.
            shutil.copytree(compiled, self._kernels / compiled.name)
        file = self._folder / "scenario.yaml"
        file.write_text(to_yaml(self._scenario))
        self._start(str(file))
        return self

    def _start(self, *begin: str) -> None:
        """Start run.py. The log continues. `begin`: its first arguments."""
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
        has_snapshot = any(self._folder.glob("runs/*.snapshots/*.snapshot"))
        if self._popen.poll() is not None or not has_snapshot:
            return False
        self._popen.kill()
        self._popen.wait()
        self._start("--resume", "last")
        return True

    def tear_kernel(self, chance: int) -> bool:
        """Change a bit of a compiled kernel.

        `chance`: selects the kernel and the bit. Return whether there is one.
        """
        # numba stores machine code in files .nbc.
        files = sorted(self._kernels.rglob("*.nbc"))
        if files:
            flip_bit(files[chance % len(files)], chance)
        return bool(files)

    def __exit__(self, *_: object) -> None:
        # Those that a dead run.py leaves are nobody's children, so they are looked up first.
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
            # psutil.Error: it has ended meanwhile.
            with suppress(psutil.Error):
                command = process.cmdline()
                is_alive = process.status() != psutil.STATUS_ZOMBIE
                if f"orchard.processes.{role}" in command and is_alive:
                    found.append((command, process))
        found.sort(key=_command_of)
        return [process for _, process in found]

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
        # A soak that was killed has left its disk mounted.
        self.disk.unmount()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _children(self) -> list[psutil.Process]:
        """Return all processes that run.py has started, and those that these have started."""
        with suppress(psutil.NoSuchProcess):
            return list(psutil.Process(self._popen.pid).children(recursive=True))
        return []


def _command_of(found: tuple[list[str], psutil.Process]) -> list[str]:
    """Return the command line of a process, by which processes are sorted."""
    return found[0]


def flip_bit(path: Path, chance: int) -> None:
    """Change one bit of a file, in its place. `chance`: any number, which selects the bit."""
    with path.open("r+b") as file:
        at = chance % path.stat().st_size
        bit = 1 << (chance % 8)
        file.seek(at)
        (byte,) = file.read(1)
        file.seek(at)
        file.write(bytes([byte ^ bit]))
