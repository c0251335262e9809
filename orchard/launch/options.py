"""The options of `orchard`: their types and values, help texts, and what cannot be together."""

import inspect
import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from functools import wraps
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from typer import Argument, BadParameter, Exit, Option
from typer.core import TyperCommand, TyperGroup

from orchard.contract.agent import MOST_STEPS, Holds
from orchard.contract.messages import LAST_TICK
from orchard.field.queue import QUEUES
from orchard.field.scenario import DISPATCH_POLICIES, ROW_RULES, TIME_STEP
from orchard.field.shipped import DEFAULT, names
from orchard.server.options import last_tick
from orchard.server.snapshots import KEYFRAME_SECONDS

LIVE_SPEED = 4.0  # simulated s per s, with --view or --web, if no speed is given
LONGEST = LAST_TICK * TIME_STEP  # s, simulated: the time of the last tick that fits on the wire
LEAST_PATIENCE = (
    3.0  # s; over twice mailbox.DOUBT_SECONDS, or a host that writes to a silent agent goes with it
)
Mode = Literal["local", "lockstep", "realtime"]

# -- the other commands, and the groups of options in --help

COMMANDS = {
    "view": "open a recording",
    "export": "make a bag for ROS 2 from a recording",
    "replay": "let the velocities in a bag drive its robots again",
    "app": "serve the page on which you set up, run and watch an orchard",
    "stop": "emergency stop: stop robots of the active runs",
    "reset": "let stopped robots go on",
    "pause": "pause a run",
    "resume": "let a paused run go on",
    "step": "do some steps of a paused run",
    "secure": "make the certificates of a secured run",
    "layout": "import the rows of an orchard of your own, export its roads",
    "study": "compare settings: how many carriers, which policy, which route",
    "fork": "go on with a run from any moment, with something changed",
    "bound": "prove how short a harvest could be, whatever sends the carriers",
    "benchmark": "score a dispatch policy in twenty orchards, beside the built-in ones",
}
LISTED = "\n".join(f"  {name:10}{what}" for name, what in COMMANDS.items())
HELP = f"Harvest an orchard to the end.\n\n\b\nOther commands, each with its own --help:\n{LISTED}"
FORK, ORCHARD, RUN, OUTPUT, NETWORK = (
    "The fork",
    "The orchard",
    "The run",
    "What it shows and writes",
    "Several machines",
)

# -- parsers; all of them raise BadParameter


