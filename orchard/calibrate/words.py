"""What a calibration prints: the table of what was fitted, the test, and the scenario's file."""

import math
from collections.abc import Iterator

from rich.table import Table

from orchard.calibrate.estimates import FittedValue
from orchard.calibrate.fit import Fit
from orchard.calibrate.last_day import LastDay
from orchard.calibrate.spreads import WHAT_DIFFERS
from orchard.field.problems import printable
from orchard.field.scenario import to_short_yaml
from orchard.terminal.output import table

# The first line of a scenario that was fitted, by which its file is known.
HEADING = "# Fitted by `orchard calibrate` to a log of bins."


def fitted_table(fitted: Fit, confidence: float) -> Table:
    """Return what was fitted: value, interval, and the key of the scenario that has it."""
    interval = f"{100.0 * confidence:g} % interval"
    caption = "the intervals are those of these pickers, carriers and days"
    shown = table(caption, "fitted", "value", interval, "key")
    picking = fitted.picking
    shown.add_row("picking rate, bins/h", *_cells(picking.rate), "picking_rate")
    shown.add_row("rows differ by, %", *_cells(picking.between_rows, 100.0), "picking.spread.cv")
    if picking.between_pickers is not None:
        cells = _cells(picking.between_pickers, 100.0)
        shown.add_row("pickers differ by, %", *cells, "picking.spread_of_pickers.cv")
    if picking.between_bins is not None:
        cells = _cells(picking.between_bins, 100.0)
        shown.add_row("bins of a row differ by, %", *cells, "picking.spread_of_bins.cv")
    driving = fitted.driving
    if driving is not None and driving.speed is not None:
        shown.add_row("speed of carriers, m/s", *_cells(driving.speed), "carrying.speed")
    if driving is not None:
        shown.add_row("time in the bay, s", *_cells(driving.unloading), "handling.unloading")
    return shown


def _cells(estimate: FittedValue, scale: float = 1.0) -> tuple[str, str]:
    """Return a value and its interval."""
    low = f"{scale * estimate.low:.3g}"
    high = f"{scale * estimate.high:.3g}"
    return f"{scale * estimate.value:.3g}", f"{low} to {high}"


def parts_sentence(fitted: Fit) -> str:
    """Return how much of what differs is of pickers, of rows and of bins: "" if a part is unknown.

    The parts are shares of the variance of a bin's time. The deviation of the whole is the root of
    the sum of their squares.
    """
    squares = {}
    for key, of_log in fitted.picking.spreads.items():
        if of_log is None:
            return ""
        squares[WHAT_DIFFERS[key]] = of_log.value**2
    whole = sum(squares.values())
    if whole <= 0.0:
        return ""
    in_order = sorted(squares.items(), key=lambda item: -item[1])
    shares = [f"{what} {100.0 * square / whole:.0f} %" for what, square in in_order]
    return (
        f"times of bins differ by {100.0 * math.sqrt(whole):.3g} % in all; shares of the variance:"
        f" {', '.join(shares)}"
    )


def rates_sentence(fitted: Fit) -> str:
    """Return what each picker fills while it picks."""
    in_order = sorted(fitted.picking.rates.items(), key=lambda item: -item[1])
    shares = [f"{printable(name)} {rate:.3g}" for name, rate in in_order]
    return f"bins an hour of each while it picks: {', '.join(shares)}"


def tested_sentences(tested: LastDay, confidence: float) -> Iterator[str]:
    """Yield how well the fit predicts the day that it did not see."""
    expected = f"{tested.low:.3g} to {tested.high:.3g}"
    yield (
        f"{tested.day}, which the fit did not see: {tested.logged:.3g} bins an hour"
        f" ({tested.bins} bins, {tested.pickers} pickers, {tested.carriers} carriers); predicted"
        f" {tested.predicted:.3g}, with {100.0 * confidence:g} % from {expected}"
    )
    if not tested.is_as_predicted:
        yield (
            "so the fit does not hold on that day: look for what was different, such as a break"
            " that shift.breaks does not have, or other rows"
        )


def scenario_text(fitted: Fit, file: str) -> str:
    """Return the text of the scenario's file. `file`: the log."""
    return f"{HEADING}\n# {file}: {fitted.picking.count} picking times\n" + to_short_yaml(
        fitted.scenario
    )
