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
from collections.abc import Callable
from datetime import date
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from chaos.endurance import TICKS, endure
from chaos.harvest import ROOT
from chaos.mistakes import MISTAKEN
from chaos.report import Results, as_tables, markdown
from chaos.soak import soak

FULL_SECONDS = 600.0
TARGET = ROOT / "chaos" / "results.md"

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
    begun = time.monotonic()
    with _progress(seconds + TICKS / 500 * is_full) as progress:
        results.verdicts = soak(
            seed, itertools.count() if only is None else [only], seconds, _shown(progress), _say
        )
        results.seconds = time.monotonic() - begun
        if is_full:
            results.endurance = endure(
                lambda tick, mode: _shown(progress)(seconds + tick / 500, f"{mode}: tick {tick}")
            )
    results.load = os.getloadavg()[0]
    if is_full:
        TARGET.write_text(markdown(results))
        _say(f"wrote {TARGET.relative_to(ROOT)}")
    _finish(results)


@app.command()
def endurance() -> None:
    """Check that memory and file handles stay constant over 100,000 ticks."""
    with _progress(2 * TICKS) as progress:
        found = endure(
            lambda tick, mode: _shown(progress)(tick + TICKS * (mode == "local mode"), mode)
        )
    _finish(Results(endurance=found))


def _progress(total: float) -> Progress:
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
    return lambda done, description: progress.update(
        progress.task_ids[0], completed=done, description=description
    )


def _say(line: str) -> None:
    console.print(line, markup=False, soft_wrap=True)


def _finish(results: Results) -> None:
    """Print all tables and exit: with code 1 if a promise is broken."""
    for table in as_tables(results):
        console.print(table)
    raise typer.Exit(0 if results.is_good else 1)


if __name__ == "__main__":
    signal.signal(
        signal.SIGTERM, lambda number, frame: sys.exit(128 + number)
    )  # an exception, so that each `with` ends its processes
    logging.getLogger("orchard").addFilter(
        lambda record: not record.getMessage().startswith(f"{MISTAKEN} ")
    )  # its mistakes are wanted
    app()
