"""How a command declares its options, and those that several commands have.

The options of a command are the fields of a dataclass. `with_options` gives them to Typer.
"""

import inspect
import math
from collections.abc import Callable
from dataclasses import field, fields
from difflib import get_close_matches
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from typer import Argument, BadParameter, Option
from typer.core import TyperCommand, TyperGroup, TyperOption

from orchard.field.shipped import DEFAULT, names
from orchard.terminal.catalogue import COMMANDS
from orchard.terminal.output import print_error

# The groups of options in --help.
FORK = "The fork"
ORCHARD = "The orchard"
RUN = "The run"
OUTPUT = "What it shows and writes"
NETWORK = "Several machines"

# -- parsers; all of them raise BadParameter


def number(text: str) -> float:
    """Return the number in a text; NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def whole(text: str, most: int, expected: str) -> int:
    """Return the whole number in a text, from 1 to `most`.

    `expected`: the end of the message for any other text, as "expected a number from 1 to 200".
    """
    if not text.isdecimal() or not 1 <= int(text) <= most:
        raise BadParameter(f"{text}: {expected}")
    return int(text)


def picture_file(text: str) -> Path:
    """Return the path of a picture."""
    if Path(text).suffix.lower() not in (".svg", ".png"):
        raise BadParameter(f"{text}: a picture's name ends in .svg or .png")
    return Path(text)


def folder(text: str) -> Path:
    """Return the path of a folder, which need not exist yet."""
    if not text.strip():
        raise BadParameter("expected the name of a folder")
    return Path(text)


def hosts(text: str) -> int:
    """Return the number of agent processes; 0 for one process an agent."""
    if text == "each":
        return 0
    return whole(text, 200, "expected a number from 1 to 200, or each")


def scenario_file(path: Path | None) -> Path | None:
    """Return the path of a scenario, or the name of one in config/.

    A wrong word may be a recording, or a command or a scenario misspelled: the error names it.
    """
    if path is not None and path.suffix == ".rrd":
        raise BadParameter(f"{path}: a recording, not a scenario; did you mean the command view?")
    if path is None or path.exists() or str(path) in names():
        return path
    similar = get_close_matches(str(path).lower(), [*COMMANDS, "harvest", *names()], n=1)
    if similar:
        kind = "command"
        if similar[0] in names():
            kind = "scenario"
        raise BadParameter(f"{path}: no such file; did you mean the {kind} {similar[0]}?")
    if str(path).isalpha():
        known = ", ".join(names())
        raise BadParameter(
            f"{path}: no such file, and no such command (see --help); "
            f"expected a scenario's file, or one of {known}"
        )
    return path


# -- options as the fields of a dataclass


def option(
    panel: str | None,
    help_text: str,
    metavar: str | None = None,
    *names: str,
    default: Any = None,
    **settings: Any,
) -> Any:
    """Return the field of a dataclass that is an option.

    `panel`: its group in --help. `settings`: the rest of what Typer knows of an option.
    """
    declared = Option(*names, metavar=metavar, help=help_text, rich_help_panel=panel, **settings)
    return field(default=default, metadata={"option": declared})


def flag(panel: str | None, name: str, help_text: str, **settings: Any) -> Any:
    """Return the field of a dataclass that is an option without a value. Else as `option`."""
    return option(panel, help_text, "", name, default=False, **settings)


Chosen = TypeVar("Chosen")


def with_options(kind: type[Chosen]) -> Callable[[Callable[[Chosen], None]], Callable[..., None]]:
    """Give a command the fields of a dataclass as its parameters, of which Typer makes options."""

    def decorate(command: Callable[[Chosen], None]) -> Callable[..., None]:
        @wraps(command)
        def called(**values: Any) -> None:
            command(kind(**values))

        vars(called)["__signature__"] = inspect.Signature(_parameters_of(kind))
        return called

    return decorate


def _parameters_of(kind: type) -> list[inspect.Parameter]:
    """Return the fields of a dataclass as parameters with their options, the needed ones first."""
    options = {part.name: part.metadata["option"] for part in fields(kind) if part.metadata}
    parameters = [
        parameter.replace(annotation=Annotated[parameter.annotation, options.get(parameter.name)])
        for parameter in inspect.signature(kind).parameters.values()
    ]
    return sorted(parameters, key=_has_default)


def _has_default(parameter: inspect.Parameter) -> bool:
    """Whether a parameter may be left out."""
    return parameter.default is not parameter.empty


class _Plain:
    """A command that shows its option --help without a value."""

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option --help; None if there is none."""
        help_option = super().get_help_option(ctx)  # type: ignore[misc]
        if help_option is not None:
            help_option.metavar = ""
        return help_option


class OrchardCommand(_Plain, TyperCommand):
    """A command. If an option is given twice, its last value counts, and a warning is printed."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command line. Warn of options that lose a value."""
        # A copy, because the parser takes words out of its list.
        _, _, order = self.make_parser(ctx).parse_args(list(args))
        given: list[TyperOption] = []
        for parameter in order:
            if isinstance(parameter, TyperOption) and parameter in given:
                print_error(f"{parameter.opts[0]}: given twice; the last value counts")
            # A flag says the same a second time.
            if isinstance(parameter, TyperOption) and not (parameter.multiple or parameter.is_flag):
                given.append(parameter)
        return super().parse_args(ctx, args)


class OrchardGroup(_Plain, TyperGroup):
    """A command that has commands."""


# -- options of several commands

_SCENARIO_NAMES = ", ".join(name for name in names() if name != DEFAULT)
_SCENARIO = f"A file, or the name of one in config/: {_SCENARIO_NAMES}."
_HOSTS = "Agent processes. Default: one per core, at most 4."
_STYLES = "text: a table on a terminal, else lines; json: JSON lines."
File = Annotated[
    Path | None,
    Argument(metavar="SCENARIO.yaml", help=_SCENARIO, show_default=DEFAULT, callback=scenario_file),
]
Rows = Annotated[int | None, Option(help="Rows, 3 to 100.", rich_help_panel=ORCHARD)]
Pickers = Annotated[int | None, Option(help="Pickers, 2 to rows.", rich_help_panel=ORCHARD)]
Hosts = Annotated[
    int | None, Option(parser=hosts, metavar="N|each", help=_HOSTS, rich_help_panel=RUN)
]
Style = Annotated[Literal["text", "json"], Option(help=_STYLES, rich_help_panel=OUTPUT)]
Recording = Annotated[Path | None, Argument(metavar="FILE.rrd", show_default="the newest")]
