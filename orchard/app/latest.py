"""The harvest, or the study, that all pages share: the one that goes on, or else the last one."""

import contextlib
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Generic, TypeVar

from orchard.app.command import Files, PageCommand

Started = TypeVar("Started", bound=PageCommand)


class Latest(Generic[Started]):
    """Starts commands of one kind, one at a time. `command`: the last one; None at first."""

    def __init__(self, folder: Path, what: str) -> None:
        """`folder`: of the files of all commands. `what`: a word for one, with which its files begin: harvest, study."""
        self.folder, self.what = folder, what
        self.command: Started | None = None

    @property
    def going(self) -> Started | None:
        """The command that has not ended."""
        return None if self.command is None or self.command.is_over else self.command

    def start(self, kind: Callable[[Files], Started]) -> None:
        """Start a command with files of its own. Raises OSError if they cannot be written, RuntimeError while another one goes on."""
        if self.going is not None:
            raise RuntimeError(f"another {self.what} is in progress; stop it first")
        self.close()
        self.command = kind(fresh_files(self.folder, self.what))

    def stop(self) -> None:
        """Ask the command to end."""
        if self.command is not None:
            self.command.stop()

    def close(self) -> None:
        """End the command."""
        if self.command is not None:
            self.command.close()


def fresh_files(folder: Path, what: str) -> Files:
    """Return files named after the time, for a harvest or a study; the scenario's exists. Two within a second get different names."""
    folder.mkdir(parents=True, exist_ok=True)
    name = f"{what}-{datetime.now():%Y%m%d-%H%M%S}"
    for more in ("", *(f"-{n}" for n in range(2, 100))):
        files = Files(folder.resolve(), name + more)
        with contextlib.suppress(FileExistsError):
            files.scenario.touch(exist_ok=False)
            return files
    raise FileExistsError(f"{folder}: too many files named {name}")
