"""The options of run.py: what each may be, its help, and which contradict each other."""

import math
from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP

LIVE_SPEED = 4.0  # with --view, unless another is given
LONGEST = LAST_TICK * TIME_STEP  # s, simulated: so far the ticks on the wire go
LEAST_PATIENCE = 3.0  # s; more than hosting.DOUBT_SECONDS, twice: else a silent agent's correspondents would be given up with it


class Mode(StrEnum):
    """How the program is run."""

    local = "local"
    lockstep = "lockstep"
    realtime = "realtime"


# -- what one may be


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
    if value is not None and not 0 < value <= LONGEST:
        raise typer.BadParameter(f"{value}: wanted is a number above 0, at most {LONGEST:.0f}")
    return value


def _patience(value: float | None) -> float | None:
    if value is not None and not LEAST_PATIENCE <= value < math.inf:
        raise typer.BadParameter(f"{value}: wanted is a number from {LEAST_PATIENCE:g}: it takes 2 to see that a letter is not answered")
    return value


# -- the orchard

File = Annotated[Path | None, typer.Argument(metavar="SCENARIO.yaml", show_default="config/orchard.yaml")]
Rows = Annotated[int | None, typer.Option(help="Rows, 3 to 20.")]
Pickers = Annotated[int | None, typer.Option(help="Pickers, 2 to rows.")]
Carriers = Annotated[int | None, typer.Option(help="Carriers, 1 to 40.")]
DefaultCarriers = Annotated[int | None, typer.Option(help="Carriers, 1 to 40. Default: 7 for every 10 pickers.")]
RowWidth = Annotated[float | None, typer.Option(help="Width of a row, 5 to 12 m.")]
Seed = Annotated[int | None, typer.Option(help="The same seed gives the same run.")]

# -- how it is run

How = Annotated[Mode, typer.Option(help="lockstep or realtime: processes; local: one.")]
Speed = Annotated[float | None, typer.Option(parser=_speed, metavar="X|max", help="1 is real time. Default: max; --view: 4; realtime: 1.")]
Hosts = Annotated[int | None, typer.Option(parser=_hosts, metavar="N|each", help="Agent processes. Default: one a core, at most 4.")]
Duration = Annotated[float | None, typer.Option(callback=_seconds, help="Stop after so many simulated seconds.")]
Patience = Annotated[float | None, typer.Option(callback=_patience, help="Seconds that lockstep waits for a silent agent. Default: 15.")]
Resume = Annotated[str | None, typer.Option(metavar="DIR|last", help="Go on with a run from its newest snapshot.")]

# -- what is to be seen of it

Record = Annotated[str | None, typer.Option(metavar="FILE.rrd|none", help="Where the recording goes. Default: a new file in runs/.")]
View = Annotated[bool, typer.Option("--view", help="Open the viewer, and watch live.")]
Web = Annotated[int | None, typer.Option(min=1024, max=65534, metavar="PORT", help="Watch live in a browser of this machine.")]
Summary = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the summary.")]

# -- where it is run, and who may be there

Listen = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Where others may join: tcp/0.0.0.0:7447.")]
Connect = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Meet at a router elsewhere: tcp/192.168.1.10:7447.")]
Without = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Leave these to others, and wait for them (repeatable).")]
Only = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Run just these agents of a run elsewhere (repeatable).")]
Secure = Annotated[Path | None, typer.Option(metavar="DIR", help="Let in only whom `run.py secure DIR` knows; with --only: DIR/<role>.")]

# -- of the other commands

Robots = Annotated[list[str] | None, typer.Argument(metavar="[ROBOT|KIND]...", help="picker_01, carrier; default: all robots.")]
There = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Of a run elsewhere: tcp/192.168.1.10:7447. Default: the one here.")]
Warden = Annotated[Path | None, typer.Option("--secure", metavar="DIR", help="Of a secured run: the directory with the role warden.")]
Certificates = Annotated[Path, typer.Argument(metavar="DIR", help="Where the certificates go.")]
Role = Annotated[list[str] | None, typer.Option(metavar="NAME=KIND|AGENT,...", help="One host for just these (repeatable).")]
Address = Annotated[list[str] | None, typer.Option(metavar="NAME|IP", help="Where other machines find this one (repeatable).")]
Days = Annotated[float, typer.Option(min=1, max=3650, help="For how long the certificates hold.")]
Anew = Annotated[bool, typer.Option("--anew", help="Replace what an earlier call made.")]
Recording = Annotated[Path | None, typer.Argument(metavar="FILE.rrd", show_default="the newest in runs/")]


def named(parameters: Iterable[str]) -> str:
    """Options as they are typed."""
    return ", ".join(f"--{name.replace('_', '-')}" for name in parameters)


# -- which contradict each other; all of these raise typer.BadParameter


def check_places(mode: Mode, listen: str | None, connect: str | None, without: list[str] | None, only: list[str] | None) -> None:
    """Where a run may be."""
    if mode == Mode.local and (listen or connect or without or only):
        raise typer.BadParameter("local mode is one process; leave out --listen, --connect, --without and --only", param_hint="--mode")
    if listen and connect:
        raise typer.BadParameter("either be where others meet, or go where they do: --listen or --connect", param_hint="--listen")
    if only and not connect:
        raise typer.BadParameter("run these agents of which run? --connect ENDPOINT tells", param_hint="--only")


def check_secure(mode: Mode, secure: Path | None, hosts: int | None) -> None:
    """Who is let in."""
    if secure and mode == Mode.local:
        raise typer.BadParameter("local mode is one process, and has no network to secure", param_hint="--secure")
    if secure and hosts is not None:
        raise typer.BadParameter("leave out --hosts: `run.py secure` has settled which process hosts whom", param_hint="--secure")


def check_guest(others: Mapping[str, Any]) -> None:
    """With --only the rest is settled where the run is; nothing else than --connect, --without and --hosts means anything."""
    given = named(name for name, value in others.items() if value is not None and value is not False)
    if given:
        raise typer.BadParameter(f"leave out {given}: that is settled where the run is", param_hint="--only")


def pace(mode: Mode, speed: float | None, live: bool) -> float:
    """Simulated seconds to a second."""
    if mode != Mode.realtime:
        return speed if speed is not None else LIVE_SPEED if live else math.inf
    if speed is not None and math.isinf(speed):
        raise typer.BadParameter("max: in realtime the wall clock sets the pace; wanted is a number, 1 for real time", param_hint="--speed")
    return speed or 1.0
