"""What the command `orchard calibrate` does: it reads a log, and prints and writes what fits it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from rich.progress import TextColumn

from orchard.calibrate.bins import LoggedBin, bins_of
from orchard.calibrate.fit import fit
from orchard.calibrate.last_day import RUNS, check_on_day, split_last_day, why_untested
from orchard.calibrate.log_lines import BinLog, read_log
from orchard.calibrate.options import CalibrationOptions
from orchard.calibrate.structure import orchard_of
from orchard.calibrate.words import (
    HEADING,
    fitted_table,
    rates_sentence,
    scenario_text,
    tested_sentences,
)
from orchard.discrete.harvest import Jam
from orchard.field.problems import MOST_NAMED, Problem, ScenarioError, printable
from orchard.field.scenario import WorkShift
from orchard.field.shipped import load_or_shipped
from orchard.folders import write_whole
from orchard.terminal.exits import FINISHED, exit_on_errors
from orchard.terminal.files import KindOfFile, check_writable
from orchard.terminal.output import bar, console, own_classes_run, print_line

SCENARIO = KindOfFile("a scenario of `orchard calibrate`", HEADING.encode())


def run_calibration(chosen: CalibrationOptions) -> int:
    """Fit a scenario to a log, test it, and print and write it. Return the exit code."""
    mistakes = (ScenarioError, OSError, Jam, ValueError, NotImplementedError)
    with own_classes_run(), exit_on_errors(*mistakes):
        _calibrate(chosen)
    return FINISHED


def _calibrate(chosen: CalibrationOptions) -> None:
    """Do it. Raises ScenarioError, OSError, Jam, and ValueError for what the model knows not."""
    on = None if chosen.on is None else load_or_shipped(chosen.on)
    if chosen.out is not None:
        check_writable(chosen.out, chosen.log, SCENARIO)
    log = read_log(chosen.log)
    shift = WorkShift() if on is None else on.shift
    logged = bins_of(log, shift)
    if not logged.bins:
        raise ScenarioError([Problem(log.file, "has no full bin; must have lines with full")])
    orchard = orchard_of(log, logged.bins, on, printable(str(chosen.on)))
    logged = replace(logged, bins=orchard.bins)
    earlier, of_day = split_last_day(logged)
    days = len({of_log.day for of_log in logged.bins})
    with _progress() as tell:
        fitted = fit(
            earlier,
            orchard.base,
            orchard.has_rows,
            log.file,
            chosen.confidence,
            is_assumed=orchard.is_assumed,
        )
        untested = why_untested(of_day, logged.silences, fitted.scenario.pickers)
        tested = None
        if not untested:
            tested = check_on_day(fitted, of_day, logged.silences, chosen.confidence, tell)
    print_line(_heading(log, logged.bins, days))
    console.print(fitted_table(fitted, chosen.confidence))
    if any(fitted.picking.rates):
        print_line(rates_sentence(fitted))
    if tested is None:
        print_line(untested)
    else:
        for sentence in tested_sentences(tested, chosen.confidence):
            print_line(sentence)
    _print_notes([*log.notes, *orchard.notes, *fitted.notes])
    _print_notes([*logged.gaps, *fitted.left_out])
    if chosen.out is not None:
        write_whole(chosen.out, scenario_text(fitted, log.file).encode())
        print_line(f"{chosen.out}: orchard study {chosen.out} asks it")


def _heading(log: BinLog, bins: Sequence[LoggedBin], days: int) -> str:
    """Return what the log holds, in words."""
    words = f"{log.file}: {len(bins)} bins of {days} days"
    return words if days > 1 else f"{log.file}: {len(bins)} bins of one day"


def _print_notes(notes: Sequence[str]) -> None:
    """Print what was assumed, or left out; of very many the first ones, and how many more."""
    for note in notes[:MOST_NAMED]:
        print_line(f"- {note}")
    if len(notes) > MOST_NAMED:
        print_line(f"- and {len(notes) - MOST_NAMED} more")


@contextmanager
def _progress() -> Iterator[Callable[[int], None]]:
    """Show how far it is on a terminal."""
    with bar(TextColumn("{task.description}", markup=False)) as shown:
        task = shown.add_task("fits the log", total=RUNS)

        def tell(runs: int) -> None:
            shown.update(task, completed=runs, description="predicts the last day")

        yield tell
