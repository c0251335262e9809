"""The options of `orchard study`: their types and values, their help texts, and what is wrong with them, told all at once."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args
from urllib.parse import urlsplit

from typer import BadParameter, Option

from orchard.field.problems import Problem
from orchard.launch.options import File, Style, named

LEAST_CONFIDENCE, MOST_CONFIDENCE = 0.5, 0.9999
BUDGET_UNITS = {"min": 60.0, "h": 3600.0, "s": 1.0}
LEAST_BUDGET = 1.0  # s
MOST_WORKERS = 1000
PICTURES = (".svg", ".png")
QUESTION, RUNS, FILES = "The question", "The runs", "What it shows and writes"

# -- parsers; all of them raise BadParameter


def _share(text: str) -> float:
    """A share below 1: 0.01 or 1%."""
    try:
        share = float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        share = math.nan
    if not 0.0 < share < 1.0:
        raise BadParameter(f"{text}: expected a share above 0 and below 1, such as 0.01 or 1%")
    return share


def _scheduler(text: str) -> str:
    """The address of a scheduler, as dask.distributed has it."""
    try:
        url = urlsplit(text if "://" in text else f"tcp://{text}")
        is_right = bool(url.scheme and url.hostname and url.port)
    except ValueError:
        is_right = False
    if not is_right:
        raise BadParameter(f"{text}: expected an address with its port, such as tcp://192.168.1.10:8786")
    return text


def _confidence(text: str) -> float:
    confidence = _share(text)
    if not LEAST_CONFIDENCE <= confidence <= MOST_CONFIDENCE:
        raise BadParameter(f"{text}: expected a share from {LEAST_CONFIDENCE:g} to {MOST_CONFIDENCE:g}, such as 0.95 or 95%")
    return confidence


def _budget(text: str) -> float:
    """A time of some s: 60, 60s, 5min or 2h."""
    unit = next((unit for unit in BUDGET_UNITS if text.endswith(unit)), "")
    try:
        seconds = float(text.removesuffix(unit)) * BUDGET_UNITS.get(unit, 1.0)
    except ValueError:
        seconds = math.nan
    if not LEAST_BUDGET <= seconds < math.inf:
        raise BadParameter(f"{text}: expected a time of at least {LEAST_BUDGET:g} s, such as 60s, 5min or 2h")
    return seconds


def _workers(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= MOST_WORKERS:
        raise BadParameter(f"{text}: expected a number from 1 to {MOST_WORKERS}")
    return int(text)


def _store(text: str) -> Path:
    path = Path(text)
    if text.endswith("/") or path.is_dir():
        raise BadParameter(f"{text}: a folder; expected a file, such as {path / 'studies.db'}")
    if not path.parent.is_dir():
        raise BadParameter(f"{text}: there is no folder {path.parent}; expected a file in a folder that exists")
    return path


# -- options


def _option(parse: Callable[[str], Any], metavar: str, what: str, panel: str) -> Any:
    """An option with its fault, a Problem, as its value: so a study tells the faults of all its options at once, and not only the first."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except BadParameter as fault:
            return Problem("", fault.message)

    return Option(parser=parsed, metavar=metavar, help=what, rich_help_panel=panel)


def _choice(words: Any, what: str, panel: str) -> Any:
    """An option for one of the words of a Literal."""
    known = get_args(words)

    def parse(text: str) -> str:
        if text not in known:
            raise BadParameter(f"{text}: expected {', '.join(known[:-1])} or {known[-1]}")
        return text

    return _option(parse, "|".join(known), what, panel)


Goal = Literal["bins_per_hour", "cost_per_bin", "harvest_seconds"]
Horizon = Literal["harvest", "long"]
Model = Literal["fast", "full", "both"]
MODELS = "fast: the discrete-event model; full: the simulator; both: it checks the best two."
SCHEDULER = "A scheduler of dask.distributed: tcp://192.168.1.10:8786."
WITHIN = "Half an interval, as a share of its mean, that is narrow enough."


@dataclass(frozen=True, kw_only=True)
class StudyArguments:
    """The options of a study, in the order of --help."""

    scenario: File = None
    vary: Annotated[
        list[str] | None,
        Option(
            metavar="KEY=VALUES", help="What varies: carriers=1..20, dispatch=nearest,predictive (repeatable).", rich_help_panel=QUESTION
        ),
    ] = None
    goal: Annotated[Goal, _choice(Goal, "What is best. Costs need prices in the scenario.", QUESTION)] = "bins_per_hour"
    horizon: Annotated[Horizon, _choice(Horizon, "One harvest, or the rate of a long run.", QUESTION)] = "harvest"
    confidence: Annotated[float, _option(_confidence, "SHARE", "Confidence of the answer.", QUESTION)] = "0.95"  # type: ignore[assignment]
    within: Annotated[float, _option(_share, "SHARE", WITHIN, QUESTION)] = "1%"  # type: ignore[assignment]  # Typer parses defaults too
    budget: Annotated[float, _option(_budget, "TIME", "Wall time: 60s, 5min, 2h.", QUESTION)] = "60s"  # type: ignore[assignment]
    model: Annotated[Model, _choice(Model, MODELS, RUNS)] = "both"
    workers: Annotated[int | None, _option(_workers, "N", "Processes here. Default: one per core.", RUNS)] = None
    scheduler: Annotated[str | None, _option(_scheduler, "ENDPOINT", SCHEDULER, RUNS)] = None
    out: Annotated[Path | None, _option(_store, "STORE", "File that keeps all runs. Default: studies.db beside the recordings.", RUNS)] = (
        None
    )
    anew: Annotated[bool, Option("--anew", metavar="", help="Forget the runs of a store of another version.", rich_help_panel=RUNS)] = False
    summary: Annotated[Path | None, Option(metavar="FILE.json", help="Write the whole answer to this file.", rich_help_panel=FILES)] = None
    csv: Annotated[Path | None, Option(metavar="FILE.csv", help="Write the table to this file.", rich_help_panel=FILES)] = None
    picture: Annotated[Path | None, Option(metavar="FILE.svg|png", help="Draw the table.", rich_help_panel=FILES)] = None
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Write a report.", rich_help_panel=FILES)] = None
    progress: Style = "text"

    @property
    def files(self) -> list[Path]:
        """The files to write."""
        return [path for path in (self.summary, self.csv, self.picture, self.report) if path is not None]

    def problems(self) -> list[Problem]:
        """Return what is wrong with each option, and with the options together. The values of the options with a problem mean nothing."""
        found = [replace(value, file=named([name])) for name, value in vars(self).items() if isinstance(value, Problem)]
        if self.scheduler and self.workers:
            found.append(Problem("--workers", "the scheduler has its own workers; leave out --workers"))
        if self.picture and self.picture.suffix.lower() not in PICTURES:
            found.append(Problem("--picture", f"{self.picture}: a picture's name ends in {' or '.join(PICTURES)}"))
        if len(set(self.files)) < len(self.files):
            found.append(Problem("--summary", f"{', '.join(map(str, self.files))}: two of these are one file"))
        return found
