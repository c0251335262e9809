"""The command `orchard`, also `python -m orchard`: `orchard.launch.commands`, and what Ctrl-C does until that is imported."""

import os
import signal
import sys

if __name__ == "__main__" and sys.path[0] == os.path.dirname(os.path.realpath(__file__)):
    # Python runs this file by its path, and has put its folder first.
    del sys.path[0]


def main() -> None:
    """Run the command line."""
    signal.signal(
        signal.SIGINT, signal.SIG_DFL
    )  # Ctrl-C during the imports ends the process silently: nothing runs yet
    signal.pthread_sigmask(
        signal.SIG_UNBLOCK, {signal.SIGINT}
    )  # a program that starts this one may block the signal until here
    if (
        os.environ.get("COLUMNS") == "0"
    ):  # the width of a terminal that does not know its own: Rich would print nothing
        del os.environ["COLUMNS"]
    _open_closed_files()
    from orchard.memory import collect_seldom

    collect_seldom()
    from orchard.field.plugins import end_soon
    from orchard.launch import commands
    from orchard.launch.terminal import FAILED, print_error

    try:
        commands.main()
    except SystemExit as end:
        end_soon(end.code if isinstance(end.code, int) else FAILED, print_error)
        raise


def _open_closed_files() -> None:
    """Put something in the place of stdin, stdout and stderr if this program has begun without.

    Else the next file that is opened takes their place, and what is printed goes into it. To write
    to stdout fails then, as on a full disk, and is told on stderr.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY)  # takes the lowest number, which is this one
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))


if __name__ == "__main__":
    main()
