"""What `orchard fork` does with futures: it lives them, prints and writes what they give.

The terms are in the head of the package.
"""

from orchard.field.problems import ScenarioError
from orchard.futures.bisection import bisect_futures
from orchard.futures.comparison import compare_futures
from orchard.futures.futures import Futures
from orchard.futures.options import ForkOptions
from orchard.launch.run_folder import RunFolder
from orchard.report.summary import SUMMARY, write_if_wanted
from orchard.sim.snapshot import KEYFRAME, SnapshotError
from orchard.study.kinds_of_files import PICTURE
from orchard.study.study_command import failures
from orchard.study.workers import processes
from orchard.terminal.exits import FAILED, FINISHED, as_typed, exit_on_errors
from orchard.terminal.files import check_writable
from orchard.terminal.output import bar, own_classes_run, print_error
from orchard.terminal.signals import stoppable


def run_futures(chosen: ForkOptions, runs: RunFolder) -> int:
    """Live the futures that a user asks for. Print and write what they give.

    Returns the exit code. Raises typer.Exit after it has printed what is wrong.
    """
    with (
        own_classes_run(),
        exit_on_errors(ScenarioError, SnapshotError, OSError, ValueError),
        failures(),
    ):
        folder = runs.snapshots(chosen.run, KEYFRAME)
        for path, kind in ((chosen.summary, SUMMARY), (chosen.picture, PICTURE)):
            if path is not None:
                check_writable(path, kind=kind)
        answer = compare_futures if chosen.bisect is None else bisect_futures
        with (
            as_typed(),
            stoppable() as is_stopped,
            processes() as workers,
            bar() as progress,
        ):
            summary = answer(chosen, folder, Futures(chosen, workers, is_stopped, progress))
    trouble = write_if_wanted(chosen.summary, summary)
    if trouble:
        print_error(trouble)
        return FAILED
    return FINISHED
