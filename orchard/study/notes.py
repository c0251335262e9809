"""The notes of a study: what a reader must know beside the table, a sentence each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from orchard.field.layout import Layout, lay_out
from orchard.field.problems import Problem
from orchard.field.scenario import Scenario
from orchard.report.late_absences import notes_on_absences
from orchard.report.limits import full_bins, limit_of_question
from orchard.report.rare_truck import notes_on_truck
from orchard.study.options import StudyOptions
from orchard.study.replications import Replications
from orchard.study.result import Model
from orchard.study.runs import RunFailed, RunRecord
from orchard.study.settings import Setting, impossible_settings
from orchard.study.words import counted

# Keys on which it depends how much each picker has to pick.
SHARES = frozenset({"rows", "pickers", "rows_to_pickers"})
# How many settings a note names.
MOST_NAMED = 5


@dataclass(frozen=True)
class StudyNotes:
    """Writes the notes of a study. Settings are numbers from 0, as in its replications."""

    runs: Replications
    model: Model
    options: StudyOptions
    varied: Mapping[str, Sequence[Any]]

    # -- what the table lacks

    def nothing_random(self) -> list[str]:
        """Return that one run of each setting is enough, if no setting has chance in it."""
        if any(setting.is_random for setting in self.runs.settings):
            return []
        return ["nothing in these settings is random, so one run of each stands for all seeds"]

    def missing(self, settings: Sequence[int], was_stopped: bool) -> list[str]:
        """Return which settings have no run, and why. `was_stopped`: whether by the user."""
        if not settings:
            return []
        why = "there was no time for"
        if was_stopped:
            why = "the study was stopped before"
        count = counted("settings", len(settings))
        names = _names([self.runs.settings[i] for i in settings])
        return [f"{why} a run of {count}, {names}: not in the table"]

    def failed(self, failures: Mapping[int, RunFailed]) -> list[str]:
        """Return why each of these settings is left out: an own class raised an error, or ended
        its worker.
        """
        return self._with_errors("failed, and is not in the table", failures)

    def unchecked(self, failures: Mapping[int, RunFailed]) -> list[str]:
        """Return why the simulator could not check each of these settings: an own class failed."""
        return self._with_errors("failed in the simulator, and is not checked", failures)

    def _with_errors(self, words: str, failures: Mapping[int, RunFailed]) -> list[str]:
        """Return for each of these settings what became of it, and its error."""
        notes = []
        for i, failure in failures.items():
            notes.append(f"{self._words(i)} {words}: {failure}")
        return notes

    def jammed(self, settings: Sequence[int]) -> list[str]:
        """Return why each of these settings jams: a fault of an own class, or waiting robots."""
        notes = []
        for i in settings:
            why = "some robots wait for ever"
            with_faults = _with_faults(self.runs.known(i, self.model))
            if with_faults:
                why = with_faults[0].first_fault
            notes.append(f"{self._words(i)} jams: {why}")
        return notes

    def faulty(self, settings: Sequence[int]) -> list[str]:
        """Return the first fault of each setting in which a class of the user's own failed.

        The figures of such a setting are not those of the class as it was meant.
        """
        notes = []
        for i in settings:
            records = [*self.runs.known(i, "fast"), *self.runs.known(i, "full")]
            with_faults = _with_faults(records)
            if with_faults:
                first = with_faults[0]
                notes.append(
                    f"{self._words(i)}: {len(with_faults)} of {len(records)} runs had faults;"
                    f" seed {first.seed}: {first.first_fault}"
                )
        return notes

    def damaged(self) -> list[str]:
        """Return how many runs in the store could not be used."""
        store = self.runs.store
        if not store.damaged:
            return []
        first = next(iter(store.damaged.values()))
        return [
            f"{store.path}: {len(store.damaged)} of the runs in it were damaged, as by {first}:"
            " they are done again"
        ]

    # -- what the figures do not say

    def unequal(self, settings: Sequence[int]) -> list[str]:
        """Return a note if shares of rows vary, and are unequal in a setting, but the study is
        about the long run.

        There each picker has rows for ever, so unequal shares cost nothing.
        """
        is_seen = self.options.horizon == "harvest" or SHARES.isdisjoint(self.varied)
        if is_seen:
            return []
        within = self.options.within
        for i in settings:
            if _has_unequal_shares(lay_out(self.runs.settings[i].scenario), within):
                return [
                    "some pickers get more rows than others, and only one harvest waits for the"
                    " last one: --horizon harvest"
                ]
        return []

    def row_ends(self, best: int) -> list[str]:
        """Return what the drives to the ends of rows cost with the best setting."""
        scenario = self.runs.settings[best].scenario
        if scenario.bin_metres is None:
            return []
        share = limit_of_question(scenario).row_end_share
        return [
            f"drives to the ends of rows take {100 * share:.1f} % of a picker's time: exchanging"
            " bins inside rows could gain no more"
        ]

    def part_full(self, scenario: Scenario) -> list[str]:
        """Return a note if the bins of one harvest have less fruit than as many full bins."""
        if self.options.horizon == "long" or scenario.bin_metres is None:
            return []
        layout = lay_out(scenario)
        fruit = full_bins(layout)
        if layout.bins <= (1.0 + self.options.within) * fruit:
            return []
        more = 100.0 * (layout.bins / fruit - 1.0)
        return [
            f"each picker's last bin may be part full: {layout.bins} bins have the fruit of"
            f" {fruit:.1f}, so a full one costs {more:.1f} % more; bins an hour are full ones"
        ]

    def rare_truck(self, scenario: Scenario) -> list[str]:
        """Return a note if a harvest is over before the truck comes, or a picker leaves."""
        if self.options.horizon == "long":
            return []
        layout = lay_out(scenario)
        return [*notes_on_truck(layout), *notes_on_absences(layout)]

    def heavier_bins(self, scenario: Scenario) -> list[str]:
        """Return a note if the weight of a bin varies, and people's rate counts bins: then people
        pick more fruit where bins are heavier, which is not meant.
        """
        key = "crop.kilograms_per_bin"
        is_of_bins = scenario.picking_rate is not None and "picking_rate" not in self.varied
        if key not in self.varied or not is_of_bins:
            return []
        return [
            f"picking_rate counts bins, so people pick more fruit an hour where {key} is more;"
            f" `picking_speed: {scenario.mean_picking_speed:.4g}` in its place keeps their fruit"
        ]

    def _words(self, i: int) -> str:
        return self.runs.settings[i].words or "the scenario"


def _with_faults(records: Sequence[RunRecord]) -> list[RunRecord]:
    """Return the runs in which an own class failed."""
    return [record for record in records if record.faults]


def notes_on_left_out(
    settings: Sequence[Setting], varied: Mapping[str, Sequence[Any]], faults: Sequence[Problem]
) -> list[str]:
    """Return which combinations of values are no settings, and then why, a sentence for each fault.

    `faults`: of values that cannot be together. `settings`, `varied`: when the study begins.
    """
    if not faults:
        return []
    left_out = impossible_settings(settings, varied)
    count = counted("settings", len(left_out))
    notes = [f"impossible, and not in the table: {count}, {_names(left_out)}"]
    notes += map(str, faults[:MOST_NAMED])
    if len(faults) > MOST_NAMED:
        notes.append(f"and {len(faults) - MOST_NAMED} more reasons")
    return notes


def _names(settings: Sequence[Setting]) -> str:
    """Return the first settings in words, and that there are more."""
    names = "; ".join(setting.words for setting in settings[:MOST_NAMED])
    if len(settings) > MOST_NAMED:
        names += " and others"
    return names


def no_room(most: int) -> str:
    """Return a note for an answer with as many carriers as the orchard has room for: `most`.

    More might be better.
    """
    return f"the orchard has room for {counted('carriers', most)}, no more"


def _has_unequal_shares(layout: Layout, within: float) -> bool:
    """Whether a picker has more metres to pick than the mean, by at least the share `within`."""
    metres = []
    for block in layout.blocks.values():
        metres.append(sum(layout.lane(row).length for row in block.rows))
    return max(metres) * len(metres) > (1.0 + within) * sum(metres)
