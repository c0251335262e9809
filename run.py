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

import itertools
import math
import os
import shutil
import subprocess
import sys
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from orchard.access import WARDEN
from orchard.config import Scenario, ScenarioError, check, load, with_changes
from orchard.guard import replaced
from orchard.layout import lay_out
from orchard.lockstep import PATIENCE
from orchard.parts import is_further_part, parts_of, remove_further_parts
from orchard.progress import Progress
from orchard.snapshot import Snapshot, SnapshotError, newest
from orchard.summary import as_table, write
from orchard.viewer import viewer_program
from processes.wish import Wish

HERE = Path(__file__).parent
RUNS = HERE / "runs"
LAST = "last"  # of all runs: the one that went on most recently
LIVE_SPEED = 4.0  # with --view, unless another is given
LEAST_PATIENCE = 3.0  # s; more than host.DOUBT_SECONDS, twice: else a silent agent's correspondents would be given up with it
FINISHED, FAILED, BAD_INPUT = 0, 1, 2

app = typer.Typer(add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False)
errors = Console(stderr=True, highlight=False)


class Mode(StrEnum):
    """How the program is run."""

    local = "local"
    lockstep = "lockstep"
    realtime = "realtime"


def _speed(text: str) -> float:
    try:
        speed = math.inf if text == "max" else float(text)
    except ValueError:
        speed = math.nan
    if not speed > 0:
        raise typer.BadParameter(f"{text}: wanted is a number above 0 (1 is real time), or max")
    return speed


def _hosts(text: str) -> int:
    """How many agent processes; 0 for one each."""
    if text == "each":
        return 0
    if not text.isdecimal() or not 1 <= int(text) <= 200:
        raise typer.BadParameter(f"{text}: wanted is a number from 1 to 200, or each")
    return int(text)


def _seconds(value: float | None) -> float | None:
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"{value}: wanted is a number above 0")
    return value


def _patience(value: float | None) -> float | None:
    if value is not None and not LEAST_PATIENCE <= value < math.inf:
        raise typer.BadParameter(f"{value}: wanted is a number from {LEAST_PATIENCE:g}: it takes 2 to see that a letter is not answered")
    return value


Patience = Annotated[float | None, typer.Option(callback=_patience, help="Seconds that lockstep waits for a silent agent. Default: 15.")]
Speed = Annotated[float | None, typer.Option(parser=_speed, metavar="X|max", help="1 is real time. Default: max; --view: 4; realtime: 1.")]
Hosts = Annotated[int | None, typer.Option(parser=_hosts, metavar="N|each", help="Agent processes. Default: one a core, at most 4.")]
Duration = Annotated[float | None, typer.Option(callback=_seconds, help="Stop after so many simulated seconds.")]
Record = Annotated[str | None, typer.Option(metavar="FILE.rrd|none", help="Where the recording goes. Default: a new file in runs/.")]


Listen = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Where others may join: tcp/0.0.0.0:7447.")]
Connect = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Meet at a router elsewhere: tcp/192.168.1.10:7447.")]
Without = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Leave these to others, and wait for them (repeatable).")]
Only = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Run just these agents of a run elsewhere (repeatable).")]
Resume = Annotated[str | None, typer.Option(metavar="DIR|last", help="Go on with a run from its newest snapshot.")]

Secure = Annotated[Path | None, typer.Option(metavar="DIR", help="Let in only whom `run.py secure DIR` knows; with --only: DIR/<role>.")]


