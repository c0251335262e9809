"""Harvest an orchard: start the processes, watch them, tell how it goes and how it went.

    python run.py [SCENARIO.yaml] [--rows 5 --pickers 2 ...]
    python run.py view [FILE.rrd]
"""

import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from orchard.config import Scenario, ScenarioError, load, to_yaml, with_changes
from orchard.progress import Progress
from orchard.summary import as_table, write

if TYPE_CHECKING:
    from orchard.bus import Bus
    from processes.fleet import Fleet

HERE = Path(__file__).parent
RUNS = HERE / "runs"
STOP_SECONDS = 2.0  # for which the processes may close what they have open, after Ctrl-C
GOODBYE_SECONDS = 60.0  # for which the logger may pack its recording, after a run that ended by itself
LIVE_SPEED = 4.0  # with --view, unless another is given
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


Speed = Annotated[float | None, typer.Option(parser=_speed, metavar="X|max", help="1 is real time. Default: max; --view: 4; realtime: 1.")]
Hosts = Annotated[int | None, typer.Option(parser=_hosts, metavar="N|each", help="Agent processes. Default: one a core, at most 4.")]
Duration = Annotated[float | None, typer.Option(callback=_seconds, help="Stop after so many simulated seconds.")]
Record = Annotated[str | None, typer.Option(metavar="FILE.rrd|none", help="Where the recording goes. Default: a new file in runs/.")]


@dataclass(frozen=True)
class Wish:
    """How a run shall be run."""

    scenario: Scenario
    mode: Mode
    speed: float  # simulated seconds to a second; infinity: as fast as it goes
    hosts: int | None  # agent processes; 0: one each; None: a sensible few
    duration: float | None  # s, simulated
    recording: Path | None
    view: bool


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
    summary: Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the summary.")] = None,
) -> None:
    """Harvest an orchard to the end."""
    changes = {"rows": rows, "pickers": pickers, "row_width": row_width, "carriers": carriers, "seed": seed}
    try:
        chosen = with_changes(load(scenario or HERE / "config" / "orchard.yaml"), **{k: v for k, v in changes.items() if v is not None})
        recording = _recording(record)
        _check_folder(summary)
    except (ScenarioError, OSError) as error:
        errors.print(str(error), markup=False, soft_wrap=True)
        raise typer.Exit(BAD_INPUT) from None
    wish = Wish(chosen, mode, _pace(mode, speed, view), hosts, duration, recording, view)
    result, why = (_alone if mode == Mode.local else _together)(wish)
    raise typer.Exit(_tell(result, why, recording, summary))


def _pace(mode: Mode, speed: float | None, view: bool) -> float:
    """Simulated seconds to a second."""
    if mode != Mode.realtime:
        return speed if speed is not None else LIVE_SPEED if view else math.inf
    if speed is not None and math.isinf(speed):
        raise typer.BadParameter("max: in realtime the wall clock sets the pace; wanted is a number, 1 for real time", param_hint="--speed")
    return speed or 1.0


def _recording(record: str | None) -> Path | None:
    if record == "none":
        return None
    path = Path(record) if record else RUNS / f"harvest-{datetime.now():%Y%m%d-%H%M%S}.rrd"
    path.parent.mkdir(parents=True, exist_ok=True)
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
    console.print(as_table(result))
    if summary is not None:
        write(result, summary)
    good = why in ("harvested", "duration", "stopped")
    if not good:
        errors.print(why, markup=False)
    if recording is not None and recording.exists():
        command = f"{_shown(Path(sys.executable))} {_shown(HERE / 'run.py')} view {_shown(recording)}"
        console.print(f"To watch it: {command}", soft_wrap=True, markup=False)
    return FINISHED if good else FAILED


