"""What the command `orchard calibrate` does: it reads a log, and prints and writes what fits it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from rich.progress import TextColumn

from orchard.calibrate.bins import LoggedBins, bins_of
from orchard.calibrate.fit import Fit, fit
from orchard.calibrate.last_day import RUNS, check_on_day, split_last_day, why_untested
from orchard.calibrate.log_lines import BinLog, read_log
from orchard.calibrate.options import CalibrationOptions
from orchard.calibrate.structure import LogOrchard, orchard_of
from orchard.calibrate.words import (
    HEADING,
    fitted_table,
    parts_sentence,
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


@dataclass(frozen=True)
class _Evidence:
    """What a fit rests on.

    `logged`: the bins of the log; their rows have the numbers of the orchard's scenario.
    """

    log: BinLog
    logged: LoggedBins
    orchard: LogOrchard


def _calibrate(chosen: CalibrationOptions) -> None:
    """Fit, test, print and write, and leave errors to the caller.

    Raises ScenarioError, OSError, Jam; ValueError or NotImplementedError for what the event model
    does not know.
    """
    evidence = _read(chosen)
    fitted, test = _fit_and_test(evidence, chosen.confidence)
    print_line(_heading(evidence))
    console.print(fitted_table(fitted, chosen.confidence))
    parts = parts_sentence(fitted)
    if parts:
        print_line(parts)
    if any(fitted.picking.rates):
        print_line(rates_sentence(fitted))
    for sentence in test:
        print_line(sentence)
    _print_notes([*evidence.log.notes, *evidence.orchard.notes, *fitted.notes])
    _print_notes([*evidence.logged.gaps, *fitted.left_out])
    if chosen.out is not None:
        write_whole(chosen.out, scenario_text(fitted, evidence.log.file).encode())
        print_line(f"{chosen.out}: to ask it, orchard study {chosen.out}")


def _read(chosen: CalibrationOptions) -> _Evidence:
    """Read the log, and the user's scenario if there is one."""
    users_scenario = None
    users_file = ""
    shift = WorkShift()
    if chosen.on is not None:
        users_scenario = load_or_shipped(chosen.on)
        users_file = printable(str(chosen.on))
        shift = users_scenario.shift
    if chosen.out is not None:
        check_writable(chosen.out, chosen.log, SCENARIO)
    log = read_log(chosen.log)
    logged = bins_of(log, shift)
    if not logged.bins:
        raise ScenarioError([Problem(log.file, "has no full bin; must have lines with full")])
    orchard = orchard_of(log, logged.bins, users_scenario, users_file)
    return _Evidence(log, replace(logged, bins=orchard.bins), orchard)


def _fit_and_test(evidence: _Evidence, confidence: float) -> tuple[Fit, list[str]]:
    """Return the fit to all days but the last one, and in words how well it predicts the last one.

    Where the last day is no test, the words say why. A log of one day is fitted whole.
    """
    logged = evidence.logged
    orchard = evidence.orchard
    days_before, last_day = split_last_day(logged)
    with _progress() as tell:
        fitted = fit(
            days_before,
            orchard.base,
            orchard.has_rows,
            evidence.log.file,
            confidence,
            is_assumed=orchard.is_assumed,
        )
        untested = why_untested(last_day, logged.silences, fitted.scenario.pickers)
        if untested:
            return fitted, [untested]
        tested = check_on_day(fitted, last_day, logged.silences, confidence, tell)
    return fitted, list(tested_sentences(tested, confidence))


def _heading(evidence: _Evidence) -> str:
    """Return what the log holds, in words."""
    bins = evidence.logged.bins
    days = len({of_log.day for of_log in bins})
    span = f"{days} days"
    if days == 1:
        span = "one day"
    return f"{evidence.log.file}: {len(bins)} bins of {span}"


def _print_notes(notes: Sequence[str]) -> None:
    """Print at most MOST_NAMED notes, then how many more there are."""
    for note in notes[:MOST_NAMED]:
        print_line(f"- {note}")
    if len(notes) > MOST_NAMED:
        print_line(f"- and {len(notes) - MOST_NAMED} more")


@contextmanager
def _progress() -> Iterator[Callable[[int], None]]:
    """Show in this context on a terminal how far the calibration is.

    It yields a function that takes the number of test runs that are done.
    """
    with bar(TextColumn("{task.description}", markup=False)) as shown:
        task = shown.add_task("fits the log", total=RUNS)

        def tell(runs: int) -> None:
            shown.update(task, completed=runs, description="predicts the last day")

        yield tell
