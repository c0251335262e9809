"""The commands that harvest: `orchard`, `orchard harvest` and `orchard replay`."""

from functools import partial

import typer

from orchard.launch.beginning import beginning_of
from orchard.launch.harvest import carry_out
from orchard.launch.options import HarvestOptions, ReplayOptions
from orchard.terminal.options import with_options


@with_options(HarvestOptions)
def harvest(chosen: HarvestOptions) -> None:
    """Harvest an orchard to the end."""
    raise typer.Exit(carry_out(chosen, partial(beginning_of, chosen)))


@with_options(ReplayOptions)
def replay(chosen: ReplayOptions) -> None:
    """Let the velocities in a bag drive its robots again: docs/ros2.md.

    The harvest has any of its options.
    """
    raise typer.Exit(carry_out(chosen, partial(beginning_of, chosen)))
