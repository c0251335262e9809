"""The commands of `orchard`: where each is, and what --help says of it.

A command is imported when it is used. So a package can be left out, such as `orchard.study`: its
commands then say that it is missing, and all else works.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from typer import BadParameter

from orchard.terminal.exits import lack_of

EPILOG = (
    "A clone keeps recordings and snapshots in its folder runs/, "
    "an installed package in the user's own data directory.\n"
    "ORCHARD_RUNS=DIR names another folder.\n\n"
    "Exit code: 0 if the harvest was finished or stopped, or reached its --duration; "
    "1 if it failed; 2 for bad input."
)


@dataclass(frozen=True)
class CommandEntry:
    """Where a command is, and what --help says of it."""

    module: str
    #: A function with options as parameters, or a group of commands.
    attribute: str
    summary: str
    #: As of Typer's command.
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def package(self) -> str:
        """The package that may be left out, such as orchard.study."""
        return ".".join(self.module.split(".")[:2])

    @property
    def is_here(self) -> bool:
        """Whether the package of the command is in this installation."""
        spec = find_spec(self.package)
        # A folder that holds nothing but files of Python's cache has no origin.
        return spec is not None and spec.origin is not None

    def load(self, name: str) -> Any:
        """Return the function or the group of the command of this name.

        Raises BadParameter if its package is left out.
        """
        if not self.is_here:
            raise BadParameter(lack_of(self.package, name))
        return getattr(import_module(self.module), self.attribute)


_OF_HARVEST = {"epilog": EPILOG}
# For `step -3`: Typer would call -3 an unknown option; the command says what is wrong with it.
_NUMBERS = {"context_settings": {"ignore_unknown_options": True}}
COMMANDS = {
    "view": CommandEntry("orchard.commands.recordings", "view", "open a recording"),
    "export": CommandEntry(
        "orchard.bags.commands", "export", "make a bag for ROS 2 from a recording"
    ),
    "replay": CommandEntry(
        "orchard.commands.harvest",
        "replay",
        "let the velocities in a bag drive its robots again",
        _OF_HARVEST,
    ),
    "app": CommandEntry(
        "orchard.app.commands",
        "app",
        "serve the page on which you set up, run and watch an orchard",
    ),
    "stop": CommandEntry(
        "orchard.commands.asking", "stop", "emergency stop: stop robots of the active runs"
    ),
    "reset": CommandEntry("orchard.commands.asking", "reset", "let stopped robots go on"),
    "pause": CommandEntry("orchard.commands.asking", "pause", "pause a run"),
    "resume": CommandEntry("orchard.commands.asking", "resume", "let a paused run go on"),
    "step": CommandEntry(
        "orchard.commands.asking", "step", "do some steps of a paused run", _NUMBERS
    ),
    "secure": CommandEntry(
        "orchard.commands.secure", "secure", "make the certificates of a secured run"
    ),
    "layout": CommandEntry(
        "orchard.commands.layout",
        "layout",
        "import the rows of an orchard of your own, export its roads",
    ),
    "study": CommandEntry(
        "orchard.study.commands",
        "study",
        "compare settings: how many carriers, which policy, which route",
    ),
    "calibrate": CommandEntry(
        "orchard.calibrate.commands",
        "calibrate",
        "fit a scenario to your own log of bins",
    ),
    "fork": CommandEntry(
        "orchard.futures.commands",
        "fork",
        "go on with a run from any moment, with something changed",
        _OF_HARVEST,
    ),
    "bound": CommandEntry(
        "orchard.commands.bound",
        "bound",
        "prove how short a harvest could be, whatever sends the carriers",
    ),
    "trace": CommandEntry(
        "orchard.commands.trace",
        "trace",
        "tell what each robot does when in a harvest of the fast model",
    ),
    "benchmark": CommandEntry(
        "orchard.study.commands",
        "benchmark",
        "score a dispatch policy in fixed orchards, beside the built-in ones",
    ),
}
