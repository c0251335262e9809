"""The command `orchard`, also `python -m orchard`: `orchard.launch.commands`, and what Ctrl-C does until that is imported."""

import os
import signal
import sys

ABOVE = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))  # the folder of the package
if __name__ == "__main__" and not sys.flags.safe_path and sys.path[0] != ABOVE:
    # `python -m` has put the working folder first: a user's random.py there would be taken for
    # Python's own. In a clone this folder stays, because it holds the package.
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


if __name__ == "__main__":
    main()
