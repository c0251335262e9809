"""The command line: its commands, with their options in `options.py`. Without a command it harvests."""

import errno
import gc
import os
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import typer
from typer.exceptions import TyperException

from orchard.agents.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import TICKS_PER_SECOND, Scenario, check, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.folders import runs_folder
from orchard.launch import asking, options, own_orchard, terminal
from orchard.launch.bag_velocities import BagVelocities
from orchard.launch.fork import check_end, clock, fork_of
from orchard.launch.options import (
    BoundOptions,
    ExportOptions,
    ForkOptions,
    HarvestOptions,
    ReplayOptions,
    SecureOptions,
)
from orchard.launch.request import Credentials, RunRequest, shares
from orchard.launch.run_notes import end_left_over
from orchard.launch.runs import Runs, alone, check_writable
from orchard.launch.study_options import BenchmarkOptions, StudyArguments
from orchard.launch.watch import check_ports, open_window, serve
from orchard.net.endpoints import BusError
from orchard.report.progress import Progress
from orchard.server.options import last_tick
from orchard.server.snapshots import examine, sole
from orchard.sim.restore import world_from
from orchard.sim.snapshot import KEYFRAME, SNAPSHOT, Snapshot, SnapshotError, as_file, newest, store
from orchard.view.files import is_recording, parts_of, remove_further_parts, viewer_program, window

EPILOG = """A clone keeps recordings and snapshots in its folder runs/, an installed package in the user's own data directory.
ORCHARD_RUNS=DIR names another folder.

Exit code: 0 if the harvest was finished or stopped, or reached its --duration; 1 if it failed; 2 for bad input."""
REPLAY = "Let the velocities in a bag drive its robots again, in a harvest with any of its options: docs/ros2.md."

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
unnamed = typer.Typer(
    add_completion=False, pretty_exceptions_enable=False
)  # without the name of a command


# -- a harvest


def harvest(chosen: HarvestOptions) -> None:
    chosen.check()
    for note in chosen.notes():
        terminal.print_error(note)
    if chosen.only and chosen.connect:
        raise typer.Exit(_join_run(chosen, chosen.connect, chosen.only))
    with ExitStack() as stack:
        with terminal.own_classes_run():
            with terminal.exit_on_errors(
                ScenarioError, SnapshotError, BusError, OSError, ValueError
            ):
                request = _request(chosen)
                stack.enter_context(alone(request.recording, chosen.table))
                if request.recording is not None:
                    remove_further_parts(request.recording)
            result, why = _run_local(request) if chosen.mode == "local" else _run_processes(request)
        code = terminal.report(request, result, why)
    raise typer.Exit(code)


harvest_with = options.with_options(HarvestOptions)(harvest)
app.command("harvest", cls=options.Command, help=options.HELP, epilog=EPILOG)(harvest_with)
unnamed.command(cls=options.Command, help=options.HELP, epilog=EPILOG)(harvest_with)
app.command("replay", cls=options.Command, help=REPLAY, epilog=EPILOG)(
    options.with_options(ReplayOptions)(harvest)
)


FORKED = "Go on with a run from any moment, with something changed: docs/how-to.md."


@app.command("fork", cls=options.Command, help=FORKED, epilog=EPILOG)
@options.with_options(ForkOptions)
def fork(chosen: ForkOptions) -> None:
    if not chosen.asks_for_futures:
        harvest(chosen)
    chosen.check()
    with terminal.needs_extra("Several futures", "study"):
        from orchard.launch.futures import run_futures
    raise typer.Exit(run_futures(chosen, Runs(runs_folder())))


def _request(chosen: HarvestOptions) -> RunRequest:
    runs = Runs(runs_folder())
    before = _before(chosen, runs)
    velocities = None
    if before is not None:
        scenario = check(before.scenario, "the snapshot's scenario")
        if chosen.mode == "local" or (isinstance(chosen, ForkOptions) and chosen.stop):
            check_end(world_from(before), chosen.duration)
    else:
        scenario, velocities = _scenario_and_velocities(chosen)
    check_plugins(lay_out(scenario))
    recording = runs.recording(chosen.record)
    snapshots = (
        runs.new_snapshots(recording) if chosen.resume is None else runs.snapshots(chosen.resume)
    )
    parent = None
    if isinstance(chosen, ForkOptions):
        parent = {
            "run": runs.snapshots(chosen.run, KEYFRAME).stem,
            "seconds": (chosen.at or 0) / TICKS_PER_SECOND,
        }
    request = RunRequest(
        chosen, scenario, recording, snapshots, before, parent, runs.folder, velocities
    )
    if chosen.summary is not None:
        check_writable(chosen.summary)
    if chosen.table is not None:
        from orchard.tables.folder import check_folder

        str(chosen.table).encode()  # pyarrow takes no other names
        check_folder(
            chosen.table, scenario, None if before is None or chosen.resume is None else before.tick
        )
    if chosen.web is not None:
        check_ports(chosen.web)
    if request.recording is not None or chosen.is_live:
        window() if chosen.view else viewer_program()
    if before is not None and chosen.resume is None:
        name, content = as_file(before)
        for suffix in (KEYFRAME, SNAPSHOT):  # physics begins with it, and it can be forked again
            store(name.replace(SNAPSHOT, suffix), content, snapshots, before.run)
    return request


