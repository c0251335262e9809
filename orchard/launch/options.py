"""The options of a harvest: their types and values, help texts, and what cannot be together.

Typer makes the command line and its --help from `HarvestOptions` (orchard/terminal/options.py has
the groups and helpers). The other modules of this package read its values.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, BadParameter, Exit

from orchard.contract.agent import Holds
from orchard.contract.messages import LAST_TICK
from orchard.field.queue import QUEUES
from orchard.field.scenario import DISPATCH_POLICIES, ROW_RULES, TIME_STEP
from orchard.server.snapshots import KEYFRAME_SECONDS
from orchard.terminal.options import (
    NETWORK,
    ORCHARD,
    OUTPUT,
    RUN,
    File,
    Hosts,
    Pickers,
    Rows,
    Style,
    flag,
    folder,
    number,
    option,
)
from orchard.terminal.typed import named

# Simulated seconds per second, with --view or --web, if no speed is given.
LIVE_SPEED = 4.0
# Simulated s: the time of the last tick that fits on the wire. It bounds all times and speeds.
LONGEST = LAST_TICK * TIME_STEP
# s of wall time. A host whose agent writes to one of a silent host notices after up to twice
# `mailbox.LOST_SECONDS`, which is 1 s. With less patience than that it would be given up, too.
LEAST_PATIENCE = 3.0
Mode = Literal["local", "lockstep", "realtime"]

# -- parsers; all of them raise BadParameter


def _speed(text: str) -> float:
    """Return the speed in simulated seconds per second; infinity: as fast as possible."""
    if text == "max":
        return math.inf
    speed = number(text)
    if not 0 < speed <= LONGEST:
        raise BadParameter(
            f"{text}: expected a number above 0 (1 is real time), at most {LONGEST:.0f}, or max"
        )
    return speed


def _seconds(value: float | None) -> float | None:
    """Return a simulated time, s."""
    if value is not None and not 0 < value <= LONGEST:
        raise BadParameter(f"{value}: expected a number above 0, at most {LONGEST:.0f}")
    return value


def _patience(value: float | None) -> float | None:
    """Return how long lockstep waits for an agent, s."""
    if value is not None and not LEAST_PATIENCE <= value <= LONGEST:
        raise BadParameter(
            f"{value}: expected {LEAST_PATIENCE:g} to {LONGEST:.0f}: "
            "a host needs 2 s to detect an unanswered letter"
        )
    return value


def _print_version(is_wanted: bool) -> bool:
    """Print the version of the installed package, and end. Raises Exit."""
    if is_wanted:
        with suppress(PackageNotFoundError):
            print(f"orchard {version('orchard-sim')}", flush=True)
            raise Exit
        raise BadParameter(
            "unknown: this is a clone that is not installed; git describe --always tells its commit"
        )
    return is_wanted


# -- the options


def _rule(subject: str, builtin: Iterable[str]) -> Any:
    """Return the option that names a class. `subject`: what this class decides."""
    return option(ORCHARD, f"{subject}: {', '.join(builtin)}, or module.Class.", "NAME")


# Options that change the scenario.
CHANGES = (
    "rows",
    "pickers",
    "row_width",
    "carriers",
    "seed",
    "dispatch",
    "rows_to_pickers",
    "route",
)
# The only options that go together with --only, which hosts agents of a run elsewhere.
OF_ONLY = (
    "only",
    "connect",
    "without",
    "hosts",
    "secure",
    "progress",
    "check_agents",
)


@dataclass(frozen=True, kw_only=True)
class HarvestOptions:
    """The options of a harvest, in the order of --help."""

    scenario: File = None
    rows: Rows = None
    pickers: Pickers = None
    row_width: float | None = option(ORCHARD, "Width of a row, 3.15 to 12 m.")
    carriers: int | None = option(ORCHARD, "Carriers, 1 to 120. Default: 7 for every 10 pickers.")
    seed: int | None = option(ORCHARD, "The same seed gives the same run.")
    dispatch: str | None = _rule("Which carrier fetches which bin, and when", DISPATCH_POLICIES)
    rows_to_pickers: str | None = _rule("Which picker picks which rows", ROW_RULES)
    route: str | None = _rule("Where pickers and carriers drive", QUEUES)
    mode: Mode = option(
        RUN, "lockstep or realtime: several processes; local: one.", default="lockstep"
    )
    speed: float | None = option(
        RUN, "1: real time. Default: max; live: 4; realtime: 1.", "X|max", parser=_speed
    )
    # How many processes host agents. 0: one for each agent; None: one per core, at most 4.
    hosts: Hosts = None
    duration: float | None = option(
        RUN, "Simulated seconds after which the run stops.", callback=_seconds
    )
    record: str | None = option(
        OUTPUT, "File of the recording. Default: a new one.", "FILE.rrd|none"
    )
    view: bool = flag(
        OUTPUT, "--view", "Open the viewer and watch live. Its window stays; Ctrl-C closes it."
    )
    web: int | None = option(
        OUTPUT, "Watch live in a browser on this machine.", "PORT", min=1024, max=65534
    )
    summary: Path | None = option(OUTPUT, "Write the summary to this file.", "FILE.json")
    keyframes: float = option(
        OUTPUT,
        "Simulated time between moments for forks.",
        "SECONDS",
        default=KEYFRAME_SECONDS,
        min=0.1,
        max=LONGEST,
    )
    table: Path | None = option(
        OUTPUT, "Write Parquet tables to this folder: docs/how-to.md.", "DIR", parser=folder
    )
    progress: Style = "text"
    listen: str | None = option(
        NETWORK, "Address where other machines may join: tcp/0.0.0.0:7447.", "ENDPOINT"
    )
    connect: str | None = option(NETWORK, "Use another router: tcp/192.168.1.10:7447.", "ENDPOINT")
    without: list[str] | None = option(
        NETWORK, "Wait for other processes to run these agents (repeatable).", "KIND|NAME"
    )
    only: list[str] | None = option(
        NETWORK, "Run only these agents, of a run elsewhere (repeatable).", "KIND|NAME"
    )
    patience: float | None = option(
        RUN, "Seconds that lockstep waits for a silent agent. Default: 15.", callback=_patience
    )
    check_agents: bool = flag(
        RUN, "--check-agents", "Check that own agents are repeatable: docs/extending.md."
    )
    check_holds: bool = flag(
        RUN, "--check-holds", "Check that no agent holds its velocity too long."
    )
    # Benchmarks and old scripts give it. Users have --check-holds, which names what is wrong.
    ignore_holds: bool = flag(
        RUN, "--ignore-holds", "Ask all agents at every tick: same result, slower.", hidden=True
    )
    resume: str | None = option(RUN, "Continue a run from its newest snapshot.", "RUN|last")
    replay: Path | None = option(
        RUN, "Let the velocities in a bag drive its robots: docs/ros2.md.", "FILE.mcap"
    )
    from_first_stamp: bool = flag(
        RUN, "--from-first-stamp", "Begin at the first velocity in the bag, not at its time 0."
    )
    own_code: bool = flag(
        RUN, "--own-code", "Import the code that the scenario in a bag names: docs/ros2.md."
    )
    secure: Path | None = option(
        NETWORK, "Admit only the roles of `orchard secure DIR`; with --only: DIR/<role>.", "DIR"
    )
    verbose: bool = flag(None, "--verbose", "Print all figures of the summary.")
    version: bool = flag(
        None, "--version", "Show the version and exit.", is_eager=True, callback=_print_version
    )

    @property
    def is_live(self) -> bool:
        """Whether a user watches the run while it goes on."""
        return self.view or self.web is not None

    @property
    def pace(self) -> float:
        """The speed in simulated seconds per second of wall time; infinity: as fast as possible."""
        if self.speed is not None:
            return self.speed
        if self.mode == "realtime":
            return 1.0
        if self.is_live:
            return LIVE_SPEED
        return math.inf

    @property
    def holds(self) -> Holds:
        """Which agents are asked at a tick: see `orchard.sim.lookahead`."""
        if self.check_holds:
            return "checked"
        if self.ignore_holds:
            return "ignored"
        return "on"

    @property
    def changes(self) -> dict[str, Any]:
        """The values of the scenario that are given as options: name -> value."""
        changes = {}
        for name in CHANGES:
            value = getattr(self, name)
            if value is not None:
                changes[name] = value
        return changes

    def given(self) -> list[str]:
        """Return the names of the options that are not at their defaults."""
        return [field.name for field in fields(self) if getattr(self, field.name) != field.default]

    def typed(self, parameters: Iterable[str]) -> str:
        """Return what was given as a user types it: --rows, mine.yaml."""
        words = []
        for name in parameters:
            if name == "scenario":
                words.append(str(self.scenario))
            else:
                words.append(named([name]))
        return ", ".join(words)

    def given_but(self, allowed: Iterable[str]) -> str:
        """Return what was given of the options that are not allowed, as a user types it."""
        return self.typed(name for name in self.given() if name not in set(allowed))

    def check(self) -> None:
        """Check which options are together. Raises BadParameter for the first fault."""
        for option_name, reason in self.faults():
            raise BadParameter(reason, param_hint=option_name)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Yield each option that cannot be together with the others, and why."""
        yield from self._faults_of_mode()
        yield from self._faults_of_network()
        yield from self._faults_of_replay()

    def _faults_of_mode(self) -> Iterator[tuple[str, str]]:
        """Yield what cannot be in the chosen mode."""
        has_network = self.listen or self.connect or self.without or self.only
        if self.mode == "local" and has_network:
            yield (
                "--mode",
                "local mode is one process; leave out --listen, --connect, --without and --only",
            )
        if self.mode == "local" and self.secure:
            yield "--secure", "local mode is one process, and has no network to secure"
        if self.mode == "realtime" and (self.check_holds or self.ignore_holds):
            yield (
                "--mode",
                "in realtime all agents are asked at every tick; "
                "leave out --check-holds and --ignore-holds",
            )
        if self.mode == "realtime" and self.speed == math.inf:
            yield (
                "--speed",
                "max: in realtime the wall clock sets the pace; expected a number, 1 for real time",
            )
        if self.check_holds and self.ignore_holds:
            yield (
                "--check-holds",
                "holds are either checked or ignored: give --check-holds or --ignore-holds",
            )

    def _faults_of_network(self) -> Iterator[tuple[str, str]]:
        """Yield what cannot be of the addresses, the agents elsewhere and the roles."""
        if self.listen and self.connect:
            yield (
                "--listen",
                "a run either listens or uses another router: give --listen or --connect",
            )
        if self.only and not self.connect:
            yield "--only", "--connect ENDPOINT is needed: it names the run of these agents"
        if self.only:
            needless = self.given_but(OF_ONLY)
            if needless:
                yield "--only", f"leave out {needless}: the run itself defines that"
        if self.secure and self.hosts is not None:
            yield "--secure", "leave out --hosts: the roles say which process hosts which agents"

    def _faults_of_replay(self) -> Iterator[tuple[str, str]]:
        """Yield what cannot be of a bag that drives robots."""
        if self.replay and self.resume:
            yield "--replay", "a replay begins at its bag's beginning; leave out --resume"
        if self.from_first_stamp and not self.replay:
            yield (
                "--from-first-stamp",
                "it is about a bag's velocities: give --replay FILE.mcap, too",
            )
        if self.own_code and not self.replay:
            yield "--own-code", "it is about the scenario in a bag: give --replay FILE.mcap, too"

    def notes(self) -> list[str]:
        """Return what a user may not expect: which options are ignored, and what is chosen."""
        notes = []
        if self.mode == "local":
            ignored = [name for name in ("hosts", "patience") if getattr(self, name) is not None]
            if ignored:
                notes.append(f"ignored: {named(ignored)}; local mode is one process")
        if self.is_live and self.speed is None and self.mode != "realtime":
            notes.append(
                f"live at {LIVE_SPEED:g} times real time; "
                "--speed X sets another speed, --speed max none"
            )
        return notes


_BAG = Annotated[Path, Argument(metavar="FILE.mcap", help="The bag.", show_default=False)]


@dataclass(frozen=True, kw_only=True)
class ReplayOptions(HarvestOptions):
    """The options of a harvest in which a bag drives its robots."""

    replay: _BAG = field()
