"""The commands `orchard layout`: write a scenario with the rows of a survey, and the roads of an orchard as a map."""

from itertools import pairwise

from orchard.field.geojson import import_rows
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import Scenario, to_short_yaml
from orchard.field.shipped import load_or_shipped
from orchard.field.survey import Survey
from orchard.folders import write_whole
from orchard.launch import options
from orchard.launch.terminal import exit_on_errors, needs_extra, own_classes_run, print_line
from orchard.roads.export import export_map


def write_scenario(
    file: options.GeoJson, out: options.NewScenario = None, crs: options.System = None
) -> None:
    """Make a scenario from surveyed rows."""
    with exit_on_errors(ScenarioError, OSError), needs_extra("An import", "survey"):
        scenario = import_rows(file, crs)
        text = f"# The rows of {printable(file.name)}; `orchard layout import` made this scenario.\n{to_short_yaml(scenario)}"
        if out is None:
            print_line(text.rstrip())
            return
        if out.exists():
            raise FileExistsError(f"{out}: there is such a file; --out must name a new one")
        write_whole(out, text.encode())
        print_line(f"{out}: {_sizes(scenario)}")


def write_map(lif: options.NewMap, scenario: options.File = None) -> None:
    """Write the roads of an orchard as a map for fleet control, in the layout interchange format (LIF) of the VDMA."""
    with own_classes_run(), exit_on_errors(ScenarioError, OSError):
        print_line(f"{lif}: {export_map(lay_out(load_or_shipped(scenario)), lif)}")


def _sizes(scenario: Scenario) -> str:
    survey = scenario.survey
    assert isinstance(survey, Survey)
    lengths = [row.length for row in survey.rows]
    gaps = [south.south - north.south for north, south in pairwise(survey.rows)]
    each = f"{min(lengths):.2f} to {max(lengths):.2f} m long, {min(gaps):.2f} to {max(gaps):.2f} m apart"
    return f"{len(lengths)} rows, {each}; ends from west to east {scenario.row_length:.2f} m apart"
