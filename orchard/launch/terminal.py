"""What `orchard` prints: the result of a run, commands to type next, and errors; and its exit codes."""

import errno
import logging
import math
import os
import re
import shlex
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec
import typer
from pydantic import ValidationError
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, TimeElapsedColumn
from rich.table import Table
from typer import BadParameter
from typer.exceptions import TyperException

from orchard.contract.printed import diverted, printed
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP
from orchard.launch.request import RunRequest
from orchard.report.summary import (
    Outcome,
    as_table,
    limit_sentence,
    sentence,
    unusual_figures,
    write_summary,
)
from orchard.sim.snapshot import SNAPSHOT, SnapshotError, newest, snapshots_in
from orchard.view.files import remove_half_packed

FINISHED, FAILED, BAD_INPUT = 0, 1, 2  # exit codes
CTRL_C = "Ctrl-C ends the run"
LATE_SECONDS, LATE_SHARE = 1.0, 0.1  # s, and share, that a run may take longer than at its speed


def harmless(words: str) -> str:
    """Return text that may hold anything, such as a path, without what would control a terminal."""
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in words)


def unwritten(name: str, error: OSError) -> str:
    """Return why stdout or stderr cannot be written."""
    why = "it is closed" if error.errno == errno.EBADF else error.strerror
    return f"{name} cannot be written: {why}"


class Output(Console):
    """Stdout or stderr. What cannot be written, as on a full disk, is lost; the other of the two says so once."""

    def __init__(self, stderr: bool) -> None:
        super().__init__(stderr=stderr, emoji=False, highlight=False)
        self.other: Output | None = None
        self.has_lost = False

    def print(self, *objects: Any, **options: Any) -> None:
        try:
            super().print(
                *(harmless(one) if isinstance(one, str) else one for one in objects), **options
            )
        except OSError as error:
            self._buffer.clear()  # Rich would print it again with the next line
            is_first, self.has_lost = not self.has_lost, True
            if is_first and self.other is not None:
                name = "stderr" if self.stderr else "stdout"
                self.other.print(
                    f"{unwritten(name, error)}; the run goes on without it",
                    markup=False,
                    soft_wrap=True,
                )

    def on_broken_pipe(self) -> None:
        """Let `print` know, which has called this by Rich. Rich would end the program before it has written its files."""
        raise

    def end(self) -> None:
        """Write what is left, or drop it. Python would end with exit code 120 because of it."""
        try:
            self.file.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


console, errors = Output(stderr=False), Output(stderr=True)
console.other, errors.other = errors, console


def print_line(words: str) -> None:
    console.print(words, markup=False, soft_wrap=True)


def print_error(words: object) -> None:
    errors.print(str(words), markup=False, soft_wrap=True)


def table(caption: str | None, *heads: str) -> Table:
    """Return a table without rows: words in its first column, figures in the others."""
    empty = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left"
    )
    for number, head in enumerate(heads):
        empty.add_column(
            escape(head), justify="right" if number else "left", no_wrap=not number, overflow="fold"
        )
    return empty


def bar(*more: ProgressColumn) -> Progress:
    """Return a bar, and the time since its begin, which a terminal shows while its `with` block lasts."""
    columns = BarColumn(bar_width=20), TimeElapsedColumn(), *more
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


