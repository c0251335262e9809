"""How the commands of a study end: what they say if they were stopped, or if something of their
answer could not be written.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from orchard.terminal.output import is_answer_lost, print_error

STOPPED = "stopped; the runs so far are kept, and the same command goes on from there"
LOST = (
    "stdout could not be written, so the answer is lost; the runs are kept, and the same command"
    " prints it at once"
)

Result = TypeVar("Result")


def tell_if_lost() -> bool:
    """Say on stderr if stdout could not be written, so that the answer is lost. Return True if it
    is not lost.

    There was a warning at the first loss, but it may be minutes old, and says that the run goes on.
    """
    if not is_answer_lost():
        return True
    print_error(LOST)
    return False


def unwritten(files: Mapping[Path, Callable[[Result, Path], None]], result: Result) -> list[Path]:
    """Write all files of a result. Return those that cannot be written, and say why.

    `files`: each with the function that writes it.
    """
    failed = []
    for path, save in files.items():
        try:
            save(result, path)
        except OSError as error:
            print_error(f"{path}: not written: {error.strerror or error}")
            failed.append(path)
    return failed
