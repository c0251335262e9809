"""The command line of `orchard`: it finds the command, and ends with an exit code."""

import errno
import gc
import os
import sys

from typer.exceptions import TyperException

from orchard.terminal.catalogue import COMMANDS, EPILOG, CommandEntry
from orchard.terminal.exits import BAD_INPUT, FAILED, FINISHED, fault_of, in_words
from orchard.terminal.group import LazyGroup, command_of
from orchard.terminal.output import console, errors, is_answer_lost, print_error, unwritten


def _harvest_help() -> str:
    """Return the help text of `orchard` without a command, which lists the commands."""
    listed = "\n".join(
        f"  {name:10}{entry.summary}" for name, entry in COMMANDS.items() if entry.is_here
    )
    # A line with \b alone tells Typer not to wrap the lines after it.
    return (
        f"Harvest an orchard to the end.\n\n\b\nOther commands, each with its own --help:\n{listed}"
    )


HARVEST = CommandEntry(
    "orchard.commands.harvest",
    "harvest",
    "harvest an orchard to the end",
    {"help": _harvest_help(), "epilog": EPILOG},
)
app = LazyGroup({"harvest": HARVEST, **COMMANDS}, name="orchard")


def main() -> None:
    """Run a command of the command line; `harvest` is the default. Raises SystemExit."""
    try:
        raise SystemExit(_run(sys.argv[1:]))
    except TyperException as error:
        print_error(fault_of(error))
        raise SystemExit(error.exit_code) from None
    except OSError as error:
        # A closed stdout and a full disk; an error of a file of the command has a name.
        is_of_stdout = error.errno in (errno.EBADF, errno.ENOSPC) and not error.filename
        if is_of_stdout:
            print_error(unwritten("stdout", error))
        else:
            print_error(in_words(error))
        raise SystemExit(BAD_INPUT) from None
    finally:
        console.end()
        errors.end()
        # This tells Python's garbage collector to leave all objects alone. Else it would visit each
        # of them before the process ends, which takes a fifth of the time of a short command.
        gc.freeze()


def _run(arguments: list[str]) -> int:
    """Run the command that the arguments name, and return the exit code."""
    _check_folder()
    if arguments and arguments[0] in ("harvest", *COMMANDS):
        command = app
    else:
        command = command_of("harvest", HARVEST)
    code: int = command(arguments, standalone_mode=False) or FINISHED
    if code == FINISHED and is_answer_lost():
        # stderr has said why stdout cannot be written.
        return FAILED
    return code


def _check_folder() -> None:
    """Raise OSError if the folder has been removed in which this program was started."""
    try:
        os.getcwd()
    except OSError:
        raise OSError(
            "the folder in which this was started is not there any more; start it in another one"
        ) from None
