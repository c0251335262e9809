"""A harvest from what a user has typed to its result: its files are checked, it runs, it ends.

The commands `orchard`, `orchard fork` and `orchard replay` call `carry_out` (orchard/commands).
"""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from orchard.behaviour.catalogue import check_plugins
from orchard.dispatch.policies import notes_on
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.folders import runs_folder
from orchard.launch.beginning import Beginning
from orchard.launch.end_forecast import EndForecast
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest
from orchard.launch.result import report
from orchard.launch.run_folder import RunFolder, alone
from orchard.launch.web_ports import check_ports
from orchard.net.endpoints import BusError
from orchard.report.late_absences import notes_on_absences
from orchard.report.progress import Progress
from orchard.report.rare_truck import notes_on_truck
from orchard.report.summary import SUMMARY
from orchard.sim.snapshot import KEYFRAME, SNAPSHOT, SnapshotError, as_file, store
from orchard.terminal.exits import exit_on_errors, needs_extra
from orchard.terminal.files import check_writable
from orchard.terminal.output import console, own_classes_run, print_error
from orchard.view.files import remove_further_parts, viewer_program, window

Result = tuple[dict[str, Any] | None, str]  # the summary, if any, and why the run ended


def carry_out(chosen: HarvestOptions, begin: Callable[[RunFolder], Beginning]) -> int:
    """Do a harvest, and print and write its result. Return the exit code.

    `begin`: returns with what the run begins. Raises BadParameter for options that cannot be
    together, and typer.Exit after it has printed what is wrong.
    """
    chosen.check()
    for note in chosen.notes():
        print_error(note)
    if chosen.only and chosen.connect:
        return _join_run(chosen, chosen.connect, chosen.only)
    with ExitStack() as stack:
        with own_classes_run():
            with exit_on_errors(ScenarioError, SnapshotError, BusError, OSError, ValueError):
                runs = RunFolder(runs_folder())
                request = _request(chosen, begin(runs), runs)
                stack.enter_context(alone(request.recording, chosen.table))
                if request.recording is not None:
                    remove_further_parts(request.recording)
            run = _run_local if chosen.mode == "local" else _run_processes
            result, why = run(request)
        return report(request, result, why)


def _request(chosen: HarvestOptions, beginning: Beginning, runs: RunFolder) -> RunRequest:
    """Return the run to start, once all is checked that it needs.

    Raises ScenarioError, SnapshotError, BusError, OSError or ValueError.
    """
    layout = lay_out(beginning.scenario)
    check_plugins(layout)
    of_dispatch = notes_on([beginning.scenario.dispatch])
    for note in (*of_dispatch, *notes_on_truck(layout), *notes_on_absences(layout)):
        print_error(note)
    recording = runs.recording(chosen.record)
    if chosen.resume is None:
        snapshots = runs.new_snapshots(recording)
    else:
        snapshots = runs.snapshots(chosen.resume)
    request = RunRequest(
        chosen,
        beginning.scenario,
        recording,
        snapshots,
        resumed=beginning.snapshot,
        forked_from=None if beginning.parent is None else dict(beginning.parent),
        notes=runs.folder,
        velocities=beginning.velocities,
    )
    _check_files(request)
    _check_viewers(request)
    if request.forked_from is not None:
        _keep_first_moment(request)
    return request


def _check_files(request: RunRequest) -> None:
    """Raise OSError or ValueError for a summary or tables that cannot be written.

    Raises typer.Exit for tables if what writes them is not installed.
    """
    options = request.options
    if options.summary is not None:
        check_writable(options.summary, options.scenario, SUMMARY)
    if options.table is not None:
        with needs_extra("--table", "tables"):
            # pyarrow takes some time to load.
            from orchard.tables.folder import check_folder

        # pyarrow takes only names that are valid UTF-8. For others this raises UnicodeEncodeError,
        # a ValueError.
        str(options.table).encode()
        # A run that is resumed goes on with its tables. A fork has tables of its own.
        begins_at = None
        if request.resumed is not None and request.forked_from is None:
            begins_at = request.resumed.tick
        check_folder(options.table, request.scenario, begins_at)


def _check_viewers(request: RunRequest) -> None:
    """Raise BusError or OSError if the run cannot be shown or recorded."""
    options = request.options
    if options.web is not None:
        check_ports(options.web)
    if options.view:
        window()
    elif request.recording is not None or options.is_live:
        viewer_program()


def _keep_first_moment(request: RunRequest) -> None:
    """Keep the first moment of a fork: physics begins with it, and it can be forked again."""
    if request.resumed is None:
        return
    name, content = as_file(request.resumed)
    for suffix in (KEYFRAME, SNAPSHOT):
        file = name.replace(SNAPSHOT, suffix)
        store(file, content, request.snapshots, request.resumed.run)


def _run_local(request: RunRequest) -> Result:
    """Run a harvest in this process. Return its summary, and why it ended."""
    from orchard.launch.local_run import run_watched

    # The memories in a snapshot are read only now, because only an agent knows the type of its own.
    with exit_on_errors(SnapshotError):
        return run_watched(request)


def _run_processes(request: RunRequest) -> Result:
    """Run a harvest in many processes. Return its summary, if any, and why it ended."""
    from orchard.launch.distributed import run

    options = request.options
    with (
        exit_on_errors(BusError, OSError, ValueError),
        Progress(console, options.progress == "json", options.duration) as progress,
    ):
        progress.tell_end(EndForecast(lay_out(request.scenario), request.snapshots, request.run_id))
        return run(request, progress)


def _join_run(chosen: HarvestOptions, endpoint: str, only: list[str]) -> int:
    """Host some agents of a run elsewhere. Return the exit code."""
    from orchard.launch.hosts import join_run

    with exit_on_errors(BusError, ValueError), Progress(console) as progress:
        return join_run(endpoint, only, chosen.without or [], Credentials(chosen), progress)
