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
from rich.console import Console

from orchard.agents.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, check, load, with_changes
from orchard.launch import options
from orchard.launch.options import Mode, check_only, check_places, check_secure, named, pace
from orchard.launch.request import RunRequest
from orchard.launch.runs import Runs, check_writable
from orchard.launch.terminal import BAD_INPUT, FINISHED, exit_on_errors, print_error, report_recording, report_result, report_snapshots
from orchard.net.endpoints import BusError, check_free
from orchard.net.lockstep import PATIENCE
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
    progress: options.Show = options.ProgressStyle.text,
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
        check_only(changes | others | {"view": view, "web": web})
        raise typer.Exit(_join_run(connect, only, without or [], secure, hosts))
    with exit_on_errors(ScenarioError, SnapshotError, BusError, OSError, ValueError):
        before = None if resume is None else _snapshot(resume, changes | {"scenario": scenario})
        chosen = _scenario(scenario, changes) if before is None else check(before.scenario, "the snapshot's scenario")
        check_plugins(lay_out(chosen))
        recording, snapshots = RUNS.recording(record), RUNS.snapshots(resume)
        _check_outputs(summary, web)
        if recording is not None or view or web is not None:
            viewer_program()
    request = RunRequest(
        scenario=chosen,
        mode=mode.value,
        speed=pace(mode, speed, view or web is not None),
        hosts=hosts,
        duration=duration,
        recording=recording,
        view=view,
        snapshots=snapshots,
        resumed=before,
        listen=listen,
        connect=connect,
        without=tuple(without or ()),
        patience=patience or PATIENCE,
        secure=secure,
        web=web,
        notes=RUNS.folder,
        as_json=progress == options.ProgressStyle.json,
    )
    result, why = (_run_local if mode == Mode.local else _run_processes)(request)
    code = report_result(result, why, recording, summary)
    report_snapshots(HERE / "run.py", snapshots, why)
    report_recording(HERE / "run.py", recording)
    raise typer.Exit(code)


def _scenario(path: Path | None, changes: dict[str, Any]) -> Scenario:
    """The scenario of a file, with the changes of the command line."""
    return with_changes(load(path or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})


def _snapshot(where: str, others: dict[str, Any]) -> Snapshot:
    """The newest usable snapshot; unusable ones are reported. Raises SnapshotError, or ValueError for options that a snapshot defines."""
    given = named(name for name, value in others.items() if value is not None)
    if given:
        raise ValueError(f"--resume: leave out {given}: that is in the snapshot")
    refused: list[str] = []
    with sole(RUNS.snapshots(where)):
        found = newest(RUNS.snapshots(where), refused)
    for why in refused:
        print_error(f"not used: {why}")
    return found


def _check_outputs(summary: Path | None, web: int | None) -> None:
    """Check files and ports before the harvest starts. Raises OSError or BusError."""
    if summary is not None:
        check_writable(summary)
    for port in () if web is None else (web, web + 1):  # of the page, and of its data
        check_free(f"tcp/127.0.0.1:{port}")


def _run_local(request: RunRequest) -> tuple[dict[str, Any], str]:
    """Run everything in this process."""
    from orchard.launch.local_run import run_watched

    return run_watched(request)


def _run_processes(request: RunRequest) -> tuple[dict[str, Any] | None, str]:
    """Run physics, agents and logger in separate processes."""
    from orchard.launch.distributed import run

    with exit_on_errors(BusError, ValueError), Progress(Console(emoji=False, highlight=False), request.as_json) as progress:
        return run(request, progress)


def _join_run(endpoint: str, only: list[str], without: list[str], secure: Path | None, hosts: int | None) -> int:
    """Host these agents of a run elsewhere. Return the exit code."""
    from orchard.launch.distributed import join_run
    from orchard.launch.request import credentials_of

    with exit_on_errors(BusError, ValueError), Progress(Console(emoji=False, highlight=False)) as progress:
        return join_run(endpoint, only, without, credentials_of(secure, hosts), progress)


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
    from orchard.launch.emergency_stop import find_run, switch
    from orchard.security.identity import Keyring

    with exit_on_errors(BusError, ValueError):
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
        answer = switch(find_run(RUNS.folder, connect), robots, stop, identity, print_error)
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    before = [name for name in answer.stopped if name not in answer.changed]
    console.print(f"{'stopped' if stop else 'reset'}: {', '.join(answer.changed) or 'no further robot'}", markup=False)
    if before:
        console.print(f"{'stopped before' if stop else 'still stopped'}: {', '.join(before)}", markup=False)
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
    from orchard.launch.request import shares
    from orchard.security.identity import host_roles, make

    with exit_on_errors(ScenarioError, OSError, ValueError):
        chosen = _scenario(scenario, {"rows": rows, "pickers": pickers, "carriers": carriers})
        roles = make(folder, host_roles(agent_names(chosen), role or (), lambda rest: shares(rest, hosts)), address or (), days, anew)
    console = Console(emoji=False, highlight=False)
    for made_role in roles:
        console.print(f"{folder / made_role.name}: {', '.join(made_role.names) or made_role.duty}", markup=False, soft_wrap=True)


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


def _page(arguments: list[str]) -> int:
    """Serve the page for a browser, an extra of the package. Return the exit code."""
    from orchard.app.__main__ import main as serve

    return serve(arguments)


def main() -> None:
    """Run a command of the command line; `harvest` is the default."""
    commands = {"view", "harvest", "stop", "reset", "secure"}
    arguments = sys.argv[1:]
    sys.path.append(os.getcwd())  # for the user's own classes
    if arguments[:1] == ["app"]:
        raise SystemExit(_page(arguments[1:]))
    app(arguments if arguments and arguments[0] in commands else ["harvest", *arguments])


if __name__ == "__main__":
    main()
