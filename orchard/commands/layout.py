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
from orchard.surveys.importing import import_rows
from orchard.terminal.catalogue import CommandEntry
from orchard.terminal.exits import exit_on_errors, needs_extra
from orchard.terminal.group import LazyGroup
from orchard.terminal.output import print_line

_ROWS = "The centre lines of the rows, a LineString each."
_SYSTEM = "Their coordinate system, such as EPSG:2193. Default: the one that the file names."
_NEW_SCENARIO = "A new file for the scenario. Default: stdout."
GeoJson = Annotated[Path, Argument(metavar="FILE.geojson", help=_ROWS, show_default=False)]
System = Annotated[str | None, Option("--crs", metavar="NAME", help=_SYSTEM)]
NewScenario = Annotated[Path | None, Option("--out", metavar="SCENARIO.yaml", help=_NEW_SCENARIO)]


layout = LazyGroup(
    {
        "import": CommandEntry("orchard.commands.layout", "write_scenario", "from surveyed rows"),
        "export": CommandEntry("orchard.roads.commands", "write_map", "as a map for fleet control"),
    },
    name="layout",
    help="Import rows of your own, export the roads of an orchard.",
    no_args_is_help=True,
)


def write_scenario(file: GeoJson, out: NewScenario = None, crs: System = None) -> None:
    """Make a scenario from surveyed rows."""
    with exit_on_errors(ScenarioError, OSError), needs_extra("An import", "survey"):
        scenario = import_rows(file, crs)
        text = (
            f"# The rows of {printable(file.name)}; `orchard layout import` made this scenario.\n"
            f"{to_short_yaml(scenario)}"
        )
        if out is None:
            print_line(text.rstrip())
            return
        if out.exists():
            raise FileExistsError(f"{out}: there is such a file; --out must name a new one")
        write_whole(out, text.encode())
        print_line(f"{out}: {_sizes(scenario)}")


def _sizes(scenario: Scenario) -> str:
    """Return how large the surveyed rows of a scenario are, in words."""
    survey = scenario.survey
    assert isinstance(survey, Survey)
    lengths = [row.length for row in survey.rows]
    gaps = [south.south - north.south for north, south in pairwise(survey.rows)]
    ground = lay_out(scenario)
    numbers = range(1, len(lengths) + 1)
    beyond = [ground.beyond(number, side) for number in numbers for side in ("west", "east")]
    return (
        f"{len(lengths)} rows, {min(lengths):.2f} to {max(lengths):.2f} m long, "
        f"{min(gaps):.2f} to {max(gaps):.2f} m apart; "
        f"ends from west to east {scenario.row_length:.2f} m apart; "
        f"the roads are straight, and lie up to {max(beyond):.2f} m further out than a row's end, "
        f"on average {fmean(beyond):.2f} m"
    )
