"""The list of runs that have ended, and those that are chosen side by side."""

from collections.abc import Awaitable, Callable
from pathlib import Path

from nicegui import ui

from orchard.app.charts import Charts
from orchard.app.command import Files
from orchard.app.draft import title_of
from orchard.app.elements import button, heading, note, table
from orchard.app.past_runs import PastRun, SideBySide, compared, differences, lineages, past_runs
from orchard.app.picture import Player
from orchard.app.what_if import GoOn, what_if
from orchard.field.scenario import Scenario

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
# JavaScript of the list, which writes a fork under its parent.
UNDER_PARENT = "(value, row) => value === row.Ended ? row.under + value : value"
# JavaScript of the list, by which 10:24 min comes after 9:50 min, and 1:00:00 h after both.
BY_TIME = """(a, b) => {
  const parts = (text) => text.split(" ")[0].split(":");
  const seconds = (text) => parts(text).reduce((sum, part) => 60 * sum + Number(part), 0);
  return seconds(a) - seconds(b);
}"""
# JavaScript of the list, by which 10 s come after 9 s.
BY_NUMBER = "(a, b) => a.localeCompare(b, 'en', {numeric: true})"
# Name of a column -> by what it is sorted, if not by its numbers.
SORTS = {"Simulated": BY_TIME}
CHECKBOX = (
    "<q-checkbox v-model=\"props.selected\" dense :aria-label=\"'Choose ' + props.row.Ended + ', '"
    ' + props.row.Scenario" />'
)
# What a fork's line in the list begins with: a wide space for each ancestor, and an arrow.
INDENT = "\u2003"
ARROW = "\u21b3"
HINT = (
    "Runs that have ended are listed here. Choose one to look at it and to ask “What if?”, two or"
    " more to compare them."
)
# Files that are passed over and named one by one.
MOST_NAMED = 5
# Runs on a page of the list.
PAGE = 8


class RunsView:
    """The list, and below it the comparison of the runs that are chosen."""

    def __init__(
        self, folder: Path, take: Callable[[Scenario, str], Awaitable[None]], go_on: GoOn
    ) -> None:
        """`folder`: of the runs. `take`: sets the form to a run's scenario, under the run's name.
        `go_on`: as for `what_if`.
        """
        self._folder = folder
        self._take = take
        self._go_on = go_on
        self._past: dict[str, PastRun] = {}
        self._chosen = list[PastRun]()
        self._hint = ui.label(HINT).classes("hint")
        self._list = self._build_list()
        self._passed_over = note("data-view=passed-over", "classes")
        with ui.element("div").props("data-view=comparison") as self._comparison:
            self._charts = Charts()
            self._sides = ui.element("div").classes("summary sides")
            self._use = button("Set the form to this scenario", self._use_chosen, "use-scenario")
            self._watch = button("Pictures side by side", self._play, "pictures", "smart_display")
            self._frames = ui.element("div").classes("frames")
        self._comparison.set_visibility(False)

    def _build_list(self) -> ui.table:
        column = {"align": "left", "sortable": True, ":format": UNDER_PARENT}
        columns = []
        for name in COLUMNS:
            sort = {":sort": SORTS.get(name, BY_NUMBER)}
            columns.append({"name": name, "label": name, "field": name} | column | sort)
        runs = ui.table(
            rows=[],
            columns=columns,
            row_key="name",
            selection="multiple",
            pagination=PAGE,
            on_select=self._show_chosen,
        )
        runs.classes("runs").props("flat dense wrap-cells :rows-per-page-options=[0]")
        runs.props("data-view=runs")
        runs.add_slot("header-selection", "Choose")
        runs.add_slot("body-selection", CHECKBOX)
        return runs

    def refresh(self, *names: str) -> None:
        """List the runs that there are now, and choose some of them.

        `names`: of the runs to choose; without any, those that were chosen before.
        """
        chosen_names = names or [row["name"] for row in self._list.selected]
        runs, faults = past_runs(self._folder)
        self._past = {past.name: past for past in runs}
        self._list.rows = [_row(lineage) for lineage in lineages(self._past)]
        self._list.set_visibility(bool(self._past))
        named = faults[:MOST_NAMED]
        if len(faults) > MOST_NAMED:
            named.append(f"and {len(faults) - MOST_NAMED} more")
        self._passed_over.set_text("\n".join(named))
        self._list.selected = [row for row in self._list.rows if row["name"] in chosen_names]
        self._show_chosen()

    def _show_chosen(self) -> None:
        """Show the runs that are chosen, unless they are shown already."""
        names = [row["name"] for row in self._list.selected]
        chosen = [self._past[name] for name in names if name in self._past]
        if chosen == self._chosen:
            return
        self._chosen = chosen
        self._comparison.set_visibility(bool(chosen))
        self._hint.set_visibility(not chosen)
        self._use.set_visibility(len(chosen) == 1)
        self._watch.set_visibility(len(chosen) == 2 and all(map(self._has_recording, chosen)))
        self._frames.clear()
        marks = [past.record.forked_from.seconds for past in chosen if past.since]
        self._charts.show({_name(past): past.course for past in chosen}, marks)
        self._sides.clear()
        with self._sides:
            if chosen:
                heading(3, title_of(chosen[0].scenario) if len(chosen) == 1 else "Side by side")
                comparison = compared(chosen)
                ui.label(comparison.words).classes("study-hint").props("data-view=compared-at")
                table(_lines(chosen, comparison), ["", *map(_name, chosen)])
            if len(chosen) == 1:
                self._add_what_if(chosen[0])

    def _has_recording(self, past: PastRun) -> bool:
        return (self._folder / f"{past.name}.rrd").exists()

    def _add_what_if(self, past: PastRun) -> None:
        """Add the time line of a run, from which a fork can go on."""
        snapshots = self._folder / f"{past.name}.snapshots"
        what_if(snapshots, past.scenario, past.record.history, self._go_on)

    async def _use_chosen(self) -> None:
        """Set the form to the scenario of the run that is chosen."""
        past = self._chosen[0]
        await self._take(past.scenario, _name(past))

    def _play(self) -> None:
        """Show the pictures of the runs that are chosen."""
        self._frames.clear()
        with self._frames:
            for past in self._chosen:
                Player(past.scenario, Files(self._folder, past.name), f"Picture of {_name(past)}")


def _name(past: PastRun) -> str:
    """Return a run as the comparison names it: when it ended, and from when on it is a fork."""
    ended = f"{past.ended:%d %b %H:%M:%S}"
    if past.since:
        return f"{ended}, {past.since}"
    return ended


def _row(lineage: list[PastRun]) -> dict[str, str]:
    """Return the row of the last run of a lineage. `under`: what goes before the first column."""
    past = lineage[-1]
    under = INDENT * (len(lineage) - 1)
    if past.since:
        under += f"{ARROW} {past.since}, "
    return {
        "name": past.name,
        "under": under,
        "Ended": f"{past.ended:%Y-%m-%d %H:%M:%S}",
        "Scenario": title_of(past.scenario),
        "Mode": past.record.mode,
        **past.figures,
    }


def _lines(chosen: list[PastRun], comparison: SideBySide) -> list[list[str]]:
    """Return the table of a comparison: a name, and a cell for each run."""
    cells = differences([past.scenario for past in chosen])
    modes = [past.record.mode for past in chosen]
    if len(set(modes)) > 1:
        cells["Mode"] = modes
    cells["Ended"] = [past.end for past in chosen]
    lines = [[name, *values] for name, values in cells.items()]
    for name in comparison.figures[0]:
        lines.append([name, *(figures[name] for figures in comparison.figures)])
    return lines
