"""What run.py tells a person: what came of a run, what to type next, and mistakes, in words and with an exit code."""

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from orchard.report.summary import as_table, write
from orchard.sim.snapshot import SnapshotError, newest

FINISHED, FAILED, BAD_INPUT = 0, 1, 2  # exit codes

errors = Console(stderr=True, emoji=False, highlight=False)


def tell_error(words: object) -> None:
    """A line for a person to whom something went wrong."""
    errors.print(str(words), markup=False, soft_wrap=True)


@contextmanager
def exit_on_errors(*mistakes: type[Exception]) -> Iterator[None]:
    """Within this, mistakes that a person can mend are exit_on_errors, without a traceback, and end the program. Raises typer.Exit."""
    try:
        yield
    except mistakes as error:
        tell_error(error)
        raise typer.Exit(BAD_INPUT) from None


def tell(result: dict[str, Any] | None, why: str, recording: Path | None, summary: Path | None) -> int:
    """Print what came of a run, and write its summary; the exit code."""
    if result is None:
        errors.print(why, markup=False)
        return FAILED
    if recording is not None:
        from orchard.view.reader import missing  # late: Rerun takes half a second to load

        result |= missing(recording, result["ticks"])
    Console(emoji=False, highlight=False).print(as_table(result))
    written = summary is None or _written(result, summary)
    good = why in ("harvested", "duration", "stopped")
    if not good:
        errors.print(why, markup=False)
    for violation in result["violations"]:
        tell_error(f"violated: {violation}")
    return FINISHED if good and written and not result["violations"] else FAILED


def _written(result: dict[str, Any], summary: Path) -> bool:
    """Whether the disk took it; why it did not is told."""
    try:
        write(result, summary)
    except OSError as error:
        tell_error(f"{summary}: not written: {error.strerror}")
        return False
    return True


def tell_of_snapshots(program: Path, folder: Path, why: str) -> None:
    """A run that is over needs none; another can go on."""
    if why == "harvested":
        shutil.rmtree(folder, ignore_errors=True)
    elif folder.is_dir() and _is_usable(folder):
        _tell_command("To go on", program, "--resume", folder)


def _is_usable(folder: Path) -> bool:
    try:
        newest(folder, [])
    except SnapshotError:
        return False
    return True


def tell_of_recording(program: Path, recording: Path | None) -> None:
    """The last line is what opens it."""
    if recording is not None and recording.exists():
        _tell_command("To watch it", program, "view", recording)


def _tell_command(what: str, program: Path, word: str, path: Path) -> None:
    command = f"{_shown(Path(sys.executable))} {_shown(program)} {word} {_shown(path)}"
    Console(emoji=False, highlight=False).print(f"{what}: {command}", soft_wrap=True, markup=False)


def _shown(path: Path) -> str:
    """A path as one would type it here."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
