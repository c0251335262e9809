"""The options of `orchard study` and `orchard benchmark`: their types, values and help texts, and
all that is wrong with them at once.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_args
from urllib.parse import urlsplit

from typer import Argument, BadParameter

from orchard.field.problems import Problem
from orchard.field.scenario import ROLLING
from orchard.report.summary import SUMMARY
from orchard.study.deadline import LEAST_DEADLINE, MOST_DAYS, MOST_DEADLINE, Deadline
from orchard.study.kinds_of_files import PICTURE, REPORT, TABLE
from orchard.study.result import Goal, Horizon, Models
from orchard.terminal.files import KindOfFile
from orchard.terminal.options import File, Style, flag, number, option, picture_file, whole
from orchard.terminal.typed import named

LEAST_CONFIDENCE = 0.5
MOST_CONFIDENCE = 0.9999
# Unit of a time -> its seconds.
BUDGET_UNITS = {"min": 60.0, "h": 3600.0, "s": 1.0}
DEADLINE_UNITS = {"min": 60.0, "h": 3600.0}
LEAST_BUDGET = 1.0  # s
MOST_WORKERS = 1000
# Headings of the help text.
QUESTION = "The question"
RUNS = "The runs"
FILES = "What it shows and writes"

# -- parsers: each takes the text that a user has typed, and raises BadParameter if it is wrong


def _share(text: str) -> float:
    if text.endswith("%"):
        share = number(text[:-1]) / 100.0
    else:
        share = number(text)
    if not 0.0 < share < 1.0:
        raise BadParameter(f"{text}: expected a share above 0 and below 1, such as 0.01 or 1%")
    return share


def _scheduler(text: str) -> str:
    address = text
    if "://" not in text:
        address = f"tcp://{text}"
    try:
        url = urlsplit(address)
        is_right = bool(url.scheme and url.hostname and url.port)
    except ValueError:
        is_right = False
    if not is_right:
        raise BadParameter(
            f"{text}: expected an address with its port, such as tcp://192.168.1.10:8786"
        )
    return text


def _confidence(text: str) -> float:
    confidence = _share(text)
    if not LEAST_CONFIDENCE <= confidence <= MOST_CONFIDENCE:
        raise BadParameter(
            f"{text}: expected a share from {LEAST_CONFIDENCE:g} to {MOST_CONFIDENCE:g}, such as"
            " 0.95 or 95%"
        )
    return confidence


def _budget(text: str) -> float:
    unit = _unit_of(text, BUDGET_UNITS)
    seconds = number(text.removesuffix(unit)) * BUDGET_UNITS.get(unit, 1.0)
    if not LEAST_BUDGET <= seconds < math.inf:
        raise BadParameter(
            f"{text}: expected a time of at least {LEAST_BUDGET:g} s, such as 60s, 5min or 2h"
        )
    return seconds


def _within_time(text: str) -> float:
    unit = _unit_of(text, DEADLINE_UNITS)
    seconds = math.nan
    if unit:
        seconds = number(text.removesuffix(unit)) * DEADLINE_UNITS[unit]
    if not LEAST_DEADLINE <= seconds <= MOST_DEADLINE:
        raise BadParameter(f"{text}: expected 1min to 10000h of work, such as 8h or 90min")
    return seconds


def _unit_of(text: str, units: Iterable[str]) -> str:
    """Return the unit with which a text ends, the first one of several; '' if there is none."""
    for unit in units:
        if text.endswith(unit):
            return unit
    return ""


def _by_day(text: str) -> int:
    wanted = f"expected days from 1d to {MOST_DAYS}d, such as 2d"
    if not text.endswith("d"):
        raise BadParameter(f"{text}: {wanted}")
    return whole(text.removesuffix("d"), MOST_DAYS, wanted)


def _workers(text: str) -> int:
    return whole(text, MOST_WORKERS, f"expected a number from 1 to {MOST_WORKERS}")


def _store(text: str) -> Path:
    path = Path(text)
    if text.endswith("/") or path.is_dir():
        raise BadParameter(f"{text}: a folder; expected a file, such as {path / 'studies.db'}")
    if not path.parent.is_dir():
        raise BadParameter(
            f"{text}: there is no folder {path.parent}; expected a file in a folder that exists"
        )
    return path


# -- options


def _checked(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a parser that returns a Problem where `parse` raises BadParameter.

    So a study can report what is wrong with all its options at once (`StudyArguments.problems`).
    """

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except BadParameter as fault:
            return Problem("", fault.message)

    return parsed


def _choice(panel: str, help_text: str, words: Any, default: str | None) -> Any:
    """Return an option whose value is one of some words. `words`: a Literal of them."""
    known = get_args(words)

    def parse(text: str) -> str:
        if text not in known:
            raise BadParameter(f"{text}: expected {', '.join(known[:-1])} or {known[-1]}")
        return text

    return option(panel, help_text, "|".join(known), default=default, parser=_checked(parse))


MODELS = (
    "Of one harvest: fast: the discrete-event model; full: the simulator; both: it checks the best"
    " two. A long run is fast."
)
VARY = (
    "What varies: carriers=1..20, dispatch=nearest,predictive (repeatable). Default: carriers, as"
    " many as it takes."
)
GOALS = "What is best. Default: the least cost if the scenario has prices, else the most bins."
HORIZONS = (
    "The long run, or one harvest with its beginning and its end. Default: long; harvest with a"
    " deadline."
)
WITHIN_TIME = "The cheapest fleet that is done in time: 8h of work, 90min."
BY_DAY = "The same by the end of a day of the shift: 2d."
SENSITIVITY = (
    "What the result hangs on: each value is moved by a share, or as --vary KEY=LOW..HIGH says."
)
KEPT = "File that keeps all runs. Default: studies.db beside the recordings."
SCHEDULER = "A scheduler of dask.distributed: tcp://192.168.1.10:8786."
WITHIN = "A difference below this share is worth nothing."


