"""The runs that have ended: what the page reads in the summaries in the folder of runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from orchard.app.course import Course, course_of
from orchard.app.draft import entries, flat, words_of
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, check
from orchard.folders import regular
from orchard.report.history import NAMES
from orchard.report.progress import Headline

MOST = 200  # runs in the list


class Record(Headline):
    """What the page reads in a summary."""

    mode: str
    finished: bool
    bins_per_hour: float
    picker_waiting_seconds: float
    scenario: dict[str, Any]
    history: dict[str, list[float]]

    def __post_init__(self) -> None:
        if not self.history.keys() >= set(NAMES) or len({len(values) for values in self.history.values()}) != 1:
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
        return course_of(self.record.history, self.scenario)

    @property
    def figures(self) -> dict[str, str]:
        """The figures with their units, by name, as in the list of runs."""
        known = self.record
        minutes, seconds = divmod(round(known.sim_seconds), 60)  # not hours: the list sorts by the first number
        return {
            "Bins": f"{known.bins_delivered} of {known.rows}",
            "Simulated": f"{minutes}:{seconds:02d} min",
            "Bins per hour": f"{known.bins_per_hour:.1f}",
            "Mean wait": f"{known.picker_waiting_seconds:.0f} s",
            "Carriers at work": f"{100 * known.carrier_utilisation:.0f} %",
        }


def past_runs(folder: Path) -> tuple[list[PastRun], list[str]]:
    """Return the newest MOST runs with a summary in a folder, newest first, and why each other file of JSON is passed over.

    The results of the page's studies are not meant.
    """
    known, others = [], []
    for path in sorted(set(folder.glob("*.json")) - set(folder.glob("study-*.json"))):
        try:
            known.append(_past_run(path))
        except (OSError, ValueError, ScenarioError, OverflowError, RecursionError) as error:
            others.append(f"{path.name} is passed over: {getattr(error, 'strerror', None) or error}")
    return sorted(known, key=lambda past: (past.ended, past.name), reverse=True)[:MOST], others


def _past_run(path: Path) -> PastRun:
    record = msgspec.json.decode(regular(path).read_bytes(), type=Record)
    return PastRun(path.stem, datetime.fromtimestamp(path.stat().st_mtime), record, check(record.scenario, path.name))


def differences(scenarios: Sequence[Scenario]) -> dict[str, list[str]]:
    """Return the settings that are not the same in all scenarios: label -> a value for each scenario."""
    values = [flat(scenario) | scenario.own_classes for scenario in scenarios]
    paths = dict.fromkeys(path for one in values for path in one)
    found = {path: [words_of(path, one[path]) if path in entries() else one.get(path, "built-in") for one in values] for path in paths}
    return {entries()[path].label if path in entries() else path: words for path, words in found.items() if len(set(words)) > 1}
