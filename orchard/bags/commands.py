"""The command `orchard export`: makes a bag of ROS 2 from a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from orchard.folders import runs_folder
from orchard.terminal.exits import exit_on_errors, needs_extra
from orchard.terminal.options import Recording, flag, option, with_options
from orchard.view.files import existing_recording


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """The options of an export."""

    recording: Recording = None
    mcap: Annotated[Path, Option(metavar="FILE.mcap", help="File of the bag.")]
    robots: list[str] | None = option(
        None,
        "Bodies that are in it (repeatable). Default: pickers, carriers and the tractor.",
        "KIND|NAME",
    )
    with_scans: bool = flag(
        None,
        "--with-scans",
        "The scans too, as they are recorded: every second beam, twice a second.",
    )


@with_options(ExportOptions)
def export(chosen: ExportOptions) -> None:
    """Make a bag of ROS 2 from a recording, with all its parts.

    It holds the clock, transforms, odometry and velocities of the robots.
    """
    with needs_extra("A bag", "ros2-export"):
        from orchard.bags.export_command import export_bag
    with exit_on_errors(OSError, ValueError):
        recording = existing_recording(chosen.recording, runs_folder())
    raise typer.Exit(export_bag(recording, chosen.mcap, chosen.robots or [], chosen.with_scans))
