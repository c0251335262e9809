"""The command `orchard layout import`: writes a scenario with the rows of a survey."""

from itertools import pairwise
from pathlib import Path

import typer

from orchard.field.geojson import import_rows
from orchard.field.problems import printable
from orchard.field.scenario import Scenario, to_short_yaml
from orchard.field.survey import Survey
from orchard.launch.terminal import BAD_INPUT, print_error, print_line
from orchard.sim.disk import write_whole


def write_scenario(file: Path, out: Path | None, crs: str | None) -> None:
    """Write the scenario of surveyed rows to a new file, and tell their sizes; or print it. Raises ScenarioError, OSError or typer.Exit."""
    try:
        scenario = import_rows(file, crs)
    except ModuleNotFoundError as missing:
        print_error(f"An import needs the package {missing.name}: pip install 'orchard-sim[survey]'")
        raise typer.Exit(BAD_INPUT) from None
    text = f"# The rows of {printable(file.name)}; `orchard layout import` made this scenario.\n{to_short_yaml(scenario)}"
    if out is None:
        print_line(text.rstrip())
        return
    if out.exists():
        print_error(f"{out}: there is such a file; --out must name a new one")
        raise typer.Exit(BAD_INPUT)
    try:
        write_whole(out, text.encode())
    except OSError as error:
        print_error(f"{out}: not written: {error.strerror}")
        raise typer.Exit(BAD_INPUT) from None
    print_line(f"{out}: {_sizes(scenario)}")


def _sizes(scenario: Scenario) -> str:
    survey = scenario.survey
    assert isinstance(survey, Survey)
    lengths = [row.length for row in survey.rows]
    gaps = [south.south - north.south for north, south in pairwise(survey.rows)]
    each = f"{min(lengths):.2f} to {max(lengths):.2f} m long, {min(gaps):.2f} to {max(gaps):.2f} m apart"
    return f"{len(lengths)} rows, {each}; ends from west to east {scenario.row_length:.2f} m apart"
