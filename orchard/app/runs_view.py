"""The runs that have ended: their summaries, a list, and those that are chosen side by side."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
from nicegui import ui

from orchard.app.charts import Charts, Course, course_of
from orchard.app.command import Files
from orchard.app.draft import entries, flat, title_of, words_of
from orchard.app.elements import button, heading, note, table
from orchard.app.picture import Player
from orchard.app.what_if import GoOn, moment, what_if
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, check
from orchard.folders import regular
from orchard.report.metrics import SAMPLED
from orchard.report.summary import Headline

MOST = 200  # runs in the list


class ForkPoint(msgspec.Struct, frozen=True):
    """The run from which a fork goes on, and when."""

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
    forked_from: ForkPoint = ForkPoint()  # the default: of no fork

    def __post_init__(self) -> None:
        if (
            not self.history.keys() >= set(SAMPLED)
            or len({len(values) for values in self.history.values()}) != 1
        ):
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
        return course_of(self.record.history, self.scenario, self.record.forked_from.seconds)

    @property
    def since(self) -> str:
        """From which moment on it is a fork: from 2:30; '' if it is none."""
        return (
            f"from {moment(self.record.forked_from.seconds)}" if self.record.forked_from.run else ""
        )

    @property
    def figures(self) -> dict[str, str]:
        """The figures with their units, by name, as in the list of runs."""
        known = self.record
        return {
            "Bins": f"{known.bins_delivered} of {known.bins}",
            # Not hours: the list sorts by the first number.
            "Simulated": f"{moment(known.sim_seconds)} min",
            "Bins per hour": f"{known.bins_per_hour:.1f}",
            "Mean wait": f"{known.picker_waiting_seconds:.0f} s",
            "Carriers at work": f"{100 * known.carrier_utilisation:.0f} %",
        }


def past_runs(folder: Path) -> tuple[list[PastRun], list[str]]:
    """Return the newest MOST runs with a summary, newest first, and why other files are passed
    over.
    """
    known, others = [], []
    for path in sorted(set(folder.glob("*.json")) - set(folder.glob("study-*.json"))):
        try:
            record = msgspec.json.decode(regular(path).read_bytes(), type=Record)
            ended = datetime.fromtimestamp(path.stat().st_mtime)
            known.append(PastRun(path.stem, ended, record, check(record.scenario, path.name)))
        except (OSError, ValueError, ScenarioError, OverflowError, RecursionError) as error:
            others.append(
                f"{path.name} is passed over: {getattr(error, 'strerror', None) or error}"
            )
    return sorted(known, key=lambda past: (past.ended, past.name), reverse=True)[:MOST], others


def differences(scenarios: Sequence[Scenario]) -> dict[str, list[str]]:
    """Return the settings that are not the same in all scenarios: label -> a value for each
    scenario.
    """
    values = [flat(scenario) | scenario.own_classes for scenario in scenarios]
    paths = dict.fromkeys(path for one in values for path in one)
    found = {
        path: [
            words_of(path, one[path]) if path in entries() else one.get(path, "built-in")
            for one in values
        ]
        for path in paths
    }
    return {
        entries()[path].label if path in entries() else path: words
        for path, words in found.items()
        if len(set(words)) > 1
    }


COLUMNS = (
    "Ended",
    "Scenario",
    "Mode",
    "Bins",
    "Simulated",
    "Bins per hour",
    "Mean wait",
    "Carriers at work",
)
UNDER_PARENT = "(value, row) => value === row.Ended ? row.under + value : value"
BY_NUMBER = "(a, b) => a.localeCompare(b, 'en', {numeric: true})"  # 10:24 min comes after 9:50 min
CHECKBOX = (
    "<q-checkbox v-model=\"props.selected\" dense :aria-label=\"'Compare ' + props.row.Ended + ', '"
    ' + props.row.Scenario" />'
)
MOST_NAMED = 5  # files that are passed over
PAGE = 8  # runs on a page of the list


class RunsView:
    """The list, and below it the comparison of the runs that are chosen."""

    def __init__(
        self, folder: Path, take: Callable[[Scenario, str], Awaitable[None]], go_on: GoOn
    ) -> None:
        """`folder`: of the runs. `take`: sets the form to a run's scenario, under the run's name.
        `go_on`: as for `what_if`.
        """
        self._folder, self._take, self._go_on = folder, take, go_on
        self._past: dict[str, PastRun] = {}
        column = {"align": "left", "sortable": True, ":sort": BY_NUMBER, ":format": UNDER_PARENT}
        columns = [{"name": name, "label": name, "field": name} | column for name in COLUMNS]
        self._hint = ui.label(
            "Runs that have ended are listed here. Choose two or more to compare them."
        ).classes("hint")
        self._list = ui.table(
            rows=[],
            columns=columns,
            row_key="name",
            selection="multiple",
            pagination=PAGE,
            on_select=self._show_chosen,
        )
        self._list.classes("runs").props(
            "flat dense wrap-cells :rows-per-page-options=[0] data-view=runs"
        )
        self._list.add_slot("header-selection", "Compare")
        self._list.add_slot("body-selection", CHECKBOX)
        self._others = note("data-view=passed-over", "classes")
        with ui.element("div").props("data-view=comparison") as self._comparison:
            self._charts = Charts()
            self._sides = ui.element("div").classes("summary sides")
            self._use = button("Set the form to this scenario", self._use_chosen, "use-scenario")
            self._watch = button("Pictures side by side", self._play, "pictures", "smart_display")
            self._frames = ui.element("div").classes("frames")
        self._comparison.set_visibility(False)
        self._chosen = list[PastRun]()

    def refresh(self, *names: str) -> None:
        """List the runs that there are now, and choose these; without names, those that were
        chosen.
        """
        chosen = names or [row["name"] for row in self._list.selected]
        runs, others = past_runs(self._folder)
        self._past = {past.name: past for past in runs}
        self._list.rows = [_row(line[-1], len(line)) for line in lines(self._past)]
        self._list.set_visibility(bool(self._past))
        more = [f"and {len(others) - MOST_NAMED} more"] if len(others) > MOST_NAMED else []
        self._others.set_text("\n".join([*others[:MOST_NAMED], *more]))
        self._list.selected = [row for row in self._list.rows if row["name"] in chosen]
        self._show_chosen()

    def _show_chosen(self) -> None:
        chosen = [
            self._past[row["name"]] for row in self._list.selected if row["name"] in self._past
        ]
        if chosen == self._chosen:
            return
        self._chosen = chosen
        self._comparison.set_visibility(bool(chosen))
        self._hint.set_visibility(not chosen)
        self._use.set_visibility(len(chosen) == 1)
        self._watch.set_visibility(
            len(chosen) == 2
            and all((self._folder / f"{past.name}.rrd").exists() for past in chosen)
        )
        self._frames.clear()
        marks = [past.record.forked_from.seconds for past in chosen if past.since]
        self._charts.show({_name(past): past.course for past in chosen}, marks)
        self._sides.clear()
        with self._sides:
            if chosen:
                heading(3, title_of(chosen[0].scenario) if len(chosen) == 1 else "Side by side")
                table(_lines(chosen), ["", *map(_name, chosen)])
            if len(chosen) == 1:
                what_if(
                    self._folder / f"{chosen[0].name}.snapshots",
                    chosen[0].scenario,
                    chosen[0].record.history,
                    self._go_on,
                )

    async def _use_chosen(self) -> None:
        await self._take(self._chosen[0].scenario, _name(self._chosen[0]))

    def _play(self) -> None:
        self._frames.clear()
        with self._frames:
            for past in self._chosen:
                Player(past.scenario, Files(self._folder, past.name), f"Picture of {_name(past)}")


def _name(past: PastRun) -> str:
    return f"{past.ended:%d %b %H:%M:%S}{past.since and f', {past.since}'}"


def lines(known: Mapping[str, PastRun]) -> list[list[PastRun]]:
    """Return a line for each run, from its first ancestor to itself, in the order of the list:
    forks stand under their parent.
    """
    found, order = [], {name: number for number, name in enumerate(known)}
    for past in known.values():
        line = [past]
        while (parent := known.get(line[0].record.forked_from.run)) and parent not in line:
            line.insert(0, parent)
        found.append(line)
    return sorted(found, key=lambda line: [order[past.name] for past in line])


def _row(past: PastRun, depth: int) -> dict[str, str]:
    place = {
        "name": past.name,
        "under": "\u2003" * (depth - 1) + (past.since and f"\u21b3 {past.since}, "),
    }
    known = {
        "Ended": f"{past.ended:%Y-%m-%d %H:%M:%S}",
        "Scenario": title_of(past.scenario),
        "Mode": past.record.mode,
    }
    return place | known | past.figures


def _lines(chosen: list[PastRun]) -> list[list[str]]:
    settings = differences([past.scenario for past in chosen])
    modes = [past.record.mode for past in chosen]
    figures = {name: [past.figures[name] for past in chosen] for name in chosen[0].figures}
    return [
        [name, *cells]
        for name, cells in (
            settings | ({"Mode": modes} if len(set(modes)) > 1 else {}) | figures
        ).items()
    ]
