"""What run.py prints: the result of a run, commands to type next, and errors; and its exit codes."""

import json
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from orchard.launch.request import RunRequest
from orchard.report.summary import as_table
from orchard.sim.snapshot import SnapshotError, newest

FINISHED, FAILED, BAD_INPUT = 0, 1, 2  # exit codes


class Output(Console):
    """Stdout or stderr. What cannot be written, as on a full disk, is lost, and the run goes on. The other of the two says so once."""

    def __init__(self, stderr: bool) -> None:
        super().__init__(stderr=stderr, emoji=False, highlight=False)
        self.other: Output | None = None
        self.has_lost = False

    def print(self, *objects: Any, **options: Any) -> None:
        try:
            super().print(*objects, **options)
        except OSError as error:
            self._buffer.clear()  # Rich would print it again with the next line
            is_first, self.has_lost = not self.has_lost, True
            if is_first and self.other is not None:
                name = "stderr" if self.stderr else "stdout"
                self.other.print(f"{name} cannot be written: {error.strerror}; the run goes on without it", markup=False, soft_wrap=True)

    def end(self) -> None:
        """Write what is left, or drop it. Python would end with exit code 120 because of it."""
        try:
            self.file.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


console, errors = Output(stderr=False), Output(stderr=True)
console.other, errors.other = errors, console


def print_line(words: str) -> None:
    """Print a line on stdout."""
    console.print(words, markup=False, soft_wrap=True)


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


def report(program: Path, request: RunRequest, result: dict[str, Any] | None, why: str) -> int:
    """Print the result of a run, and the commands that resume it and open its recording; write its summary. Return the exit code.

    `program`: run.py. `result`: the summary; None if there is none. `why`: why the run ended.
    """
    recording, folder = request.recording, request.snapshots
    code = _report_result(result, why, recording, request.options.summary)
    if why == "harvested":
        shutil.rmtree(folder, ignore_errors=True)
    elif folder.is_dir():
        with suppress(SnapshotError):  # none is usable
            newest(folder, [])
            _print_command("To go on", program, "--resume", folder)
    if recording is not None and recording.exists():
        _print_command("To watch it", program, "view", recording)
    return code


def _report_result(result: dict[str, Any] | None, why: str, recording: Path | None, summary: Path | None) -> int:
    """Print the result, and write it to the file `summary`. Return the exit code."""
    if result is None:
        errors.print(why, markup=False)
        return FAILED
    if recording is not None:
        from orchard.view.reader import missing  # not at the top: Rerun takes half a second to load

        result |= missing(recording, result["ticks"])
    _print_table(result)
    troubles = [f"violated: {violation}" for violation in result["violations"]]
    troubles += [f"broken: {agent}" for agent in result["broken_agents"]]
    troubles += [] if why in ("harvested", "duration", "stopped") else [why, *result["jam"]]
    try:
        if summary is not None:
            summary.write_text(json.dumps(result, indent=2) + "\n")
    except OSError as error:
        troubles.insert(0, f"{summary}: not written: {error.strerror}")
    for trouble in troubles:
        print_error(trouble)
    return FAILED if troubles or (console.has_lost and errors.has_lost) else FINISHED


def _print_table(result: dict[str, Any]) -> None:
    """Print the result on stdout; on stderr if stdout has lost something, because the disk of its file is full."""
    console.print(as_table(result))
    if console.has_lost:
        errors.print(as_table(result))


def _print_command(what: str, program: Path, word: str, path: Path) -> None:
    print_line(f"{what}: {_shown(Path(sys.executable))} {_shown(program)} {word} {_shown(path)}")


def _shown(path: Path) -> str:
    """A path as a user would type it in the current directory."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
