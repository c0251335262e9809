"""A group of commands each of which is imported when it is used."""

import signal
from collections.abc import Mapping
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from orchard.terminal.catalogue import CommandEntry
from orchard.terminal.options import OrchardCommand, OrchardGroup


class LazyGroup(OrchardGroup):
    """A group of commands. A command of a package that is left out is not listed."""

    def __init__(self, entries: Mapping[str, CommandEntry], **settings: Any) -> None:
        """`entries`: name of a command -> where it is. `settings`: as of Typer's group."""
        super().__init__(**settings)
        self._entries = entries

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands that are in this installation."""
        return [name for name, entry in self._entries.items() if entry.is_here]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; None for an unknown name. Raises BadParameter if it is left out."""
        entry = self._entries.get(cmd_name)
        if entry is None:
            return None
        return command_of(cmd_name, entry)


def command_of(name: str, entry: CommandEntry) -> Any:
    """Return a command for its name and entry. Raises BadParameter if it is left out."""
    loaded = entry.load(name)
    # Until here Ctrl-C ends the process silently. The command may have something to stop.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if isinstance(loaded, TyperGroup):
        return loaded
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name, cls=OrchardCommand, **entry.settings)(loaded)
    return get_command(alone)