def number(text: str) -> float:
    """Return the number in a text; NaN if there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def whole(text: str, most: int, expected: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= most:
        raise BadParameter(f"{text}: {expected}")
    return int(text)


def picture_file(text: str) -> Path:
    if Path(text).suffix.lower() not in (".svg", ".png"):
        raise BadParameter(f"{text}: a picture's name ends in .svg or .png")
    return Path(text)


def _speed(text: str) -> float:
    speed = math.inf if text == "max" else number(text)
    if not 0 < speed <= (math.inf if text == "max" else LONGEST):
        raise BadParameter(
            f"{text}: expected a number above 0 (1 is real time), at most {LONGEST:.0f}, or max"
        )
    return speed


def _hosts(text: str) -> int:
    return 0 if text == "each" else whole(text, 200, "expected a number from 1 to 200, or each")


def _seconds(value: float | None) -> float | None:
    if value is not None and not 0 < value <= LONGEST:
        raise BadParameter(f"{value}: expected a number above 0, at most {LONGEST:.0f}")
    return value


def _folder(text: str) -> Path:
    if not text.strip():
        raise BadParameter("expected the name of a folder")
    return Path(text)


MOMENT = re.compile(r"(?:(?:(\d{1,4}):)?(\d{1,6}):)?(\d{1,8}(?:\.\d)?)")


def _moment(text: str) -> int:
    """Return the tick of a moment."""
    found = MOMENT.fullmatch(text)
    if (
        found is None
        or (found[2] and float(found[3]) >= 60.0)
        or (found[1] and int(found[2]) >= 60)
    ):
        raise BadParameter(f"{text}: expected a simulated time, in s or as M:SS or H:MM:SS")
    return round(
        (3600 * int(found[1] or 0) + 60 * int(found[2] or 0) + float(found[3])) / TIME_STEP
    )


def _patience(value: float | None) -> float | None:
    if value is not None and not LEAST_PATIENCE <= value <= LONGEST:
        raise BadParameter(
            f"{value}: expected {LEAST_PATIENCE:g} to {LONGEST:.0f}: a host needs 2 s to detect an unanswered letter"
        )
    return value


def _steps(text: str) -> int:
    return whole(text, MOST_STEPS, "neither a number of steps, from 1 on, nor an option")


def _scenario(path: Path | None) -> Path | None:
    if path is not None and path.suffix == ".rrd":
        raise BadParameter(f"{path}: a recording, not a scenario; did you mean the command view?")
    if path is None or path.exists() or str(path) in names():
        return path
    if near := get_close_matches(str(path).lower(), [*COMMANDS, "harvest", *names()], n=1):
        kind = "scenario" if near[0] in names() else "command"
        raise BadParameter(f"{path}: no such file; did you mean the {kind} {near[0]}?")
    if str(path).isalpha():
        known = ", ".join(names())
        raise BadParameter(
            f"{path}: no such file, and no such command (see --help); expected a scenario's file, or one of {known}"
        )
    return path


def _print_version(is_wanted: bool) -> bool:
    if is_wanted:
        with suppress(PackageNotFoundError):
            print(f"orchard {version('orchard-sim')}", flush=True)
            raise Exit
        raise BadParameter(
            "unknown: this is a clone that is not installed; git describe --always tells its commit"
        )
    return is_wanted


# -- options of several commands; those of a harvest are fields


def option(
    panel: str | None,
    words: str,
    metavar: str | None = None,
    *names: str,
    default: Any = None,
    **how: Any,
) -> Any:
    """Return the field of a dataclass that is an option. `how`: the rest of what Typer knows of it."""
    return field(
        default=default,
        metadata={
            "option": Option(*names, metavar=metavar, help=words, rich_help_panel=panel, **how)
        },
    )


def flag(panel: str | None, name: str, words: str, **how: Any) -> Any:
    """Return the field of a dataclass that is an option without a value."""
    return option(panel, words, "", name, default=False, **how)


def _rule(what: str, builtin: Iterable[str]) -> Any:
    return option(ORCHARD, f"{what}: {', '.join(builtin)}, or module.Class.", "NAME")


NAMED = f"A file, or the name of one in config/: {', '.join(name for name in names() if name != DEFAULT)}."
PROCESSES = "Agent processes. Default: one per core, at most 4."
STYLES = "text: a table on a terminal, else lines; json: JSON lines."
MOMENTS = "Simulated time between moments for forks."
File = Annotated[
    Path | None,
    Argument(metavar="SCENARIO.yaml", help=NAMED, show_default=DEFAULT, callback=_scenario),
]
Rows = Annotated[int | None, Option(help="Rows, 3 to 100.", rich_help_panel=ORCHARD)]
Pickers = Annotated[int | None, Option(help="Pickers, 2 to rows.", rich_help_panel=ORCHARD)]
Hosts = Annotated[
    int | None, Option(parser=_hosts, metavar="N|each", help=PROCESSES, rich_help_panel=RUN)
]
Style = Annotated[Literal["text", "json"], Option(help=STYLES, rich_help_panel=OUTPUT)]

# -- a harvest

CHANGES = (
    "rows",
    "pickers",
    "row_width",
    "carriers",
    "seed",
    "dispatch",
    "rows_to_pickers",
    "route",
)  # of the scenario
OF_ONLY = (
    "only",
    "connect",
    "without",
    "hosts",
    "secure",
    "progress",
    "check_agents",
)  # for agents of a run elsewhere


@dataclass(frozen=True, kw_only=True)
class HarvestOptions:
    """The options of a harvest, in the order of --help."""

    scenario: File = None
    rows: Rows = None
    pickers: Pickers = None
    row_width: float | None = option(ORCHARD, "Width of a row, 5 to 12 m.")
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
    hosts: Hosts = None  # 0: one per agent
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
        OUTPUT, MOMENTS, "SECONDS", default=KEYFRAME_SECONDS, min=0.1, max=LONGEST
    )
    table: Path | None = option(
        OUTPUT, "Write Parquet tables to this folder: docs/how-to.md.", "DIR", parser=_folder
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
    ignore_holds: bool = flag(
        RUN, "--ignore-holds", "Ask all agents at every tick: same result, slower."
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
        return self.view or self.web is not None

    @property
    def pace(self) -> float:
        """The speed in simulated seconds per second of wall time; infinity: as fast as possible."""
        if self.speed is not None:
            return self.speed
        return 1.0 if self.mode == "realtime" else LIVE_SPEED if self.is_live else math.inf

    @property
    def holds(self) -> Holds:
        return "checked" if self.check_holds else "ignored" if self.ignore_holds else "on"

    @property
    def changes(self) -> dict[str, Any]:
        return {name: value for name in CHANGES if (value := getattr(self, name)) is not None}

    def given(self) -> list[str]:
        """Return the names of the options that are not at their defaults."""
        return [field.name for field in fields(self) if getattr(self, field.name) != field.default]

    def typed(self, parameters: Iterable[str]) -> str:
        """Return what was given as a user types it: --rows, mine.yaml."""
        return ", ".join(
            str(self.scenario) if name == "scenario" else named([name]) for name in parameters
        )

    def check(self) -> None:
        """Check which options are together. Raises BadParameter."""
        for option, why in self._faults():
            raise BadParameter(why, param_hint=option)

    def _faults(self) -> Iterator[tuple[str, str]]:
        if self.mode == "local" and (self.listen or self.connect or self.without or self.only):
            yield (
                "--mode",
                "local mode is one process; leave out --listen, --connect, --without and --only",
            )
        if self.listen and self.connect:
            yield (
                "--listen",
                "a run either listens or uses another router: give --listen or --connect",
            )
        if self.only and not self.connect:
            yield "--only", "--connect ENDPOINT is needed: it names the run of these agents"
        if (self.check_holds or self.ignore_holds) and self.mode == "realtime":
            yield (
                "--mode",
                "in realtime all agents are asked at every tick; leave out --check-holds and --ignore-holds",
            )
        if self.check_holds and self.ignore_holds:
            yield (
                "--check-holds",
                "holds are either checked or ignored: give --check-holds or --ignore-holds",
            )
        if self.secure and self.mode == "local":
            yield "--secure", "local mode is one process, and has no network to secure"
        if self.secure and self.hosts is not None:
            yield "--secure", "leave out --hosts: the roles say which process hosts which agents"
        if self.only and (
            wrong := self.typed(name for name in self.given() if name not in OF_ONLY)
        ):
            yield "--only", f"leave out {wrong}: the run itself defines that"
        if self.replay and self.resume:
            yield "--replay", "a replay begins at its bag's beginning; leave out --resume"
        if self.from_first_stamp and not self.replay:
            yield (
                "--from-first-stamp",
                "it is about a bag's velocities: give --replay FILE.mcap, too",
            )
        if self.own_code and not self.replay:
            yield "--own-code", "it is about the scenario in a bag: give --replay FILE.mcap, too"
        if self.mode == "realtime" and self.speed == math.inf:
            yield (
                "--speed",
                "max: in realtime the wall clock sets the pace; expected a number, 1 for real time",
            )

    def notes(self) -> list[str]:
        """Return what a user may not expect of these options: what is ignored, and what is chosen."""
        ignored = named(
            name
            for name in ("hosts", "patience")
            if self.mode == "local" and getattr(self, name) is not None
        )
        notes = [f"ignored: {ignored}; local mode is one process"] if ignored else []
        if self.is_live and self.speed is None and self.mode != "realtime":
            notes.append(
                f"live at {LIVE_SPEED:g} times real time; --speed X sets another speed, --speed max none"
            )
        return notes


@dataclass(frozen=True, kw_only=True)
class ReplayOptions(HarvestOptions):
    """The options of a harvest in which a bag drives its robots."""

    replay: Annotated[Path, Argument(metavar="FILE.mcap", help="The bag.", show_default=False)] = (
        field()
    )


OF_FUTURES = {
    *CHANGES,
    "run",
    "at",
    "settings",
    "stop",
    "futures",
    "bisect",
    "picture",
    "duration",
    "summary",
} - {"seed"}
PARENT = "The run: last, its name, its recording, or its folder of snapshots."
FUTURES = "Compare N futures of the moment, as it was and as changed, in place of a run. Default for --bisect: 8."
BISECT = "Find the last moment, up to --at, from which some future does not end so."
CHANGED = "What changes: carriers=+1, dispatch=nearest, people.workers=0 (repeatable)."


@dataclass(frozen=True, kw_only=True)
class ForkOptions(HarvestOptions):
    """The options of a run that goes on from a moment of another one."""

    run: Annotated[str, Argument(metavar="RUN", help=PARENT, show_default=False)] = field()
    at: int | None = option(FORK, "The moment, simulated: s, or M:SS.", "M:SS", parser=_moment)
    settings: list[str] | None = option(FORK, CHANGED, "KEY=VALUE", "--set")
    stop: list[str] | None = option(
        FORK, "Robots that stand from then on (repeatable).", "ROBOT|KIND"
    )
    futures: int | None = option(FORK, FUTURES, "N", min=1, max=1000)
    bisect: str | None = option(FORK, BISECT, "jam|collision|FIGURE<NUMBER")
    picture: Path | None = option(
        FORK, "Draw the futures of --bisect over the moments.", "FILE.svg|png", parser=picture_file
    )
    scenario: None = field(default=None, init=False)  # no options of a fork
    resume: None = field(default=None, init=False)
    replay: None = field(default=None, init=False)

    def _faults(self) -> Iterator[tuple[str, str]]:
        yield from super()._faults()
        if self.at is None and self.bisect is None:
            yield "--at", "is missing: the moment at which the fork begins"
        if self.picture is not None and self.bisect is None:
            yield "--picture", "it shows the futures of --bisect: give that, too"
        if self.asks_for_futures and (
            wrong := self.typed(name for name in self.given() if name not in OF_FUTURES)
        ):
            yield (
                "--bisect" if self.bisect else "--futures",
                f"leave out {wrong}: each future is a run of its own, in local mode",
            )
        if self.asks_for_futures and any(word.startswith("seed=") for word in self.settings or []):
            yield "--set seed", "each future has a seed of its own; change something else"
        if self.at is not None and last_tick(self.duration) <= self.at:
            yield (
                "--duration",
                "the run would end before --at; it counts from the beginning of the harvest",
            )

    @property
    def asks_for_futures(self) -> bool:
        return self.futures is not None or self.bisect is not None


def named(parameters: Iterable[str]) -> str:
    """Return the options as a user types them: --row-width, --seed."""
    return ", ".join(f"--{name.replace('_', '-')}" for name in parameters)


Chosen = TypeVar("Chosen")


def with_options(kind: type[Chosen]) -> Callable[[Callable[[Chosen], None]], Callable[..., None]]:
    """Give a command the fields of a dataclass as its parameters, from which Typer makes options."""

    def decorate(command: Callable[[Chosen], None]) -> Callable[..., None]:
        @wraps(command)
        def called(**values: Any) -> None:
            command(kind(**values))

        noted = {one.name: one.metadata["option"] for one in fields(kind) if one.metadata}  # type: ignore[arg-type]
        declared = inspect.signature(kind).parameters.values()
        parameters = [
            one.replace(annotation=Annotated[one.annotation, noted.get(one.name)])
            for one in declared
        ]
        vars(called)["__signature__"] = inspect.Signature(
            sorted(parameters, key=lambda one: one.default is not one.empty)
        )
        return called

    return decorate


class _Plain:
    """A command whose option --help is shown without a value."""

    def get_help_option(self, ctx: Any) -> Any:
        if option := super().get_help_option(ctx):  # type: ignore[misc]
            option.metavar = ""
        return option


class Command(_Plain, TyperCommand):
    """A command."""


class Group(_Plain, TyperGroup):
    """A command that has commands."""


# -- other commands

Robots = Annotated[
    list[str] | None,
    Argument(metavar="ROBOT|KIND", help="picker_01, carrier; default: all robots."),
]
There = Annotated[
    str | None,
    Option(metavar="ENDPOINT", help="A run elsewhere: tcp/192.168.1.10:7447. Default: here."),
]
Steps = Annotated[int, Argument(metavar="N", parser=_steps, help="Number of steps.")]
SECURED = "For a secured run: the directory with the role emergency-operator."
EmergencyOperator = Annotated[Path | None, Option("--secure", metavar="DIR", help=SECURED)]
Browser = Annotated[
    int | None,
    Option(
        "--web", min=1024, max=65534, metavar="PORT", help="Show it in a browser on this machine."
    ),
]
Recording = Annotated[Path | None, Argument(metavar="FILE.rrd", show_default="the newest")]


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """The options of an export."""

    recording: Recording = None
    mcap: Annotated[Path, Option(metavar="FILE.mcap", help="File of the bag.")]
    robots: list[str] | None = option(
        None,
        "Bodies that are in it (repeatable). Default: pickers, carriers and the tractor.",
        "KIND|NAME",
    )
    with_scans: bool = flag(
        None,
        "--with-scans",
        "The scans too, as they are recorded: every second beam, twice a second.",
    )


SIMULATION = "A bridge to ROS 2 that may drive these robots; simulation: may pause, step, reset and end the run (repeatable)."


@dataclass(frozen=True, kw_only=True)
class SecureOptions:
    """The options of `secure`, in the order of --help."""

    folder: Annotated[Path, Argument(metavar="DIR", help="Directory for the certificates.")]
    scenario: File = None
    rows: Rows = None
    pickers: Pickers = None
    carriers: int | None = option(None, "Carriers, 1 to 120.")
    hosts: Hosts = None
    role: list[str] | None = option(
        None, "One host for exactly these agents (repeatable).", "NAME=KIND|AGENT,..."
    )
    bridge: list[str] | None = option(None, SIMULATION, "NAME[=KIND|AGENT|simulation,...]")
    address: list[str] | None = option(
        None, "Address at which other machines reach this one (repeatable).", "NAME|IP"
    )
    days: float = option(
        None, "Days for which the certificates are valid.", default=365, min=1, max=3650
    )
    anew: bool = flag(None, "--anew", "Replace the files of an earlier call.")


@dataclass(frozen=True, kw_only=True)
class BoundOptions:
    """The options of `bound`."""

    scenario: File = None
    all_rules: bool = flag(
        None,
        "--all-rules",
        "For all built-in rules that give rows to pickers, and not only the scenario's.",
    )
    work: float = option(
        None,
        "How much the solver may do for each rule: about s.",
        default=10.0,
        min=0.01,
        max=36_000.0,
    )
    summary: Path | None = option(None, "Write the bound to this file.", "FILE.json")


Port = Annotated[int, Option(min=0, max=65535, metavar="PORT", help="Port of the page.")]
Host = Annotated[
    str,
    Option(
        metavar="ADDRESS",
        help="Any client that reaches it can start runs; 0.0.0.0: under this machine's name.",
    ),
]
Folder = Annotated[
    Path | None,
    Option(
        "--runs",
        metavar="DIR",
        help="Folder of recordings and summaries. Default: that of all runs.",
    ),
]
Quiet = Annotated[bool, Option("--quiet", metavar="", help="Do not open a browser.")]

# -- an orchard of one's own

GeoJson = Annotated[
    Path,
    Argument(
        metavar="FILE.geojson",
        help="The centre lines of the rows, a LineString each.",
        show_default=False,
    ),
]
SYSTEM = "Their coordinate system, such as EPSG:2193. Default: the one that the file names."
System = Annotated[str | None, Option("--crs", metavar="NAME", help=SYSTEM)]
NewScenario = Annotated[
    Path | None,
    Option("--out", metavar="SCENARIO.yaml", help="A new file for the scenario. Default: stdout."),
]
NewMap = Annotated[Path, Option("--lif", metavar="FILE.json", help="The file for the map.")]
