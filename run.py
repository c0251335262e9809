"""Harvest an orchard: start its processes, supervise them, show the progress and report the result.

python run.py [SCENARIO.yaml] [--rows 5 --pickers 2 ...]
python run.py view [FILE.rrd]
python run.py app [--port 8080]
python run.py stop [ROBOT ...]
python run.py reset [ROBOT ...]
python run.py secure DIR [SCENARIO.yaml]
"""

import signal

if __name__ == "__main__":  # Ctrl-C while the rest is imported ends the process silently: nothing runs yet
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # a program that starts this one may block the signal until here

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import typer

from orchard.agents.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, check, load, with_changes
from orchard.launch import options
from orchard.launch.options import HarvestOptions, named
from orchard.launch.request import Credentials, RunRequest, shares
from orchard.launch.runs import Runs, check_writable
from orchard.launch.terminal import BAD_INPUT, FINISHED, console, errors, exit_on_errors, print_error, print_line, report
from orchard.net.endpoints import BusError, check_free
from orchard.report.progress import Progress
from orchard.security.roles import EMERGENCY_OPERATOR
from orchard.server.snapshots import sole
from orchard.sim.snapshot import Snapshot, SnapshotError, newest
from orchard.view.files import parts_of, viewer_program, window

HERE = Path(__file__).parent
RUNS = Runs(HERE / "runs")

EPILOG = """Other commands, each with its own --help: view, app, stop, reset, secure.

Exit code: 0 if the harvest was finished or stopped, or reached its --duration; 1 if it failed; 2 for bad input."""

app = typer.Typer(add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False)


