"""The command `orchard layout import`: writes a scenario with the rows of a survey."""

from itertools import pairwise

from orchard.field.geojson import import_rows
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import Scenario, to_short_yaml
from orchard.field.survey import Survey
from orchard.folders import write_whole
from orchard.launch import options
from orchard.launch.terminal import exit_on_errors, needs_extra, print_line


def write_scenario(file: options.GeoJson, out: options.NewScenario = None, crs: options.System = None) -> None:
    """Make a scenario from surveyed rows."""
    with exit_on_errors(ScenarioError, OSError), needs_extra("An import", "survey"):
        scenario = import_rows(file, crs)
        text = f"# The rows of {printable(file.name)}; `orchard layout import` made this scenario.\n{to_short_yaml(scenario)}"
        if out is None:
            print_line(text.rstrip())
            return
        if out.exists():
            raise FileExistsError(f"{out}: there is such a file; --out must name a new one")
        try:
            write_whole(out, text.encode())
        except OSError as error:
            raise OSError(f"{out}: not written: {error.strerror}") from error
        print_line(f"{out}: {_sizes(scenario)}")


def _sizes(scenario: Scenario) -> str:
    survey = scenario.survey
    assert isinstance(survey, Survey)
    lengths = [row.length for row in survey.rows]
    gaps = [south.south - north.south for north, south in pairwise(survey.rows)]
    each = f"{min(lengths):.2f} to {max(lengths):.2f} m long, {min(gaps):.2f} to {max(gaps):.2f} m apart"
    return f"{len(lengths)} rows, {each}; ends from west to east {scenario.row_length:.2f} m apart"