def _shown(path: Path) -> str:
    """A path as one would type it here."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


# -- local mode


def _alone(wish: Wish) -> tuple[dict[str, Any], str]:
    """All in this process."""
    from processes.alone import run

    recorder = _recorder(wish)
    try:
        with Progress(Console(highlight=False)) as progress:
            return run(wish.scenario, wish.speed, wish.duration, recorder and recorder.tick, progress.show)
    finally:
        if recorder is not None:
            recorder.close()


def _recorder(wish: Wish) -> Any:
    """Where frames go; None where nobody wants them."""
    if wish.recording is None and not wish.view:
        return None
    from orchard.layout import lay_out
    from orchard.view import Recorder
    from processes.fleet import free_port

    recorder = Recorder(lay_out(wish.scenario), _run_name(wish), wish.recording, serve=wish.view, port=free_port() if wish.view else 0)
    if wish.view:
        _open_viewer(recorder.uri)
    return recorder


def _run_name(wish: Wish) -> str:
    return f"{wish.scenario.rows} rows, seed {wish.scenario.seed}"


# -- lockstep and realtime


def _together(wish: Wish) -> tuple[dict[str, Any] | None, str]:
    """Physics, agents and logger as processes of their own."""
    from processes.fleet import Fleet

    with TemporaryDirectory() as folder, Progress(Console(highlight=False)) as progress, Fleet(progress.say) as fleet:
        file = Path(folder) / "scenario.yaml"
        file.write_text(to_yaml(wish.scenario))
        endpoint, viewer = _start(fleet, wish, file)
        summary, why = _follow(fleet, endpoint, progress)
        fleet.wait(STOP_SECONDS if why == "stopped" else GOODBYE_SECONDS)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why


def _start(fleet: "Fleet", wish: Wish, file: Path) -> tuple[str, subprocess.Popen | None]:
    """Start everything; the endpoint at which it meets, and the viewer."""
    from processes.fleet import Program, free_port

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    pace = ["--mode", wish.mode.value, "--speed", "max" if math.isinf(wish.speed) else str(wish.speed)]
    limit = [] if wish.duration is None else ["--duration", str(wish.duration)]
    fleet.start(Program("physics", "processes.physics", [str(file), "--listen", endpoint, *pace, *limit]))
    for name, share in _shares(wish.scenario, wish.hosts):
        fleet.start(Program(name, "processes.agents", ["--connect", endpoint, *share], again=True))
    return endpoint, _start_logger(fleet, wish, endpoint)


def _start_logger(fleet: "Fleet", wish: Wish, endpoint: str) -> subprocess.Popen | None:
    """Start the logger, if anything is to be recorded or seen; the viewer."""
    from processes.fleet import Program, free_port

    port = free_port()
    file = [] if wish.recording is None else ["--record", str(wish.recording.resolve())]
    live = ["--serve", str(port)] if wish.view else []
    if file or live:
        fleet.start(Program("logger", "processes.logger", ["--connect", endpoint, *file, *live]))
    return _open_viewer(f"rerun+http://127.0.0.1:{port}/proxy") if wish.view else None


def _shares(scenario: Scenario, hosts: int | None) -> list[tuple[str, list[str]]]:
    """(name of an agent process, which agents it hosts)."""
    if hosts == 0:
        from orchard.agents import cast
        from orchard.layout import lay_out

        return [(name, ["--only", name]) for name in cast(lay_out(scenario))]
    count = hosts or min(4, os.cpu_count() or 1)
    return [(f"agents {i + 1}", ["--share", f"{i}/{count}"]) for i in range(count)]


def _follow(fleet: "Fleet", endpoint: str, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    """Show how it goes until it is over; the summary, and why it ended."""
    from orchard.bus import BusError, Inbox, Signal, client
    from orchard.keys import Keys

    inbox, keys = Inbox(), Keys()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))
    try:
        with client(endpoint, inbox) as bus:
            for what in ("figures", "end"):
                bus.subscribe(keys.of(what))
            return _listen(fleet, bus, keys.of("end"), progress)
    except BusError as error:
        return None, str(error)


def _listen(fleet: "Fleet", bus: "Bus", end_key: str, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    from orchard.bus import Sample, Signal
    from orchard.wire import End, Figures, read

    deadline = math.inf
    while time.monotonic() < deadline:
        item = bus.inbox.take(0.2)
        if isinstance(item, Signal):
            fleet.terminate("physics")
            deadline = min(deadline, time.monotonic() + STOP_SECONDS)
        elif isinstance(item, Sample) and item.key == end_key:
            end = read(item.payload, End)
            return end.summary, end.why
        elif isinstance(item, Sample):
            figures = read(item.payload, Figures)
            progress.show(figures.figures, figures.doing, figures.waits_for)
        elif fleet.exit_code("physics") is not None:
            return None, f"physics ended with code {fleet.exit_code('physics')}"
        fleet.watch()
    return None, "stopped"


# -- looking at recordings


def _open_viewer(what: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "rerun", what], start_new_session=True)


@app.command()
def view(recording: Annotated[Path | None, typer.Argument(metavar="FILE.rrd", show_default="the newest in runs/")] = None) -> None:
    """Open a recording in the Rerun viewer."""
    newest = max(RUNS.glob("*.rrd"), key=lambda path: path.stat().st_mtime, default=None)
    path = recording or newest
    if path is None or not path.is_file():
        errors.print(f"{path or RUNS}: no recording there; `make run` makes one", markup=False)
        raise typer.Exit(BAD_INPUT)
    raise typer.Exit(subprocess.run([sys.executable, "-m", "rerun", str(path)]).returncode)


def main() -> None:
    """`harvest` is the command that need not be named."""
    named = {"view", "harvest"}
    arguments = sys.argv[1:]
    app(arguments if arguments and arguments[0] in named else ["harvest", *arguments])


if __name__ == "__main__":
    main()
