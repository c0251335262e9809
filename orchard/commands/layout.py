"""The commands `orchard layout`: import the rows of a survey, export the roads of an orchard."""

from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Annotated

from typer import Argument, Option

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import Scenario, to_short_yaml
from orchard.field.survey import Survey
from orchard.folders import write_whole
from orchard.report.plan import orchard_plan
from orchard.surveys.importing import import_survey
from orchard.surveys.options import Imported, ImportOptions, Lines
from orchard.terminal.catalogue import CommandEntry
from orchard.terminal.exits import exit_on_errors, needs_extra
from orchard.terminal.group import LazyGroup
from orchard.terminal.output import print_error, print_line

_ROWS = "GeoJSON, KML, CSV, GeoPackage or Shapefile of rows, trees or an outline."
_SYSTEM = "Their coordinate system, such as EPSG:2193. Default: the one that the file names."
_NEW_SCENARIO = "A new file for the scenario. Default: stdout."
_PLAN = "Draw the orchard."
_LINES = "What the lines are. Default: lanes; points are trees."
_SWAP = "The file has the northing, or the latitude, first."
_LAYER = "The layer of a GeoPackage that has the rows."
_BLOCK = "Only the rows of this block."
_WITHOUT = "A feature that is no row (repeatable)."
_DIRECTION = "Of rows in an outline: clockwise from north."
_SPACING = "Of rows in an outline: from one to the next."
_HEADLAND = "Of rows in an outline: without trees at both ends."
_OUTLINE = "The outline of a block"
SurveyPath = Annotated[Path, Argument(metavar="FILE", help=_ROWS, show_default=False)]
System = Annotated[str | None, Option("--crs", metavar="NAME", help=_SYSTEM)]
NewScenario = Annotated[Path | None, Option("--out", metavar="SCENARIO.yaml", help=_NEW_SCENARIO)]
Plan = Annotated[Path | None, Option("--plan", metavar="FILE.svg", help=_PLAN)]
LinesAre = Annotated[Lines | None, Option("--lines", help=_LINES)]
Swap = Annotated[bool | None, Option("--swap-coordinates/--keep-coordinates", help=_SWAP)]
Layer = Annotated[str | None, Option("--layer", metavar="NAME", help=_LAYER)]
OnlyBlock = Annotated[str | None, Option("--block", metavar="NAME", help=_BLOCK)]
Without = Annotated[list[str] | None, Option("--without", metavar="NAME", help=_WITHOUT)]
Direction = Annotated[
    float | None,
    Option("--direction", metavar="DEGREES", help=_DIRECTION, rich_help_panel=_OUTLINE),
]
Spacing = Annotated[
    float | None, Option("--spacing", metavar="METRES", help=_SPACING, rich_help_panel=_OUTLINE)
]
Headland = Annotated[
    float | None, Option("--headland", metavar="METRES", help=_HEADLAND, rich_help_panel=_OUTLINE)
]


layout = LazyGroup(
    {
        "import": CommandEntry("orchard.commands.layout", "write_scenario", "from surveyed rows"),
        "export": CommandEntry("orchard.roads.commands", "write_map", "as a map for fleet control"),
    },
    name="layout",
    help="Import rows of your own, export the roads of an orchard.",
    no_args_is_help=True,
)


def write_scenario(
    file: SurveyPath,
    out: NewScenario = None,
    plan: Plan = None,
    *,
    crs: System = None,
    lines: LinesAre = None,
    swap_coordinates: Swap = None,
    layer: Layer = None,
    block: OnlyBlock = None,
    without: Without = None,
    spacing: Spacing = None,
    direction: Direction = None,
    headland: Headland = None,
) -> None:
    """Make a scenario from surveyed rows."""
    options = ImportOptions(
        crs=crs,
        lines=lines,
        swap_coordinates=swap_coordinates,
        layer=layer,
        block=block,
        without=tuple(without or ()),
        spacing=spacing,
        direction=direction,
        headland=headland,
    )
    with exit_on_errors(ScenarioError, OSError), needs_extra("An import", "survey"):
        for path, name in ((out, "--out"), (plan, "--plan")):
            if path is not None and path.exists():
                raise FileExistsError(f"{path}: there is such a file; {name} must name a new one")
        imported = import_survey(file, options)
        text = (
            f"# The rows of {printable(file.name)}; `orchard layout import` made this scenario.\n"
            f"{to_short_yaml(imported.scenario)}"
        )
        sizes = _sizes(imported.scenario)
        if plan is not None:
            # A plan has room for the number and the lengths of the rows: up to the first semicolon.
            words = f"{sizes.partition(';')[0]}; {_place(imported)}"
            write_whole(plan, orchard_plan(lay_out(imported.scenario), words).encode())
        # If no file is named, stdout gets the scenario, and stderr the notes on it.
        tell = print_error if out is None else print_line
        if out is None:
            print_line(text.rstrip())
        else:
            write_whole(out, text.encode())
            print_line(f"{out}: {sizes}")
        tell(f"- {_place(imported)}")
        for note in imported.notes:
            tell(f"- {note}")


def _place(imported: Imported) -> str:
    """Return where an orchard lies, and how its rows run, in words."""
    north = "S" if imported.latitude < 0 else "N"
    east = "W" if imported.longitude < 0 else "E"
    return (
        f"middle at {abs(imported.latitude):.5f} {north}, {abs(imported.longitude):.5f} {east};"
        f" rows run {imported.direction:.1f} degrees clockwise from north"
    )


def _sizes(scenario: Scenario) -> str:
    """Return how large the surveyed rows of a scenario are, in words."""
    survey = scenario.survey
    assert isinstance(survey, Survey)
    lengths = [row.length for row in survey.rows]
    # `south` of a row: how far south of the first row it lies, m.
    gaps = [following.south - row.south for row, following in pairwise(survey.rows)]
    ground = lay_out(scenario)
    numbers = range(1, len(lengths) + 1)
    # From each end of each row to the road at this side, m.
    beyond = []
    for number in numbers:
        beyond += [ground.beyond(number, "west"), ground.beyond(number, "east")]
    return (
        f"{len(lengths)} rows, {min(lengths):.2f} to {max(lengths):.2f} m long, "
        f"{min(gaps):.2f} to {max(gaps):.2f} m apart; "
        f"ends from west to east {scenario.row_length:.2f} m apart; "
        f"the roads are straight, and lie up to {max(beyond):.2f} m further out than a row's end, "
        f"on average {fmean(beyond):.2f} m"
    )