def _before(chosen: HarvestOptions, runs: Runs) -> Snapshot | None:
    """The snapshot with which a run begins; None for a run from its start."""
    if isinstance(chosen, ForkOptions):
        return fork_of(chosen, runs, terminal.print_error)
    return None if chosen.resume is None else _snapshot(chosen, chosen.resume, runs)


def _scenario(path: Path | None, changes: dict[str, Any]) -> Scenario:
    return _changed(
        load_or_shipped(path), {name: value for name, value in changes.items() if value is not None}
    )


def _changed(scenario: Scenario, given: dict[str, Any]) -> Scenario:
    def typed(paths: str) -> str:
        return ", ".join(
            options.named([path]) if path in given else path for path in paths.split(", ")
        )

    with terminal.as_typed(typed):
        return with_changes(scenario, **given)


def _scenario_and_velocities(chosen: HarvestOptions) -> tuple[Scenario, BagVelocities | None]:
    """Return the scenario of a run from its start, and when the velocities of its bag drive, if any.

    The scenario is that of the bag, unless a file is given. A bag may come from others: its code
    must be asked for.
    """
    bag = chosen.replay
    if bag is None:
        return _scenario(chosen.scenario, chosen.changes), None
    with terminal.needs_extra("A bag", "ros2-export"):
        from orchard.bags.replay import check_robots, read_commands
    commands = read_commands(bag, chosen.from_first_stamp)
    if commands.scenario is None or chosen.scenario:
        scenario = _scenario(chosen.scenario, chosen.changes)
    else:
        scenario = _changed(commands.scenario, chosen.changes)
        code = [
            f"{key}: {path}"
            for key, path in scenario.own_classes.items()
            if chosen.changes.get(key) != path
        ]
        if code and not chosen.own_code:
            words = "its scenario names code, which can do whatever you can"
            raise ValueError(
                f"{bag}: {words}: {printable(', '.join(code), 500)}; --own-code imports it, a SCENARIO.yaml replaces it"
            )
    check_robots(bag, commands, lay_out(scenario).index)
    velocities = BagVelocities(bag, commands.ticks)
    velocities.check(last_tick(chosen.duration))
    return scenario, velocities


def _snapshot(chosen: HarvestOptions, where: str, runs: Runs) -> Snapshot:
    if given := chosen.typed(
        name for name in chosen.given() if name in (*options.CHANGES, "scenario")
    ):
        raise ValueError(f"--resume: leave out {given}: the snapshot has its scenario")
    refused: list[str] = []
    end_left_over(runs.folder, terminal.print_error)
    with sole(runs.snapshots(where)):
        found = newest(runs.snapshots(where), refused, examine=examine)
    for why in refused:
        terminal.print_error(f"not used: {why}")
    terminal.print_line(f"going on with {runs.snapshots(where).stem} from {clock(found.tick)}")
    if found.lost:
        lost = ", ".join(f"{name} (tick {tick})" for name, tick in sorted(found.lost.items()))
        terminal.print_error(
            f"no host was there for {lost}: the robots stood, and the hash is not that of a run without this"
        )
    return found


def _run_local(request: RunRequest) -> tuple[dict[str, Any], str]:
    from orchard.launch.local_run import run_watched

    with terminal.exit_on_errors(
        SnapshotError
    ):  # of an agent's memory, which only the agent can check
        return run_watched(request)


def _run_processes(request: RunRequest) -> tuple[dict[str, Any] | None, str]:
    from orchard.launch.distributed import run

    as_json, until = request.options.progress == "json", request.options.duration
    with (
        terminal.exit_on_errors(BusError, OSError, ValueError),
        Progress(terminal.console, as_json, until) as progress,
    ):
        return run(request, progress)


def _join_run(chosen: HarvestOptions, endpoint: str, only: list[str]) -> int:
    from orchard.launch.distributed import join_run

    with terminal.exit_on_errors(BusError, ValueError), Progress(terminal.console) as progress:
        return join_run(endpoint, only, chosen.without or [], Credentials(chosen), progress)


# -- questions to a run

for command in (asking.stop, asking.reset, asking.pause, asking.resume):
    app.command(cls=options.Command)(command)
app.command(cls=options.Command, context_settings={"ignore_unknown_options": True})(
    asking.step
)  # -3 is no option


# -- security


@app.command(cls=options.Command)
@options.with_options(SecureOptions)
def secure(chosen: SecureOptions) -> None:
    """Make certificates and access rules, so that each process of a run can do only what its role allows."""
    from orchard.launch.distributed import agent_names
    from orchard.security.identity import bridge_roles, host_roles, make

    with terminal.exit_on_errors(ScenarioError, OSError, ValueError):
        sizes = {"rows": chosen.rows, "pickers": chosen.pickers, "carriers": chosen.carriers}
        names = agent_names(_scenario(chosen.scenario, sizes))
        hosts = host_roles(names, chosen.role or (), lambda rest: shares(rest, chosen.hosts))
        roles = make(
            chosen.folder,
            hosts + bridge_roles(names, chosen.bridge or ()),
            chosen.address or (),
            chosen.days,
            chosen.anew,
        )
    for role in roles:
        terminal.print_line(f"{chosen.folder / role.name}: {', '.join(role.names) or role.duty}")


