"""The options of run.py: their types and values, their help texts, and the combinations that are refused."""

import math
from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP

LIVE_SPEED = 4.0  # simulated s per s, with --view or --web, if no speed is given
LONGEST = LAST_TICK * TIME_STEP  # s, simulated: the time of the last tick that fits on the wire
LEAST_PATIENCE = 3.0  # s; more than twice mailbox.DOUBT_SECONDS, else the agents that write to a silent agent would be given up with it


class Mode(StrEnum):
    """How the program is run."""

    local = "local"
    lockstep = "lockstep"
    realtime = "realtime"


class ProgressStyle(StrEnum):
    """How progress is printed."""

    text = "text"
    json = "json"


# -- parsers; all of them raise typer.BadParameter


def _speed(text: str) -> float:
    try:
        speed = math.inf if text == "max" else float(text)
    except ValueError:
        speed = math.nan
    if not speed > 0:
        raise typer.BadParameter(f"{text}: expected a number above 0 (1 is real time), or max")
    return speed


def _hosts(text: str) -> int:
    """The number of agent processes; 0 for one per agent."""
    if text == "each":
        return 0
    if not text.isdecimal() or not 1 <= int(text) <= 200:
        raise typer.BadParameter(f"{text}: expected a number from 1 to 200, or each")
    return int(text)


def _seconds(value: float | None) -> float | None:
    if value is not None and not 0 < value <= LONGEST:
        raise typer.BadParameter(f"{value}: expected a number above 0, at most {LONGEST:.0f}")
    return value


def _patience(value: float | None) -> float | None:
    if value is not None and not LEAST_PATIENCE <= value < math.inf:
        raise typer.BadParameter(f"{value}: expected a number from {LEAST_PATIENCE:g}: a host needs 2 s to detect an unanswered letter")
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

How = Annotated[Mode, typer.Option(help="lockstep or realtime: several processes; local: one.")]
Speed = Annotated[float | None, typer.Option(parser=_speed, metavar="X|max", help="1: real time. Default: max; live: 4; realtime: 1.")]
Hosts = Annotated[int | None, typer.Option(parser=_hosts, metavar="N|each", help="Agent processes. Default: one per core, at most 4.")]
Duration = Annotated[float | None, typer.Option(callback=_seconds, help="Simulated seconds after which the run stops.")]
Patience = Annotated[float | None, typer.Option(callback=_patience, help="Seconds that lockstep waits for a silent agent. Default: 15.")]
Resume = Annotated[str | None, typer.Option(metavar="DIR|last", help="Continue a run from its newest snapshot.")]

# -- outputs

Record = Annotated[str | None, typer.Option(metavar="FILE.rrd|none", help="File of the recording. Default: a new one in runs/.")]
View = Annotated[bool, typer.Option("--view", help="Open the viewer and watch live.")]
Web = Annotated[int | None, typer.Option(min=1024, max=65534, metavar="PORT", help="Watch live in a browser on this machine.")]
Show = Annotated[ProgressStyle, typer.Option("--progress", help="text: a table on a terminal, else lines; json: JSON lines.")]
Summary = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the summary to this file.")]

# -- network and security

Listen = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Address where other machines may join: tcp/0.0.0.0:7447.")]
Connect = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Use another router: tcp/192.168.1.10:7447.")]
Without = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Wait for other processes to run these agents (repeatable).")]
Only = Annotated[list[str] | None, typer.Option(metavar="KIND|NAME", help="Run only these agents, of a run elsewhere (repeatable).")]
Secure = Annotated[Path | None, typer.Option(metavar="DIR", help="Admit only the roles of `run.py secure DIR`; with --only: DIR/<role>.")]

# -- other commands

Robots = Annotated[list[str] | None, typer.Argument(metavar="[ROBOT|KIND]...", help="picker_01, carrier; default: all robots.")]
There = Annotated[str | None, typer.Option(metavar="ENDPOINT", help="A run elsewhere: tcp/192.168.1.10:7447. Default: the run here.")]
EmergencyOperator = Annotated[
    Path | None, typer.Option("--secure", metavar="DIR", help="For a secured run: the directory with the role emergency-operator.")
]
Certificates = Annotated[Path, typer.Argument(metavar="DIR", help="Directory for the certificates.")]
Role = Annotated[list[str] | None, typer.Option(metavar="NAME=KIND|AGENT,...", help="One host for exactly these agents (repeatable).")]
Address = Annotated[list[str] | None, typer.Option(metavar="NAME|IP", help="Address at which other machines reach this one (repeatable).")]
Days = Annotated[float, typer.Option(min=1, max=3650, help="Days for which the certificates are valid.")]
Anew = Annotated[bool, typer.Option("--anew", help="Replace the files of an earlier call.")]
Recording = Annotated[Path | None, typer.Argument(metavar="FILE.rrd", show_default="the newest in runs/")]


def named(parameters: Iterable[str]) -> str:
    """Return the options as a user types them: --row-width, --seed."""
    return ", ".join(f"--{name.replace('_', '-')}" for name in parameters)


# -- combinations; all functions raise typer.BadParameter


def check_places(mode: Mode, listen: str | None, connect: str | None, without: list[str] | None, only: list[str] | None) -> None:
    """Check the options that say where a run and its agents are."""
    if mode == Mode.local and (listen or connect or without or only):
        raise typer.BadParameter("local mode is one process; leave out --listen, --connect, --without and --only", param_hint="--mode")
    if listen and connect:
        raise typer.BadParameter("a run either listens or uses another router: give --listen or --connect", param_hint="--listen")
    if only and not connect:
        raise typer.BadParameter("--connect ENDPOINT is needed: it names the run of these agents", param_hint="--only")


def check_secure(mode: Mode, secure: Path | None, hosts: int | None) -> None:
    """Check the options of a secured run."""
    if secure and mode == Mode.local:
        raise typer.BadParameter("local mode is one process, and has no network to secure", param_hint="--secure")
    if secure and hosts is not None:
        raise typer.BadParameter("leave out --hosts: the roles say which process hosts which agents", param_hint="--secure")


def check_only(others: Mapping[str, Any]) -> None:
    """Check that with --only no option is given that the run itself defines. `others`: option -> its value; None or False: not given."""
    given = named(name for name, value in others.items() if value is not None and value is not False)
    if given:
        raise typer.BadParameter(f"leave out {given}: the run itself defines that", param_hint="--only")


def pace(mode: Mode, speed: float | None, live: bool) -> float:
    """Return the speed in simulated seconds per second. `live`: whether the run is watched."""
    if mode != Mode.realtime:
        return speed if speed is not None else LIVE_SPEED if live else math.inf
    if speed is not None and math.isinf(speed):
        raise typer.BadParameter("max: in realtime the wall clock sets the pace; expected a number, 1 for real time", param_hint="--speed")
    return speed or 1.0
