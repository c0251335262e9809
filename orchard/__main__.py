"""The command `orchard`, also `python -m orchard`: it runs `orchard.commands.main`.

Until that is imported, it says what Ctrl-C does.
"""

import os
import signal
import sys

if __name__ == "__main__" and sys.path[0] == os.path.dirname(os.path.realpath(__file__)):
    # Python runs this file by its path, and has put its folder first.
    del sys.path[0]


def main() -> None:
    """Run the command line."""
    # Ctrl-C during the imports ends the process silently: nothing runs yet.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # A program that starts this one may block the signal until here.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # A terminal that does not know its width says 0, with which Rich would print nothing.
    if os.environ.get("COLUMNS") == "0":
        del os.environ["COLUMNS"]
    _open_closed_files()
    from orchard.memory import collect_seldom

    collect_seldom()
    from orchard.commands.main import main as run_command
    from orchard.field.plugins import end_soon
    from orchard.terminal.exits import FAILED
    from orchard.terminal.output import print_error

    try:
        run_command()
    except SystemExit as end:
        code = FAILED
        if isinstance(end.code, int):
            code = end.code
        end_soon(code, print_error)
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
            # It takes the lowest number, which is this one.
            os.open(os.devnull, os.O_RDONLY)
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))


if __name__ == "__main__":
    main()