class _Log(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        _say(self.format(record))


def _say(words: str) -> None:
    """Print a line on stderr; above the table, if there is one on the terminal."""
    (print_line if console.is_terminal else print_error)(words)


@contextmanager
def own_classes_run() -> Iterator[None]:
    """In this context, own classes may run: what they print is shown as lines of the program, and not all of it."""
    log, handler = logging.getLogger("orchard"), _Log()
    outputs: list[Any] = [console, errors]
    log.addHandler(handler)
    try:
        with diverted(_say) as (console.file, errors.file), printed(_say):
            yield
    finally:
        log.removeHandler(handler)
        for output in outputs:
            output.file = None  # stdout or stderr, whatever they are then


@contextmanager
def exit_on_errors(*mistakes: type[Exception], code: int = BAD_INPUT) -> Iterator[None]:
    """In this context, print errors of these types, which a user can correct, or others with another exit code. Raises typer.Exit."""
    try:
        yield
    except mistakes as error:
        print_error(in_words(error))
        raise typer.Exit(code) from None


@contextmanager
def as_typed(name: Callable[[str], str] = str) -> Iterator[None]:
    """In this context, what cannot be in a scenario is named as a user has typed it. `name`: path of a value -> what was typed."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(
            [replace(one, file="command line", path=name(one.path)) for one in error.problems]
        ) from None


@contextmanager
def handled(handlers: Mapping[int, Callable[[int, FrameType | None], Any]]) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def needs_extra(what: str, extra: str, otherwise: str = "") -> Iterator[None]:
    """In this context, modules are imported that need an extra. Raises typer.Exit if it is missing, and says so."""
    try:
        yield
    except ModuleNotFoundError as missing:
        print_error(
            f"{what} needs the package {missing.name}: pip install 'orchard-sim[{extra}]'{otherwise}"
        )
        raise typer.Exit(BAD_INPUT) from None


def in_words(error: Exception) -> str:
    """Return what is wrong, without a number of the operating system: "runs: Permission denied"."""
    if isinstance(error, UnicodeEncodeError):
        return f"{error.object}: this name is no text in UTF-8, which a run needs; expected another folder or file"
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        return f"{error.strerror}: `ulimit -n` tells how many may be open, and can allow more"
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def report(request: RunRequest, result: dict[str, Any] | None, why: str) -> int:
    """Print the result of a run, and how to go on and to watch it; write the summary. Return the exit code."""
    recording, folder = request.recording, request.snapshots
    code = _report_result(request, result, why)
    if why == "harvested" or request.options.replay:  # what a bag drives cannot go on without it
        for snapshot in snapshots_in(folder, SNAPSHOT):  # keyframes stay, for forks
            snapshot.unlink(missing_ok=True)
    elif folder.is_dir():
        with suppress(SnapshotError):  # none is usable
            newest(folder, [])
            print_line(f"To go on: {typed('--resume', folder)}")
    if recording is not None and recording.exists():
        print_line(f"To watch it: {typed('view', recording)}")
    if result is not None:
        _print_result_lines(f"hash {result['hash']}")
    return code


def _report_result(request: RunRequest, result: dict[str, Any] | None, why: str) -> int:
    recording, summary = request.recording, request.options.summary
    if result is None:
        print_error(why)
        return FAILED
    if recording is not None:
        from orchard.view.reader import missing  # not at the top: Rerun takes half a second to load

        remove_half_packed(recording)
        result |= missing(recording, result["ticks"])
    result |= {} if request.forked_from is None else {"forked_from": request.forked_from}
    outcome = msgspec.convert(result, Outcome)
    figures = (
        {key: value for key, value in result.items() if key != "hash"}
        if request.options.verbose
        else unusual_figures(result)
    )
    velocities = request.velocities
    driven = [] if velocities is None else [velocities.told(outcome.ticks)]
    lines = [sentence(outcome), limit_sentence(outcome), *driven, _what_to_try(request)]
    _print_result_lines(*lines, *([as_table(figures)] if figures else []))
    if slow := speed_not_kept(request, outcome):
        print_error(slow)
    troubles = [f"violated: {violation}" for violation in result["violations"]]
    troubles += [f"broken: {agent}" for agent in result["broken_agents"]]
    troubles += (
        []
        if why in ("harvested", "duration", "stopped", "broken", "refused")
        else [why, *result["jam"]]
    )
    if velocities is not None and why != "stopped":
        troubles += velocities.troubles(outcome.ticks)
    try:
        if summary is not None:
            write_summary(summary, result)
    except OSError as error:
        troubles.insert(0, f"{summary}: not written: {error.strerror}")
    if request.options.table is not None:
        from orchard.tables.folder import (
            complete,
        )  # not at the top: pyarrow takes some time to load

        troubles += complete(request.options.table, result)
    for trouble in troubles:
        print_error(trouble)
    return FAILED if troubles or (console.has_lost and errors.has_lost) else FINISHED


def _print_result_lines(*objects: Any) -> None:
    """Print parts of the result on stdout; on stderr if stdout has lost something, because its disk is full."""
    for output in (console, errors):
        for one in objects:
            output.print(one, markup=False, soft_wrap=isinstance(one, str))
        if not output.has_lost:
            return


def _what_to_try(request: RunRequest) -> str:
    """The command that asks how many carriers are worth it, for the orchard of the run as it was typed."""
    options, scenario = request.options, request.scenario
    more = "" if options.verbose else "--verbose shows all figures"
    if (
        request.resumed is not None
        or (options.scenario is None and options.replay)
        or scenario.agents
        or not scenario.sensors.are_exact
    ):
        return f"To try next: {more or typed('view')}"
    changes = {
        name: value for name, value in options.changes.items() if name not in ("carriers", "seed")
    }
    varied = [
        word
        for one in ("carriers", *(f"{name}={value}" for name, value in changes.items()))
        for word in ("--vary", one)
    ]
    asked = typed(
        "study", *([options.scenario] if options.scenario else []), *(varied if changes else [])
    )
    return f"To try next: {asked} tells how many carriers are worth it" + (
        f"; {more}" if more else ""
    )


def speed_not_kept(request: RunRequest, outcome: Outcome) -> str:
    """What to say if the machine was too slow for the speed, of a resumed run since then; '' if it was not."""
    before, pace = request.resumed, request.options.pace
    took = outcome.wall_seconds - (before.figures.get("wall_seconds", 0.0) if before else 0.0)
    simulated = outcome.sim_seconds - (before.tick * TIME_STEP if before else 0.0)
    if pace == math.inf or took - simulated / pace <= max(LATE_SECONDS, LATE_SHARE * took):
        return ""
    return f"the speed of {pace:g} times real time was not kept: the machine reached {simulated / took:.1f}"


def program() -> str:
    """Return the words with which a user starts this program again in the current directory."""
    started, python = Path(sys.argv[0]), _shown(Path(sys.executable))
    if started.name == "__main__.py":
        return f"{python} -m orchard"
    if started.suffix == ".py":
        return f"{python} {_shown(started)}"
    return started.name if shutil.which(started.name) == str(started) else _shown(started)


def typed(*words: object) -> str:
    """Return a command of this program as a user types it in the current directory, with short paths."""
    return f"{program()} {shlex.join(_shown(word) if isinstance(word, Path) else str(word) for word in words)}"


def _shown(path: Path) -> str:
    try:
        relative = os.path.relpath(path)
    except OSError:  # the current directory has been removed
        return str(path)
    if relative.startswith(".."):
        return str(path)
    return f"./{relative}" if relative.startswith("-") else relative  # or it is an option


WANTED = {  # pydantic's name of a fault -> what would be right
    "int_parsing": "a whole number",
    "float_parsing": "a number",
    "greater_than_equal": "a number from {ge:g} on",
    "less_than_equal": "a number up to {le:g}",
}


def fault_of(error: TyperException) -> str:
    """Return what is wrong, where, and what would be right: "--rows: x: expected a whole number"."""
    hint = ""
    if isinstance(error, BadParameter) and (error.param_hint or error.param):
        hint = str(error.param_hint or (error.param and error.param.get_error_hint())).strip("'")
    if isinstance(error, BadParameter) and not error.message:
        return f"{hint} is missing; see --help"
    if option := getattr(error, "option_name", ""):
        return f"{option}: {_of_option(error)}"
    if not isinstance(error, BadParameter):
        return re.sub(
            r"^Got unexpected extra .*\((.*)\)$",
            r"\1: one word too many; see --help",
            error.format_message(),
        )
    where = f"{hint}: " if hint.startswith("-") else ""  # an argument is named by its value
    if not isinstance(cause := error.__cause__, ValidationError):
        return f"{where}{error.message}"
    fault = cause.errors()[0]
    given = fault.get("ctx", {})
    if "error" in given:
        return f"{where}{given['error']}"
    return (
        f"{where}{fault['input']}: expected {WANTED.get(fault['type'], 'a number').format(**given)}"
    )


def _of_option(error: TyperException) -> str:
    if not hasattr(error, "possibilities"):
        return (
            "it has no value" if "not take" in error.message else "a value is missing; see --help"
        )
    return (
        f"no such option; did you mean {near}?"
        if (near := " or ".join(error.possibilities or []))
        else "no such option; see --help"
    )
