"""The command `orchard calibrate`."""

import typer

from orchard.calibrate.options import CalibrationOptions
from orchard.terminal.exits import needs_extra
from orchard.terminal.options import with_options


@with_options(CalibrationOptions)
def calibrate(chosen: CalibrationOptions) -> None:
    """Fit a scenario to a log of bins, and test it on the log's last day: docs/how-to.md."""
    with needs_extra("A calibration", "study", ", or in a clone: make study"):
        from orchard.calibrate.command import run_calibration
    raise typer.Exit(run_calibration(chosen))