@app.command()
def harvest(
    scenario: Annotated[Path | None, typer.Argument(metavar="SCENARIO.yaml", show_default="config/orchard.yaml")] = None,
    rows: Annotated[int | None, typer.Option(help="Rows, 3 to 20.")] = None,
    pickers: Annotated[int | None, typer.Option(help="Pickers, 2 to rows.")] = None,
    row_width: Annotated[float | None, typer.Option(help="Width of a row, 5 to 12 m.")] = None,
    carriers: Annotated[int | None, typer.Option(help="Carriers, 1 to 40. Default: 7 for every 10 pickers.")] = None,
    seed: Annotated[int | None, typer.Option(help="The same seed gives the same run.")] = None,
    mode: Annotated[Mode, typer.Option(help="lockstep or realtime: processes; local: one.")] = Mode.lockstep,
    speed: Speed = None,
    hosts: Hosts = None,
    duration: Duration = None,
    record: Record = None,
    view: Annotated[bool, typer.Option("--view", help="Open the viewer, and watch live.")] = False,
    web: Annotated[int | None, typer.Option(min=1024, max=65534, metavar="PORT", help="Watch live in a browser of this machine.")] = None,
    summary: Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the summary.")] = None,
    listen: Listen = None,
    connect: Connect = None,
    without: Without = None,
    only: Only = None,
    patience: Patience = None,
    resume: Resume = None,
    secure: Secure = None,
) -> None:
    """Harvest an orchard to the end."""
    _check_places(mode, listen, connect, without, only)
    _check_secure(mode, secure, hosts)
    changes = {"rows": rows, "pickers": pickers, "row_width": row_width, "carriers": carriers, "seed": seed}
    if only and connect:
        others = {"scenario": scenario, "speed": speed, "duration": duration, "record": record, "summary": summary, "patience": patience}
        _check_guest(changes | others | {"view": view, "web": web})
        raise typer.Exit(_visit(connect, only, without or [], secure, hosts))
    try:
        before = None if resume is None else _snapshot(resume, changes | {"scenario": scenario})
        chosen = _scenario(scenario, changes) if before is None else check(before.scenario, "the snapshot's scenario")
        replaced(lay_out(chosen))
        recording = _recording(record)
        _check_folder(summary)
        if recording is not None or view or web is not None:
            viewer_program()
    except (ScenarioError, SnapshotError, OSError, ValueError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        raise typer.Exit(BAD_INPUT) from None
    pace = _pace(mode, speed, view or web is not None)
    snapshots = Path(resume) if resume not in (None, LAST) else RUNS / f"harvest-{datetime.now():%Y%m%d-%H%M%S}-{os.getpid()}.snapshots"
    snapshots = _newest_snapshots() if resume == LAST else snapshots
    place = (listen, connect, tuple(without or ()), patience or PATIENCE, secure, web, RUNS)
    wish = Wish(chosen, mode.value, pace, hosts, duration, recording, view, snapshots, before, *place)
    result, why = (_alone if mode == Mode.local else _together)(wish)
    code = _tell(result, why, recording, summary)
    _tell_of_snapshots(snapshots, why)
    _tell_of_recording(recording)
    raise typer.Exit(code)


def _scenario(path: Path | None, changes: dict[str, Any]) -> Scenario:
    """The file's scenario, with what is given on the command line."""
    return with_changes(load(path or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})


def _snapshot(where: str, others: dict[str, Any]) -> Snapshot:
    """The newest one that can be used; why newer ones cannot is told. Raises SnapshotError; ValueError for options that it settles."""
    given = [f"--{name.replace('_', '-')}" for name, value in others.items() if value is not None]
    if given:
        raise ValueError(f"--resume: leave out {', '.join(given)}: that is in the snapshot")
    refused: list[str] = []
    found = newest(_newest_snapshots() if where == LAST else Path(where), refused)
    for why in refused:
        errors.print(f"not used: {why}", markup=False, soft_wrap=True)
    return found


def _newest_snapshots() -> Path:
    """The folder of the last run that can go on."""
    folder = max(RUNS.glob("*.snapshots"), key=lambda path: path.stat().st_mtime, default=None)
    if folder is None:
        raise SnapshotError(f"{RUNS}: no run there that could go on; one leaves its snapshots there when it is stopped")
    return folder


def _tell_of_snapshots(folder: Path, why: str) -> None:
    """A run that is over needs none; another can go on."""
    if why == "harvested":
        shutil.rmtree(folder, ignore_errors=True)
    elif folder.is_dir():
        command = f"{_shown(Path(sys.executable))} {_shown(HERE / 'run.py')} --resume {_shown(folder)}"
        Console(highlight=False).print(f"To go on: {command}", soft_wrap=True, markup=False)


def _check_places(mode: Mode, listen: str | None, connect: str | None, without: list[str] | None, only: list[str] | None) -> None:
    """Options that contradict each other. With --only nothing else than --connect, --without and --hosts means anything."""
    if mode == Mode.local and (listen or connect or without or only):
        raise typer.BadParameter("local mode is one process; leave out --listen, --connect, --without and --only", param_hint="--mode")
    if listen and connect:
        raise typer.BadParameter("either be where others meet, or go where they do: --listen or --connect", param_hint="--listen")
    if only and not connect:
        raise typer.BadParameter("run these agents of which run? --connect ENDPOINT tells", param_hint="--only")


def _check_secure(mode: Mode, secure: Path | None, hosts: int | None) -> None:
    if secure and mode == Mode.local:
        raise typer.BadParameter("local mode is one process, and has no network to secure", param_hint="--secure")
    if secure and hosts is not None:
        raise typer.BadParameter("leave out --hosts: `run.py secure` has settled which process hosts whom", param_hint="--secure")


def _check_guest(others: dict[str, Any]) -> None:
    """With --only the rest is settled where the run is."""
    given = [f"--{name.replace('_', '-')}" for name, value in others.items() if value]
    if given:
        raise typer.BadParameter(f"leave out {', '.join(given)}: that is settled where the run is", param_hint="--only")


def _pace(mode: Mode, speed: float | None, live: bool) -> float:
    """Simulated seconds to a second."""
    if mode != Mode.realtime:
        return speed if speed is not None else LIVE_SPEED if live else math.inf
    if speed is not None and math.isinf(speed):
        raise typer.BadParameter("max: in realtime the wall clock sets the pace; wanted is a number, 1 for real time", param_hint="--speed")
    return speed or 1.0


def _recording(record: str | None) -> Path | None:
    if record == "none":
        return None
    path = Path(record) if record else RUNS / f"harvest-{datetime.now():%Y%m%d-%H%M%S}.rrd"
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_further_parts(path)
    return path


def _check_folder(summary: Path | None) -> None:
    if summary is not None and not summary.parent.is_dir():
        raise NotADirectoryError(f"--summary {summary}: there is no directory {summary.parent}")


def _tell(result: dict[str, Any] | None, why: str, recording: Path | None, summary: Path | None) -> int:
    """Print what came of it; the exit code."""
    console = Console(highlight=False)
    if result is None:
        errors.print(why, markup=False)
        return FAILED
    if recording is not None:
        from orchard.view.parts import missing  # late: Rerun takes half a second to load

        result |= missing(recording, result["ticks"])
    console.print(as_table(result))
    if summary is not None:
        write(result, summary)
    good = why in ("harvested", "duration", "stopped")
    if not good:
        errors.print(why, markup=False)
    for violation in result["violations"]:
        errors.print(f"violated: {violation}", markup=False, soft_wrap=True)
    return FINISHED if good and not result["violations"] else FAILED


def _tell_of_recording(recording: Path | None) -> None:
    """The last line is what opens it."""
    if recording is not None and recording.exists():
        command = f"{_shown(Path(sys.executable))} {_shown(HERE / 'run.py')} view {_shown(recording)}"
        Console(highlight=False).print(f"To watch it: {command}", soft_wrap=True, markup=False)


def _shown(path: Path) -> str:
    """A path as one would type it here."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


# -- local mode


def _alone(wish: Wish) -> tuple[dict[str, Any], str]:
    """All in this process."""
    from processes.alone import run

    recorder, browser, viewer = _recorder(wish), _web_viewer(wish), _viewer(wish)
    try:
        with Progress(Console(highlight=False)) as progress:
            summary, why = run(wish, recorder and recorder.tick, progress.show)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why
    finally:
        if recorder is not None:
            recorder.close()
        if browser is not None:
            browser.terminate()
            browser.wait()


def _viewer(wish: Wish) -> Any:
    """Rerun's own window; None where nobody asked for it."""
    from processes.fleet import open_viewer

    return open_viewer(wish.uri) if wish.view else None


def _web_viewer(wish: Wish) -> Any:
    """The process that serves browsers; None where nobody asked for it."""
    if wish.web is None:
        return None
    from orchard.view.web import page_url, serve_web

    Console(highlight=False).print(f"Live: {page_url(wish.web)}", soft_wrap=True)
    return serve_web(wish.web, wish.uri)


def _recorder(wish: Wish) -> Any:
    """Where frames go; None where nobody wants them."""
    if wish.recording is None and not wish.is_live:
        return None
    from orchard.view import Recorder

    port = wish.data_port if wish.is_live else 0
    return Recorder(lay_out(wish.scenario), _run_name(wish), wish.recording, serve=wish.is_live, port=port)


def _run_name(wish: Wish) -> str:
    return f"{wish.scenario.rows} rows, seed {wish.scenario.seed}"


# -- lockstep and realtime


def _together(wish: Wish) -> tuple[dict[str, Any] | None, str]:
    """Physics, agents and logger as processes of their own."""
    from orchard.endpoints import BusError
    from processes.together import run

    try:
        with Progress(Console(highlight=False)) as progress:
            return run(wish, progress)
    except (BusError, ValueError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        raise typer.Exit(BAD_INPUT) from None


def _visit(endpoint: str, only: list[str], without: list[str], secure: Path | None, hosts: int | None) -> int:
    """Run these agents of a run elsewhere; the exit code."""
    from orchard.endpoints import BusError
    from processes.passes import passes_of
    from processes.together import visit

    try:
        with Progress(Console(highlight=False)) as progress:
            return visit(endpoint, only, without, passes_of(secure, hosts), progress)
    except (BusError, ValueError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        return BAD_INPUT


# -- the emergency stop

Robots = Annotated[list[str] | None, typer.Argument(metavar="[ROBOT|KIND]...", help="picker_01, carrier; default: all robots.")]
There = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Of a run elsewhere: tcp/192.168.1.10:7447. Default: the one here.")]

Warden = Annotated[Path | None, typer.Option("--secure", metavar="DIR", help="Of a secured run: the directory with the role warden.")]


@app.command()
def stop(robots: Robots = None, connect: There = None, secure: Warden = None) -> None:
    """Stop robots of a run that goes on, each with its bin; they stand until they are reset."""
    raise typer.Exit(_switch(robots or [], connect, secure, True))


@app.command()
def reset(robots: Robots = None, connect: There = None, secure: Warden = None) -> None:
    """Let stopped robots go on."""
    raise typer.Exit(_switch(robots or [], connect, secure, False))


def _switch(robots: list[str], connect: str | None, secure: Path | None, stop: bool) -> int:
    """Stop or reset, and tell what came of it; the exit code."""
    from orchard.endpoints import BusError
    from orchard.identity import Keyring
    from processes.stopping import switch, the_run

    try:
        identity = None if secure is None else Keyring.load(secure).of(WARDEN)
        answer = switch(the_run(RUNS, connect), robots, stop, identity, lambda line: errors.print(line, markup=False, soft_wrap=True))
    except (BusError, ValueError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        return BAD_INPUT
    console = Console(highlight=False, soft_wrap=True)
    before = [name for name in answer.stopped if name not in answer.changed]
    console.print(f"{'stopped' if stop else 'reset'}: {', '.join(answer.changed) or 'nobody more'}", markup=False)
    if before:
        console.print(f"{'stopped before' if stop else 'still stopped'}: {', '.join(before)}", markup=False)
    if not answer.kept:
        errors.print("That holds, but is not on the disk yet: physics would forget it if it died now. Ask again to see whether it is.")
    return FINISHED


# -- security


@app.command()
def secure(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the certificates go.")],
    scenario: Annotated[Path | None, typer.Argument(metavar="SCENARIO.yaml", show_default="config/orchard.yaml")] = None,
    rows: Annotated[int | None, typer.Option(help="Rows, 3 to 20.")] = None,
    pickers: Annotated[int | None, typer.Option(help="Pickers, 2 to rows.")] = None,
    carriers: Annotated[int | None, typer.Option(help="Carriers, 1 to 40.")] = None,
    hosts: Hosts = None,
    role: Annotated[list[str] | None, typer.Option(metavar="NAME=KIND|AGENT,...", help="One host for just these (repeatable).")] = None,
    address: Annotated[list[str] | None, typer.Option(metavar="NAME|IP", help="Where other machines find this one (repeatable).")] = None,
    days: Annotated[float, typer.Option(min=1, max=3650, help="For how long the certificates hold.")] = 365,
    anew: Annotated[bool, typer.Option("--anew", help="Replace what an earlier call made.")] = False,
) -> None:
    """Make certificates and rules, so that each process of a run may do only its own."""
    from orchard.security import host_roles, make
    from processes.passes import shares
    from processes.together import agent_names

    changes = {"rows": rows, "pickers": pickers, "carriers": carriers}
    try:
        chosen = with_changes(load(scenario or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})
        roles = make(folder, host_roles(agent_names(chosen), role or (), lambda rest: shares(rest, hosts)), address or (), days, anew)
    except (ScenarioError, OSError, ValueError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        raise typer.Exit(BAD_INPUT) from None
    console = Console(highlight=False)
    for one in roles:
        console.print(f"{folder / one.name}: {', '.join(one.names) or one.duty}", markup=False, soft_wrap=True)


# -- looking at recordings


@app.command()
def view(recording: Annotated[Path | None, typer.Argument(metavar="FILE.rrd", show_default="the newest in runs/")] = None) -> None:
    """Open a recording in the Rerun viewer, all its parts together."""
    newest = max(itertools.filterfalse(is_further_part, RUNS.glob("*.rrd")), key=lambda path: path.stat().st_mtime, default=None)
    path = recording or newest
    if path is None or not path.is_file():
        errors.print(f"{path or RUNS}: no recording there; `make run` makes one", markup=False)
        raise typer.Exit(BAD_INPUT)
    try:
        program = viewer_program()
    except OSError as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        raise typer.Exit(BAD_INPUT) from None
    raise typer.Exit(subprocess.run([program, *map(str, parts_of(path))]).returncode)


def _page(arguments: list[str]) -> int:
    """Serve the page in the browser, which is an extra of the package; the exit code."""
    from orchard.app.__main__ import main as serve

    return serve(arguments)


def main() -> None:
    """`harvest` is the command that need not be named."""
    named = {"view", "harvest", "stop", "reset", "secure"}
    arguments = sys.argv[1:]
    if arguments[:1] == ["app"]:
        raise SystemExit(_page(arguments[1:]))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.path.append(os.getcwd())  # where a user's own classes are
    app(arguments if arguments and arguments[0] in named else ["harvest", *arguments])


if __name__ == "__main__":
    main()
