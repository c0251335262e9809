"""The runs that have ended: what their summaries say, and how their scenarios differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from orchard.app.charts import Course, course_of
from orchard.app.entries import entries, flat, label_of, words_of
from orchard.app.what_if import moment
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP, Scenario, check
from orchard.folders import regular
from orchard.report.metrics import SAMPLED
from orchard.report.summary import Headline, clock

# Runs in the list.
MOST = 200
# How a run ended before its harvest was done, by the word of its summary.
CUT = "cut short"
ENDS = {"jammed": "jammed", "broken": "all pickers broken", "refused": "order refused"}


class ForkPoint(msgspec.Struct, frozen=True):
    """The run from which a fork goes on, and when, s. Without a run: it is no fork."""

    run: str = ""
    seconds: float = 0.0


class Record(Headline):
    """What the page reads in a summary."""

    mode: str
    finished: bool
    bins_per_hour: float
    picker_waiting_seconds: float
    scenario: dict[str, Any]
    history: dict[str, list[float]]
    ended: str = ""
    forked_from: ForkPoint = ForkPoint()

    def __post_init__(self) -> None:
        """Raise ValueError if the history lacks values."""
        lengths = {len(values) for values in self.history.values()}
        if not self.history.keys() >= set(SAMPLED) or len(lengths) != 1:
            raise ValueError("history: each sample needs all its values")


@dataclass(frozen=True)
class PastRun:
    """A run that has ended."""

    name: str
    ended: datetime
    record: Record
    scenario: Scenario

    @property
    def course(self) -> Course:
        """The figures over time, of a fork from its moment on."""
        return course_of(self.record.history, self.scenario, self.record.forked_from.seconds)

    @property
    def since(self) -> str:
        """From which moment on it is a fork: from 2:30; '' if it is none."""
        fork_point = self.record.forked_from
        if fork_point.run:
            return f"from {moment(fork_point.seconds)}"
        return ""

    @property
    def end(self) -> str:
        """How and when it ended: 'harvest done at 7:02 min', 'cut short at 4:00 min'."""
        record = self.record
        how = "harvest done" if record.finished else ENDS.get(record.ended, CUT)
        return f"{how} at {clock(record.sim_seconds)}"

    def figures_at(self, seconds: float) -> dict[str, str]:
        """Return the figures of its first `seconds`, with their units, by name.

        They are those of the last sample up to then.
        """
        history = self.record.history
        count = sum(at <= seconds for at in history["seconds"])
        sample = {name: values[count - 1] if count else 0.0 for name, values in history.items()}
        # A run that ended at its begin has figures too, those of one tick.
        elapsed = max(seconds, TIME_STEP)
        picker_seconds = elapsed * self.scenario.pickers
        carrier_seconds = elapsed * self.scenario.carrier_count
        bins_per_hour = 3600.0 * sample["bins_delivered"] / elapsed
        waiting = sample["pickers_waited_seconds"] / picker_seconds
        busy = sample["carriers_busy_seconds"] / carrier_seconds
        return {
            "Bins": f"{sample['bins_delivered']:.0f} of {self.record.bins}",
            "Bins per hour": f"{bins_per_hour:.1f}",
            "Pickers wait": f"{100 * waiting:.0f} % of the time",
            "Carriers at work": f"{100 * busy:.0f} %",
        }

    @property
    def figures(self) -> dict[str, str]:
        """The figures with their units, by name, as in the list of runs."""
        record = self.record
        return {
            "Bins": f"{record.bins_delivered} of {record.bins}",
            "Simulated": clock(record.sim_seconds),
            "Bins per hour": f"{record.bins_per_hour:.1f}",
            "Mean wait": f"{record.picker_waiting_seconds:.0f} s",
            "Carriers at work": f"{100 * record.carrier_utilisation:.0f} %",
        }


def past_runs(folder: Path) -> tuple[list[PastRun], list[str]]:
    """Return the newest MOST runs of a folder, newest first, and a sentence for each faulty file.

    A run is a summary, which any program may have written.
    """
    runs: list[PastRun] = []
    faults: list[str] = []
    # The summaries of studies have names of their own.
    for path in sorted(set(folder.glob("*.json")) - set(folder.glob("study-*.json"))):
        try:
            runs.append(_past_run(path))
        except (OSError, ValueError, ScenarioError, OverflowError, RecursionError) as error:
            reason = getattr(error, "strerror", None) or error
            faults.append(f"{path.name} is passed over: {reason}")
    runs.sort(key=lambda past: (past.ended, past.name), reverse=True)
    return runs[:MOST], faults


def _past_run(path: Path) -> PastRun:
    """Return the run of a summary.

    Raises OSError, ValueError, ScenarioError, OverflowError or RecursionError if the file is none.
    """
    record = msgspec.json.decode(regular(path).read_bytes(), type=Record)
    ended = datetime.fromtimestamp(path.stat().st_mtime)
    return PastRun(path.stem, ended, record, check(record.scenario, path.name))


class SideBySide(NamedTuple):
    """Runs side by side. `words`: at which moment they are compared. `figures`: of each run."""

    words: str
    figures: list[dict[str, str]]


def compared(runs: Sequence[PastRun]) -> SideBySide:
    """Return figures of runs at one moment, or of each one at its end if all harvests were done.

    A run that was cut short would lose against a whole one in any figure that grows.
    """
    if len(runs) == 1 or all(past.record.finished for past in runs):
        words = "Each is shown at the end of its harvest."
        if len(runs) == 1:
            words = ""
        return SideBySide(words, [past.figures for past in runs])
    seconds = min(past.record.sim_seconds for past in runs)
    words = f"All are compared at {clock(seconds)}, when the first of them ended."
    return SideBySide(words, [past.figures_at(seconds) for past in runs])


def lineages(runs: Mapping[str, PastRun]) -> list[list[PastRun]]:
    """Return the lineage of each run, from its first ancestor to itself.

    `runs`: by name, in the order of the list. In the result, forks stand after their parent. What
    summaries say of parents may be wrong. A circle of parents ends before a run comes again.
    """
    order = {name: number for number, name in enumerate(runs)}
    result = []
    for past in runs.values():
        lineage = [past]
        parent = runs.get(past.record.forked_from.run)
        while parent is not None and parent not in lineage:
            lineage.insert(0, parent)
            parent = runs.get(parent.record.forked_from.run)
        result.append(lineage)

    def places(lineage: list[PastRun]) -> list[int]:
        """Return the places in the list of a run and of those that it goes on from."""
        return [order[past.name] for past in lineage]

    return sorted(result, key=places)


def differences(scenarios: Sequence[Scenario]) -> dict[str, list[str]]:
    """Return the settings that are not the same in all scenarios.

    Label -> a value in words for each scenario.
    """
    values = [flat(scenario) | scenario.own_classes for scenario in scenarios]
    # In the order of the first scenario that has each.
    paths = dict.fromkeys(chain.from_iterable(values))
    result = {}
    for path in paths:
        words = [_words_in(of_scenario, path) for of_scenario in values]
        if len(set(words)) > 1:
            result[label_of(path)] = words
    return result


def _words_in(values: Mapping[str, Any], path: str) -> str:
    """Return a value of a scenario in words. A class that it does not name is the built-in one."""
    if path in entries():
        return words_of(path, values[path])
    return str(values.get(path, "built-in"))
