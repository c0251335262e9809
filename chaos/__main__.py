"""Inject random faults into random harvests and check the results.

Then check that memory stays constant over a long run.

    python -m chaos [--seconds 600] [--seed 1]
    python -m chaos --seed 1 --only 17
    python -m chaos endurance

The exit code is 1 if a promise is broken. A soak of ten minutes or more includes the endurance test
and writes chaos/results.md.
"""

import itertools
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable
from datetime import date
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from chaos.endurance import LOCAL_MODE, TICKS, endure
from chaos.harvest import ROOT
from chaos.mistakes import MISTAKEN
from chaos.report import Results, as_tables, markdown
from chaos.soak import soak

# s of wall time. A soak of this length or more includes the endurance test, and writes TARGET.
FULL_SECONDS = 600.0
TARGET = ROOT / "chaos" / "results.md"
# A guess for the progress bar, for both modes of the endurance test together.
ENDURANCE_TICKS_PER_SECOND = 500

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
console = Console(highlight=False)


@app.callback(invoke_without_command=True)
def chaos(
    context: typer.Context,
    seconds: Annotated[
        float, typer.Option(min=1.0, help="Start no further run after so many seconds.")
    ] = FULL_SECONDS,
    seed: Annotated[
        int, typer.Option(help="The same seed gives the same runs and the same faults.")
    ] = 1,
    only: Annotated[
        int | None, typer.Option(min=0, help="Repeat only the run with this number.")
    ] = None,
) -> None:
    """Inject random faults into random harvests and check the results."""
    if context.invoked_subcommand is not None:
        return
    is_full = only is None and seconds >= FULL_SECONDS
    results = Results(seed, date.today().isoformat())
    numbers: Iterable[int] = itertools.count()
    if only is not None:
        numbers = [only]
    # The unit of the bar is a second.
    length = seconds
    if is_full:
        length += TICKS / ENDURANCE_TICKS_PER_SECOND
    begun = time.monotonic()
    with _progress(length) as progress:
        show = _shown(progress)

        def show_endurance(tick: int, mode: str) -> None:
            """Show how far the endurance test is."""
            show(seconds + tick / ENDURANCE_TICKS_PER_SECOND, f"{mode}: tick {tick}")

        results.verdicts = soak(seed, numbers, seconds, show, _say)
        results.seconds = time.monotonic() - begun
        if is_full:
            results.endurance = endure(show_endurance)
    results.load = os.getloadavg()[0]
    if is_full:
        TARGET.write_text(markdown(results))
        _say(f"wrote {TARGET.relative_to(ROOT)}")
    _finish(results)


@app.command()
def endurance() -> None:
    """Check that memory and file handles stay constant over 100,000 ticks."""
    # The unit of the bar is a tick: first those of lockstep, then those of local mode.
    with _progress(2 * TICKS) as progress:
        show = _shown(progress)

        def show_tick(tick: int, mode: str) -> None:
            """Show how far the test is."""
            done = tick
            if mode == LOCAL_MODE:
                done += TICKS
            show(done, mode)

        found = endure(show_tick)
    _finish(Results(endurance=found))


def _progress(total: float) -> Progress:
    """Return a bar of some length."""
    progress = Progress(
        BarColumn(30),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
        console=console,
        transient=True,
    )
    progress.add_task("", total=total)
    return progress


def _shown(progress: Progress) -> Callable[[float, str], None]:
    """Return a function that shows how much is done, and of what."""

    def show(done: float, description: str) -> None:
        progress.update(progress.task_ids[0], completed=done, description=description)

    return show


def _say(line: str) -> None:
    """Print a line above the bar."""
    console.print(line, markup=False, soft_wrap=True)


def _finish(results: Results) -> None:
    """Print all tables and exit: with code 1 if a promise is broken."""
    for table in as_tables(results):
        console.print(table)
    raise typer.Exit(0 if results.is_good else 1)


def _exit_of_signal(number: int, frame: object) -> None:
    """Raise SystemExit, so that each `with` statement ends its processes.

    The code is that with which a shell reports a process that died of this signal.
    """
    sys.exit(128 + number)


def _is_unexpected(record: logging.LogRecord) -> bool:
    """Whether a line of the log is not about the agent whose mistakes are wanted."""
    return not record.getMessage().startswith(f"{MISTAKEN} ")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, _exit_of_signal)
    logging.getLogger("orchard").addFilter(_is_unexpected)
    app()
