"""The command `orchard layout export`: writes the roads of an orchard as a map."""

from pathlib import Path
from typing import Annotated

from typer import Option

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.shipped import load_or_shipped
from orchard.roads.export import MAP, export_map
from orchard.terminal.exits import exit_on_errors
from orchard.terminal.files import check_writable
from orchard.terminal.options import File
from orchard.terminal.output import own_classes_run, print_line

NewMap = Annotated[Path, Option("--lif", metavar="FILE.json", help="The file for the map.")]


def write_map(lif: NewMap, scenario: File = None) -> None:
    """Write the roads of an orchard as a map for fleet control.

    It is in the layout interchange format (LIF) of the VDMA.
    """
    with own_classes_run(), exit_on_errors(ScenarioError, OSError):
        check_writable(lif, scenario, MAP)
        print_line(f"{lif}: {export_map(lay_out(load_or_shipped(scenario)), lif)}")