# -- an orchard of one's own

layout = typer.Typer(
    help="Import rows of your own, export the roads of an orchard.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(layout, name="layout", cls=options.Group, no_args_is_help=True)
layout.command("import", cls=options.Command)(own_orchard.write_scenario)
layout.command("export", cls=options.Command)(own_orchard.write_map)


# -- a study


@app.command(cls=options.Command)
@options.with_options(StudyArguments)
def study(chosen: StudyArguments) -> None:
    """Compare settings of an orchard, and tell which is best, and with what confidence."""
    with terminal.needs_extra("A study", "study", ", or in a clone: make study"):
        from orchard.launch.study import run_study
    raise typer.Exit(run_study(chosen))


@app.command(cls=options.Command)
@options.with_options(BoundOptions)
def bound(chosen: BoundOptions) -> None:
    """Prove how short a harvest could be, whatever sends the carriers, without people and animals: docs/bounds.md."""
    with terminal.needs_extra("A bound", "optimum"):
        from orchard.launch.bound import print_bound
    with terminal.own_classes_run(), terminal.exit_on_errors(ScenarioError, OSError, ValueError):
        print_bound(chosen)


@app.command(cls=options.Command)
@options.with_options(BenchmarkOptions)
def benchmark(chosen: BenchmarkOptions) -> None:
    """Score a dispatch policy in twenty fixed orchards, beside the built-in ones: docs/bounds.md."""
    with terminal.needs_extra("A benchmark", "study,optimum", ", or in a clone: make study"):
        from orchard.launch.benchmark import run_benchmark
    raise typer.Exit(run_benchmark(chosen))


# -- recordings and the page


@app.command("app", cls=options.Command)
def page(
    port: options.Port = 8080,
    host: options.Host = "127.0.0.1",
    runs: options.Folder = None,
    quiet: options.Quiet = False,
) -> None:
    """Set up an orchard in the browser, run it, and watch it."""
    signal.signal(
        signal.SIGINT, signal.SIG_DFL
    )  # Ctrl-C during the imports ends the process silently
    with terminal.needs_extra("The page", "app"):
        from orchard.app.serve import serve as serve_page
    with terminal.exit_on_errors(ValueError):
        serve_page(host, port, runs or runs_folder(), not quiet)


@app.command(cls=options.Command)
def view(recording: options.Recording = None, web: options.Browser = None) -> None:
    """Open a recording, with all its parts, in the Rerun viewer."""
    path = _recording(recording)
    with terminal.exit_on_errors(BusError, OSError):
        code = open_window(parts_of(path)) if web is None else serve(parts_of(path), web)
    raise typer.Exit(code)


@app.command(cls=options.Command)
@options.with_options(ExportOptions)
def export(chosen: ExportOptions) -> None:
    """Make a bag of ROS 2 from a recording, with all its parts: clock, transforms, odometry and velocities of the robots."""
    with terminal.needs_extra("A bag", "ros2-export"):
        from orchard.launch.bag import export_bag
    raise typer.Exit(
        export_bag(
            _recording(chosen.recording), chosen.mcap, chosen.robots or [], chosen.with_scans
        )
    )


def _recording(path: Path | None) -> Path:
    runs = Runs(runs_folder())
    found = path or runs.newest_recording()
    with terminal.exit_on_errors(OSError, ValueError):
        if found is None or not found.is_file():
            raise ValueError(
                f"{found or runs.folder}: no recording there; a run without --record none makes one"
            )
        if not is_recording(found):
            raise ValueError(
                f"{found}: it cannot be read: it is no recording; expected a file NAME.rrd that a run has written"
            )
        return found


def _check_folder() -> None:
    """Raise OSError if the folder has been removed in which this program was started."""
    try:
        os.getcwd()
    except OSError:
        raise OSError(
            "the folder in which this was started is not there any more; start it in another one"
        ) from None


def main() -> None:
    """Run a command of the command line; `harvest` is the default."""
    arguments = sys.argv[1:]
    command = app if arguments[:1] and arguments[0] in ("harvest", *options.COMMANDS) else unnamed
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # the command may have something to stop
    try:
        _check_folder()
        raise SystemExit(command(arguments, standalone_mode=False) or terminal.FINISHED)
    except TyperException as error:
        terminal.print_error(terminal.fault_of(error))
        raise SystemExit(error.exit_code) from None
    except OSError as error:
        is_of_stdout = error.errno in (errno.EBADF, errno.ENOSPC) and not error.filename
        words = terminal.unwritten("stdout", error) if is_of_stdout else terminal.in_words(error)
        terminal.print_error(words)
        raise SystemExit(terminal.BAD_INPUT) from None
    finally:
        terminal.console.end()
        terminal.errors.end()
        gc.freeze()  # or the process visits all objects once more before it ends: a fifth of a short command's time