@dataclass(frozen=True, kw_only=True)
class StudyArguments:
    """The options of a study, in the order of --help.

    A value that is wrong is a Problem in place of a value: see `problems`. Defaults are given as
    texts, because Typer parses them too.
    """

    scenario: File = None
    vary: list[str] | None = option(QUESTION, VARY, "KEY=VALUES")
    goal: Goal | None = _choice(QUESTION, GOALS, Goal, None)
    horizon: Horizon | None = _choice(QUESTION, HORIZONS, Horizon, None)
    finish_within: float | None = option(
        QUESTION, WITHIN_TIME, "TIME", parser=_checked(_within_time)
    )
    finish_by: int | None = option(QUESTION, BY_DAY, "DAYS", parser=_checked(_by_day))
    sensitivity: bool = flag(QUESTION, "--sensitivity", SENSITIVITY)
    confidence: float = option(
        QUESTION, "Confidence of the answer.", "SHARE", default="0.95", parser=_checked(_confidence)
    )
    within: float = option(QUESTION, WITHIN, "SHARE", default="2%", parser=_checked(_share))
    budget: float = option(
        QUESTION, "Wall time: 60s, 5min, 2h.", "TIME", default="5min", parser=_checked(_budget)
    )
    model: Models = _choice(RUNS, MODELS, Models, "both")
    workers: int | None = option(
        RUNS, "Processes here. Default: one per core.", "N", parser=_checked(_workers)
    )
    scheduler: str | None = option(RUNS, SCHEDULER, "ENDPOINT", parser=_checked(_scheduler))
    out: Path | None = option(RUNS, KEPT, "STORE", parser=_checked(_store))
    anew: bool = flag(RUNS, "--anew", "Forget the runs of a store of another version.")
    summary: Path | None = option(FILES, "Write the whole answer to this file.", "FILE.json")
    csv: Path | None = option(FILES, "Write the table to this file.", "FILE.csv")
    picture: Path | None = option(
        FILES, "Draw the table.", "FILE.svg|png", parser=_checked(picture_file)
    )
    report: Path | None = option(FILES, "Write a report.", "FILE.html")
    progress: Style = "text"

    @property
    def deadline(self) -> Deadline | None:
        """The deadline; None if there is none, or it is wrong."""
        if isinstance(self.finish_within, float):
            return Deadline(within_seconds=self.finish_within)
        if isinstance(self.finish_by, int):
            return Deadline(days=self.finish_by)
        return None

    @property
    def files(self) -> list[tuple[Path, KindOfFile]]:
        """The files to write, and what is written there."""
        kinds = (
            (self.summary, SUMMARY),
            (self.csv, TABLE),
            (self.picture, PICTURE),
            (self.report, REPORT),
        )
        return [(path, kind) for path, kind in kinds if isinstance(path, Path)]

    def problems(self) -> list[Problem]:
        """Return what is wrong with each option by itself, and with some of them together."""
        problems = []
        for name, value in vars(self).items():
            if isinstance(value, Problem):
                problems.append(replace(value, file=named([name])))
        if self.finish_within is not None and self.finish_by is not None:
            text = "one deadline is enough; leave out the other one"
            problems.append(Problem("--finish-by", text))
        has_deadline = self.finish_within is not None or self.finish_by is not None
        if has_deadline and self.horizon == "long":
            text = "a deadline is that of one harvest; leave out --horizon"
            problems.append(Problem("--horizon long", text))
        if self.scheduler and self.workers:
            text = "the scheduler has its own workers; leave out --workers"
            problems.append(Problem("--workers", text))
        return problems


Policy = Annotated[
    str, Argument(metavar="POLICY", help="A policy of your own, module.Class, or a built-in one.")
]


SPLIT = "Only the orchards for learning, or those for the test. Default: both."
SECRET = "Draw a hidden split by the secret in this file, and use that."
BESIDE = "Show the policy of this submission beside the others, with paired differences."
VERIFY = "Replay the decisions of a submission, in place of a benchmark."


def _split(text: str) -> str:
    if text not in ("train", "test"):
        raise BadParameter(f"{text}: expected train or test")
    return text


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions:
    """The options of `benchmark`."""

    policy: Policy = ROLLING
    orchard: list[str] | None = option(QUESTION, "Only this orchard (repeatable).", "NAME")
    check: bool = flag(
        RUNS,
        "--check",
        "Do the harvests of POLICY by the simulator too, which takes long, and show the"
        " difference.",
    )
    workers: int | None = option(RUNS, "Processes. Default: one per core.", "N", parser=_workers)
    out: Path | None = option(RUNS, KEPT, "STORE", parser=_store)
    anew: bool = flag(RUNS, "--anew", "Forget the runs of a store of another version.")
    split: str | None = option(QUESTION, SPLIT, "train|test", parser=_split)
    secret: Path | None = option(QUESTION, SECRET, "FILE")
    verify: Path | None = option(QUESTION, VERIFY, "FILE.json")
    beside: Path | None = option(QUESTION, BESIDE, "FILE.json")
    summary: Path | None = option(FILES, "Write all figures to this file.", "FILE.json")
    submission: Path | None = option(
        FILES, "Write the scores with all decisions to this file.", "FILE.json"
    )
