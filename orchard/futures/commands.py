"""The command `orchard fork`."""

from functools import partial

import typer

from orchard.folders import runs_folder
from orchard.futures.fork import beginning_of_fork
from orchard.futures.options import ForkOptions
from orchard.launch.harvest import carry_out
from orchard.launch.run_folder import RunFolder
from orchard.terminal.exits import needs_extra
from orchard.terminal.options import with_options


@with_options(ForkOptions)
def fork(chosen: ForkOptions) -> None:
    """Go on with a run from any moment, with something changed: docs/how-to.md."""
    if not chosen.asks_for_futures:
        raise typer.Exit(carry_out(chosen, partial(beginning_of_fork, chosen)))
    chosen.check()
    with needs_extra("Several futures", "study"):
        from orchard.futures.answers import run_futures
    raise typer.Exit(run_futures(chosen, RunFolder(runs_folder())))
