"""The options of an import: what a user says of a file of rows, where the file does not say it.

Also the result of an import. Messages to users show commands with these options, ready to be run.
"""

import shlex
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from orchard.field.scenario import Scenario

# What lines are: lanes, which a picker drives, or lines of trees, between which the lanes lie.
Lines = Literal["lanes", "trees"]
LANES: Lines = "lanes"
TREES: Lines = "trees"
# Commands in a message, at most: a block or a layer has one each.
MOST_COMMANDS = 20


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """How a file is understood. `orchard layout import` has an option for each field."""

    #: The coordinate system of the file; None: the one that the file names.
    crs: str | None = None
    #: LANES or TREES; None: trees if the file has points, else lanes.
    lines: Lines | None = None
    #: Whether the first coordinate is the northing; None: the user does not say it, and an import
    #: fails with the question where it seems so.
    swap_coordinates: bool | None = None
    #: The layer of a GeoPackage; None: it has only one.
    layer: str | None = None
    #: The block that is taken; None: all.
    block: str | None = None
    #: Names of features that are no rows.
    without: tuple[str, ...] = ()
    #: Direction of the rows in a block's outline, degrees clockwise from north.
    direction: float | None = None
    #: m between these rows. With it a polygon is the outline of a block.
    spacing: float | None = None
    #: m without trees at both ends of these rows.
    headland: float | None = None

    def command(self, file: str, **changes: Any) -> str:
        """Return the command line of an import of a file, with changes of these options.

        An option is named like its field. Only `swap_coordinates` has two: --swap-coordinates and
        --keep-coordinates.
        """
        words = ["orchard", "layout", "import", file]
        changed = replace(self, **changes)
        for field in fields(changed):
            value = getattr(changed, field.name)
            name = f"--{field.name.replace('_', '-')}"
            if value is False:
                words.append("--keep-coordinates")
            elif value is True:
                words.append(name)
            elif isinstance(value, tuple):
                for item in value:
                    words += [name, item]
            elif isinstance(value, float):
                words += [name, f"{value:g}"]
            elif value is not None:
                words += [name, value]
        return shlex.join(words)


class Imported(NamedTuple):
    """A scenario from a file."""

    scenario: Scenario
    #: What was left out, joined or assumed, a sentence each.
    notes: list[str]
    #: Of the middle of all rows, degrees.
    latitude: float
    #: Of the middle of all rows, degrees.
    longitude: float
    #: Of the rows, clockwise from north, degrees from 0 to 180.
    direction: float


class Source(NamedTuple):
    """A file that is read, and what a user says of it."""

    #: Its name, for people: of an archive, if it is a file in one.
    file: str
    #: Where it is read from.
    path: Path
    options: ImportOptions

    def command(self, **changes: Any) -> str:
        """Return the command of an import of this file, with changes of its options."""
        return self.options.command(self.file, **changes)
