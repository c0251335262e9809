"""The command `orchard trace`: what each robot does when in a harvest of the event model."""

from dataclasses import dataclass
from pathlib import Path

import typer

from orchard.event_model.known import refuse_unknown
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.shipped import load_or_shipped
from orchard.terminal.exits import FAILED, exit_on_errors
from orchard.terminal.files import KindOfFile, check_writable
from orchard.terminal.options import File, option, with_options
from orchard.terminal.output import own_classes_run, print_error, print_line


@dataclass(frozen=True, kw_only=True)
class TraceOptions:
    """The options of `trace`."""

    scenario: File = None
    out: Path | None = option(None, "Write the trace to this file.", "FILE.txt")


# Each line of a trace begins so: 0:00:12.5  carrier_01
TRACE = KindOfFile("a trace", rb"\d+:\d\d:\d\d\.\d  \w+  ")


@with_options(TraceOptions)
def trace(chosen: TraceOptions) -> None:
    """Tell what each robot does when in a harvest of the event model: docs/design.md.

    Its sensors must be exact, and its agents built-in ones.
    """
    with own_classes_run(), exit_on_errors(ScenarioError, OSError, ValueError, RuntimeError):
        print_trace(chosen)


def print_trace(chosen: TraceOptions) -> None:
    """Print or write the trace of a scenario.

    Raises ScenarioError, OSError, PolicyFault, or ValueError for a scenario that the event model
    does not know; typer.Exit if the file cannot be written.
    """
    scenario = load_or_shipped(chosen.scenario)
    refuse_unknown(scenario)
    if chosen.out is not None:
        check_writable(chosen.out, chosen.scenario, TRACE)
    # Loaded only now, after the checks: it loads numba, which takes a second.
    from orchard.event_model.trace import trace as traced

    try:
        lines = list(traced(lay_out(scenario)))
    except NotImplementedError as error:
        raise ValueError(str(error)) from error
    if chosen.out is None:
        for line in lines:
            print_line(line)
    else:
        try:
            chosen.out.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        except OSError as error:
            print_error(f"{chosen.out}: not written: {error.strerror}")
            raise typer.Exit(FAILED) from None
        print_line(f"{chosen.out}: {len(lines)} lines")
