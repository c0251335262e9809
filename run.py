"""Harvest an orchard: start the processes, watch them, tell how it goes and how it went.

python run.py [SCENARIO.yaml] [--rows 5 --pickers 2 ...]
python run.py view [FILE.rrd]
python run.py app [--port 8080]
python run.py stop [ROBOT ...]
python run.py reset [ROBOT ...]
python run.py secure DIR [SCENARIO.yaml]
"""

import signal

if __name__ == "__main__":  # Ctrl-C while the rest is being imported: there is nothing to stop yet, and nothing to say
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # whoever starts this may hold it back until here

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from orchard.agents.catalogue import named_classes
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, check, load, with_changes
from orchard.launch import options
from orchard.launch.options import Mode, check_guest, check_places, check_secure, named, pace
from orchard.launch.request import RunRequest
from orchard.launch.runs import Runs, check_writable
from orchard.launch.terminal import BAD_INPUT, FINISHED, exit_on_errors, tell, tell_error, tell_of_recording, tell_of_snapshots
from orchard.net.endpoints import BusError, check_free
from orchard.net.lockstep import PATIENCE
from orchard.report.progress import Progress
from orchard.security.roles import WARDEN
from orchard.server.snapshots import sole
from orchard.sim.snapshot import Snapshot, SnapshotError, newest
from orchard.view.files import parts_of
from orchard.view.program import viewer_program, window

HERE = Path(__file__).parent
RUNS = Runs(HERE / "runs")

EPILOG = """Other commands, each with --help of its own: view, app, stop, reset, secure.

Exit code: 0 when the harvest is finished, was stopped, or has come to its --duration; 1 when it could not; 2 for bad input."""

app = typer.Typer(add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False)


@app.callback()
def interruptible() -> None:
    """From here on Ctrl-C is told to the command, which may have something to stop; typer sees to its exit code."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


# -- a harvest


@app.command(epilog=EPILOG)
def harvest(
    scenario: options.File = None,
    rows: options.Rows = None,
    pickers: options.Pickers = None,
    row_width: options.RowWidth = None,
    carriers: options.DefaultCarriers = None,
    seed: options.Seed = None,
    mode: options.How = Mode.lockstep,
    speed: options.Speed = None,
    hosts: options.Hosts = None,
    duration: options.Duration = None,
    record: options.Record = None,
    view: options.View = False,
    web: options.Web = None,
    summary: options.Summary = None,
    listen: options.Listen = None,
    connect: options.Connect = None,
    without: options.Without = None,
    only: options.Only = None,
    patience: options.Patience = None,
    resume: options.Resume = None,
    secure: options.Secure = None,
) -> None:
    """Harvest an orchard to the end."""
    check_places(mode, listen, connect, without, only)
    check_secure(mode, secure, hosts)
    changes = {"rows": rows, "pickers": pickers, "row_width": row_width, "carriers": carriers, "seed": seed}
    if only and connect:
        others = {"scenario": scenario, "speed": speed, "duration": duration, "record": record, "summary": summary, "patience": patience}
        others |= {"mode": mode != Mode.lockstep, "resume": resume}
        check_guest(changes | others | {"view": view, "web": web})
        raise typer.Exit(_visit(connect, only, without or [], secure, hosts))
    with exit_on_errors(ScenarioError, SnapshotError, BusError, OSError, ValueError):
        before = None if resume is None else _snapshot(resume, changes | {"scenario": scenario})
        chosen = _scenario(scenario, changes) if before is None else check(before.scenario, "the snapshot's scenario")
        named_classes(lay_out(chosen))
        recording, snapshots = RUNS.recording(record), RUNS.snapshots(resume)
        _check_outputs(summary, web)
        if recording is not None or view or web is not None:
            viewer_program()
    place = (listen, connect, tuple(without or ()), patience or PATIENCE, secure, web, RUNS.folder)
    speed = pace(mode, speed, view or web is not None)
    request = RunRequest(chosen, mode.value, speed, hosts, duration, recording, view, snapshots, before, *place)
    result, why = (_alone if mode == Mode.local else _together)(request)
    code = tell(result, why, recording, summary)
    tell_of_snapshots(HERE / "run.py", snapshots, why)
    tell_of_recording(HERE / "run.py", recording)
    raise typer.Exit(code)


def _scenario(path: Path | None, changes: dict[str, Any]) -> Scenario:
    """The file's scenario, with what is given on the command line."""
    return with_changes(load(path or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})


def _snapshot(where: str, others: dict[str, Any]) -> Snapshot:
    """The newest one that can be used; why newer ones cannot is told. Raises SnapshotError; ValueError for options that it settles."""
    given = named(name for name, value in others.items() if value is not None)
    if given:
        raise ValueError(f"--resume: leave out {given}: that is in the snapshot")
    refused: list[str] = []
    with sole(RUNS.snapshots(where)):
        found = newest(RUNS.snapshots(where), refused)
    for why in refused:
        tell_error(f"not used: {why}")
    return found