@app.callback()
def interruptible() -> None:
    """From here on Ctrl-C raises KeyboardInterrupt in the command, which may have something to stop. Typer sets the exit code."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


# -- a harvest


@app.command(epilog=EPILOG)
@options.with_options
def harvest(chosen: HarvestOptions) -> None:
    """Harvest an orchard to the end."""
    chosen.check()
    if chosen.only and chosen.connect:
        raise typer.Exit(_join_run(chosen, chosen.connect, chosen.only))
    with exit_on_errors(ScenarioError, SnapshotError, BusError, OSError, ValueError):
        request = _request(chosen)
    result, why = _run_local(request) if chosen.mode == "local" else _run_processes(request)
    raise typer.Exit(report(HERE / "run.py", request, result, why))


def _request(chosen: HarvestOptions) -> RunRequest:
    """Check what a harvest reads and where it writes. Raises ScenarioError, SnapshotError, BusError, OSError or ValueError."""
    before = None if chosen.resume is None else _snapshot(chosen, chosen.resume)
    scenario = check(before.scenario, "the snapshot's scenario") if before else _scenario(chosen.scenario, chosen.changes)
    check_plugins(lay_out(scenario))
    request = RunRequest(chosen, scenario, RUNS.recording(chosen.record), RUNS.snapshots(chosen.resume), before, RUNS.folder)
    if chosen.summary is not None:
        check_writable(chosen.summary)
    for port in () if chosen.web is None else (chosen.web, chosen.web + 1):  # of the page, and of its data
        check_free(f"tcp/127.0.0.1:{port}")
    if request.recording is not None or chosen.is_live:
        viewer_program()
    return request


def _scenario(path: Path | None, changes: dict[str, Any]) -> Scenario:
    """The scenario of a file, with the changes of the command line."""
    return with_changes(load(path or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})


def _snapshot(chosen: HarvestOptions, where: str) -> Snapshot:
    """The newest usable snapshot; unusable ones are reported. What is left of a run whose run.py was killed is ended first.

    Raises SnapshotError, or ValueError for options that a snapshot defines.
    """
    from orchard.launch.left_over import end_left_over

    if given := named(name for name in chosen.given() if name in (*options.CHANGES, "scenario")):
        raise ValueError(f"--resume: leave out {given}: that is in the snapshot")
    refused: list[str] = []
    end_left_over(RUNS.folder, print_error)
    with sole(RUNS.snapshots(where)):
        found = newest(RUNS.snapshots(where), refused)
    for why in refused:
        print_error(f"not used: {why}")
    if found.lost:
        lost = ", ".join(f"{name} (tick {tick})" for name, tick in sorted(found.lost.items()))
        print_error(f"no host was there for {lost}: the robots stood, and the hash is not that of a run without this")
    return found


def _run_local(request: RunRequest) -> tuple[dict[str, Any], str]:
    """Run everything in this process."""
    from orchard.launch.local_run import run_watched

    return run_watched(request)


def _run_processes(request: RunRequest) -> tuple[dict[str, Any] | None, str]:
    """Run physics, agents and logger in separate processes."""
    from orchard.launch.distributed import run

    with exit_on_errors(BusError, OSError, ValueError), Progress(console, request.options.progress == "json") as progress:
        return run(request, progress)


def _join_run(chosen: HarvestOptions, endpoint: str, only: list[str]) -> int:
    """Host these agents of a run elsewhere. Return the exit code."""
    from orchard.launch.distributed import join_run

    with exit_on_errors(BusError, ValueError), Progress(console) as progress:
        return join_run(endpoint, only, chosen.without or [], Credentials.of(chosen), progress)


# -- the emergency stop


@app.command()
def stop(robots: options.Robots = None, connect: options.There = None, secure: options.EmergencyOperator = None) -> None:
    """Stop robots of an active run, each with its bin. They stand until they are reset."""
    raise typer.Exit(_switch(robots or [], connect, secure, True))


@app.command()
def reset(robots: options.Robots = None, connect: options.There = None, secure: options.EmergencyOperator = None) -> None:
    """Let stopped robots go on."""
    raise typer.Exit(_switch(robots or [], connect, secure, False))


def _switch(robots: list[str], connect: str | None, secure: Path | None, stop: bool) -> int:
    """Stop or reset robots, and print the result. Return the exit code."""
    from orchard.launch.emergency_stop import find_run, running_here, switch
    from orchard.launch.left_over import end_left_over
    from orchard.security.identity import Keyring

    if connect is None and end_left_over(RUNS.folder, print_error) and stop and not running_here(RUNS.folder):
        return FINISHED
    with exit_on_errors(BusError, ValueError):
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
        answer = switch(find_run(RUNS.folder, connect), robots, stop, identity, print_error)
    before = [name for name in answer.stopped if name not in answer.changed]
    print_line(f"{'stopped' if stop else 'reset'}: {', '.join(answer.changed) or 'no further robot'}")
    if before:
        print_line(f"{'stopped before' if stop else 'still stopped'}: {', '.join(before)}")
    if not answer.kept:
        print_error("This holds, but is not on the disk yet: it would be lost if physics died now. Repeat the command to check.")
    return FINISHED


# -- security


@app.command()
def secure(
    folder: options.Certificates,
    scenario: options.File = None,
    rows: options.Rows = None,
    pickers: options.Pickers = None,
    carriers: options.Carriers = None,
    hosts: options.Hosts = None,
    role: options.Role = None,
    address: options.Address = None,
    days: options.Days = 365,
    anew: options.Anew = False,
) -> None:
    """Make certificates and access rules, so that each process of a run can do only what its role allows."""
    from orchard.launch.distributed import agent_names
    from orchard.security.identity import host_roles, make

    with exit_on_errors(ScenarioError, OSError, ValueError):
        chosen = _scenario(scenario, {"rows": rows, "pickers": pickers, "carriers": carriers})
        roles = make(folder, host_roles(agent_names(chosen), role or (), lambda rest: shares(rest, hosts)), address or (), days, anew)
    for made_role in roles:
        print_line(f"{folder / made_role.name}: {', '.join(made_role.names) or made_role.duty}")


# -- recordings and the page


@app.command()
def view(recording: options.Recording = None) -> None:
    """Open a recording, with all its parts, in the Rerun viewer."""
    path = recording or RUNS.newest_recording()
    if path is None or not path.is_file():
        print_error(f"{path or RUNS.folder}: no recording there; `make run` makes one")
        raise typer.Exit(BAD_INPUT)
    with exit_on_errors(OSError):
        command = window(*map(str, parts_of(path)))
    raise typer.Exit(subprocess.run(command).returncode)


def main() -> None:
    """Run a command of the command line; `harvest` is the default."""
    arguments = sys.argv[1:]
    sys.path.append(os.getcwd())  # for the user's own classes
    if arguments[:1] == ["app"]:
        from orchard.app.__main__ import main as serve  # its packages are an extra

        raise SystemExit(serve(arguments[1:]))
    is_named = arguments[:1] and arguments[0] in ("view", "harvest", "stop", "reset", "secure")
    try:
        app(arguments if is_named else ["harvest", *arguments])
    finally:
        console.end()
        errors.end()


if __name__ == "__main__":
    main()
