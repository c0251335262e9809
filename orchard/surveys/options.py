"""What a user says of a file of rows, where the file does not say it; and what came of it."""

import shlex
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from orchard.field.scenario import Scenario

# What lines are: lanes, which a picker drives, or lines of trees, between which the lanes lie.
Lines = Literal["lanes", "trees"]
LANES: Lines = "lanes"
TREES: Lines = "trees"


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """How a file is understood. `orchard layout import` has an option for each field."""

    #: The coordinate system of the file; None: the one that the file names.
    crs: str | None = None
    #: LANES or TREES; None: trees if the file has points, else lanes.
    lines: Lines | None = None
    #: Whether the first coordinate is the northing; None: asked, where that is likely.
    swap_coordinates: bool | None = None
    #: The layer of a GeoPackage; None: it has one.
    layer: str | None = None
    #: The block that is taken; None: all.
    block: str | None = None
    #: Names of features that are no rows.
    without: tuple[str, ...] = ()
    #: Of the rows in a block's outline: clockwise from north, degrees; m between them; m without
    #: trees at both ends.
    direction: float | None = None
    spacing: float | None = None
    headland: float | None = None

    def command(self, file: str, **changes: Any) -> str:
        """Return the command of an import of a file, with changes of these options."""
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
    #: Latitude and longitude of the middle, degrees.
    latitude: float
    longitude: float
    #: Of the rows, clockwise from north, degrees from 0 to 180.
    direction: float


class Source(NamedTuple):
    """A file that is read, and what a user says of it."""

    #: Its name, for people.
    file: str
    path: Path
    options: ImportOptions

    def command(self, **changes: Any) -> str:
        """Return the command of an import of this file, with changes of its options."""
        return self.options.command(self.file, **changes)
