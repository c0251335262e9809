"""What run.py prints: the result of a run, commands to type next, and errors; and its exit codes."""

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


def print_error(words: object) -> None:
    """Print a line on stderr."""
    errors.print(str(words), markup=False, soft_wrap=True)


@contextmanager
def exit_on_errors(*mistakes: type[Exception]) -> Iterator[None]:
    """In this context, print errors of these types, which a user can correct, without a traceback. Raises typer.Exit for them."""
    try:
        yield
    except mistakes as error:
        print_error(error)
        raise typer.Exit(BAD_INPUT) from None


def report_result(result: dict[str, Any] | None, why: str, recording: Path | None, summary: Path | None) -> int:
    """Print the result of a run, and write its summary to a file. Return the exit code.

    `result`: the summary; None if there is none. `why`: why the run ended. `summary`: the file for the summary.
    """
    if result is None:
        errors.print(why, markup=False)
        return FAILED
    if recording is not None:
        from orchard.view.reader import missing  # not at the top: Rerun takes half a second to load

        result |= missing(recording, result["ticks"])
    Console(emoji=False, highlight=False).print(as_table(result))
    written = summary is None or _written(result, summary)
    troubles = [*(f"violated: {violation}" for violation in result["violations"])]
    troubles += [f"broken: {agent}" for agent in result["broken_agents"]]
    troubles += [] if why in ("harvested", "duration", "stopped") else [why, *result["jam"]]
    for trouble in troubles:
        print_error(trouble)
    return FAILED if troubles or not written else FINISHED


def _written(result: dict[str, Any], summary: Path) -> bool:
    """Write the summary. Return whether that succeeded; an error is printed."""
    try:
        write(result, summary)
    except OSError as error:
        print_error(f"{summary}: not written: {error.strerror}")
        return False
    return True


def report_snapshots(program: Path, folder: Path, why: str) -> None:
    """Remove the snapshots of a finished harvest. For another run, print the command that resumes it."""
    if why == "harvested":
        shutil.rmtree(folder, ignore_errors=True)
    elif folder.is_dir() and _is_usable(folder):
        _print_command("To go on", program, "--resume", folder)


def _is_usable(folder: Path) -> bool:
    try:
        newest(folder, [])
    except SnapshotError:
        return False
    return True


def report_recording(program: Path, recording: Path | None) -> None:
    """Print the command that opens the recording, as the last line."""
    if recording is not None and recording.exists():
        _print_command("To watch it", program, "view", recording)


def _print_command(what: str, program: Path, word: str, path: Path) -> None:
    command = f"{_shown(Path(sys.executable))} {_shown(program)} {word} {_shown(path)}"
    Console(emoji=False, highlight=False).print(f"{what}: {command}", soft_wrap=True, markup=False)


def _shown(path: Path) -> str:
    """A path as a user would type it in the current directory."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