def _check_outputs(summary: Path | None, web: int | None) -> None:
    """Before hours of harvest, not after. Raises OSError, BusError."""
    if summary is not None:
        check_writable(summary)
    for port in () if web is None else (web, web + 1):  # the page's, and its data's
        check_free(f"tcp/127.0.0.1:{port}")


def _alone(request: RunRequest) -> tuple[dict[str, Any], str]:
    """All in this process."""
    from orchard.launch.local_run import run_watched

    return run_watched(request)


def _together(request: RunRequest) -> tuple[dict[str, Any] | None, str]:
    """Physics, agents and logger as processes of their own."""
    from orchard.launch.distributed import run

    with exit_on_errors(BusError, ValueError), Progress(Console(emoji=False, highlight=False)) as progress:
        return run(request, progress)


def _visit(endpoint: str, only: list[str], without: list[str], secure: Path | None, hosts: int | None) -> int:
    """Run these agents of a run elsewhere; the exit code."""
    from orchard.launch.credentials import credentials_of
    from orchard.launch.distributed import visit

    with exit_on_errors(BusError, ValueError), Progress(Console(emoji=False, highlight=False)) as progress:
        return visit(endpoint, only, without, credentials_of(secure, hosts), progress)


# -- the emergency stop


@app.command()
def stop(robots: options.Robots = None, connect: options.There = None, secure: options.Warden = None) -> None:
    """Stop robots of a run that goes on, each with its bin; they stand until they are reset."""
    raise typer.Exit(_switch(robots or [], connect, secure, True))


@app.command()
def reset(robots: options.Robots = None, connect: options.There = None, secure: options.Warden = None) -> None:
    """Let stopped robots go on."""
    raise typer.Exit(_switch(robots or [], connect, secure, False))


def _switch(robots: list[str], connect: str | None, secure: Path | None, stop: bool) -> int:
    """Stop or reset, and tell what came of it; the exit code."""
    from orchard.launch.emergency_stop import find_run, switch
    from orchard.security.identity import Keyring

    with exit_on_errors(BusError, ValueError):
        identity = None if secure is None else Keyring.load(secure).of(WARDEN)
        answer = switch(find_run(RUNS.folder, connect), robots, stop, identity, tell_error)
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    before = [name for name in answer.stopped if name not in answer.changed]
    console.print(f"{'stopped' if stop else 'reset'}: {', '.join(answer.changed) or 'nobody more'}", markup=False)
    if before:
        console.print(f"{'stopped before' if stop else 'still stopped'}: {', '.join(before)}", markup=False)
    if not answer.kept:
        tell_error("That holds, but is not on the disk yet: physics would forget it if it died now. Ask again to see whether it is.")
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
    """Make certificates and rules, so that each process of a run may do only its own."""
    from orchard.launch.credentials import shares
    from orchard.launch.distributed import agent_names
    from orchard.security.create import host_roles, make

    with exit_on_errors(ScenarioError, OSError, ValueError):
        chosen = _scenario(scenario, {"rows": rows, "pickers": pickers, "carriers": carriers})
        roles = make(folder, host_roles(agent_names(chosen), role or (), lambda rest: shares(rest, hosts)), address or (), days, anew)
    console = Console(emoji=False, highlight=False)
    for one in roles:
        console.print(f"{folder / one.name}: {', '.join(one.names) or one.duty}", markup=False, soft_wrap=True)


# -- looking at recordings, and the page


@app.command()
def view(recording: options.Recording = None) -> None:
    """Open a recording in the Rerun viewer, all its parts together."""
    path = recording or RUNS.newest_recording()
    if path is None or not path.is_file():
        tell_error(f"{path or RUNS.folder}: no recording there; `make run` makes one")
        raise typer.Exit(BAD_INPUT)
    with exit_on_errors(OSError):
        command = window(*map(str, parts_of(path)))
    raise typer.Exit(subprocess.run(command).returncode)


def _page(arguments: list[str]) -> int:
    """Serve the page in the browser, which is an extra of the package; the exit code."""
    from orchard.app.__main__ import main as serve

    return serve(arguments)


def main() -> None:
    """`harvest` is the command that need not be named."""
    commands = {"view", "harvest", "stop", "reset", "secure"}
    arguments = sys.argv[1:]
    if arguments[:1] == ["app"]:
        raise SystemExit(_page(arguments[1:]))
    sys.path.append(os.getcwd())  # where a user's own classes are
    app(arguments if arguments and arguments[0] in commands else ["harvest", *arguments])


if __name__ == "__main__":
    main()
