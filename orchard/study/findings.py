"""The findings of a study so far: its comparisons of settings, and its result.

`orchard.study.study` does the runs, and asks this module what they say. Settings are numbered from
0, and `i` is such a number.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import comb
from statistics import fmean

from orchard.study.answer_words import answer
from orchard.study.break_even import KnownSetting, break_even_words, break_evens
from orchard.study.comparing import Comparison, compare
from orchard.study.kept_values import notes_on_kept_values
from orchard.study.notes import StudyNotes, no_room
from orchard.study.orchard_words import orchard_words
from orchard.study.question import Question
from orchard.study.replications import Replications
from orchard.study.result import BreakEven, Check, Row, Standing, StoppedBy, StudyResult
from orchard.study.rows import row_of
from orchard.study.runs import RunFailed, software
from orchard.study.settings import as_lists


@dataclass(kw_only=True)
class Findings:
    """The runs of a study, and what follows from them."""

    question: Question
    runs: Replications
    #: Of the study, s by the clock of the machine.
    begun: float
    #: Setting -> its check by the simulator.
    checks: dict[int, Check] = field(default_factory=dict)
    notes_of_checks: list[str] = field(default_factory=list)
    #: Setting -> what is proven of its shortest harvest, s; None: nothing can be proven.
    proven: dict[int, float | None] = field(default_factory=dict)
    #: Until the study ends, as if its budget had ended it.
    stopped_by: StoppedBy = "budget"

    # -- comparisons

    @property
    def jammed(self) -> list[int]:
        """The settings of which a run jammed, and none failed."""
        failures = self.failures
        numbers = range(len(self.question.settings))
        return [i for i in numbers if self._jams(i) and i not in failures]

    @property
    def alive(self) -> list[int]:
        """The settings of which no run has jammed or failed."""
        failures = self.failures
        numbers = range(len(self.question.settings))
        return [i for i in numbers if not self._jams(i) and i not in failures]

    @property
    def failures(self) -> dict[int, RunFailed]:
        """The settings of which a run failed, each with the error of its first one.

        It goes through all settings, so take it once for all that you ask of it.
        """
        return self.runs.failing(self.question.model)

    @property
    def failures_of_checks(self) -> dict[int, RunFailed]:
        """The settings that failed only in the simulator, which was to check them."""
        if self.question.model == "full":
            return {}
        return self.runs.failing("full")

    def _jams(self, i: int) -> bool:
        return self.runs.has_jammed(i, self.question.model)

    def compared(self) -> list[Comparison]:
        """Return the comparisons of all settings that do not jam, on the seeds that all of them
        have.

        There is one for each combination of circumstances that has a run.
        """
        question = self.question
        with_runs = [i for i in self.alive if self.runs.known(i, question.model)]
        without_chance = []
        counts = []
        groups: dict[tuple[int, ...], list[int]] = {}
        for i in with_runs:
            groups.setdefault(question.circumstances_of(i), []).append(i)
            if question.settings[i].is_random:
                counts.append(len(self.runs.known(i, question.model)))
            else:
                without_chance.append(i)
        count = min(counts, default=1)
        pairs = sum(comb(len(group), 2) for group in groups.values())
        comparisons = []
        for _, group in sorted(groups.items()):
            comparisons.append(self._comparison(group, count, without_chance, pairs))
        return comparisons

    def _comparison(
        self, group: Sequence[int], count: int, without_chance: Sequence[int], pairs: int
    ) -> Comparison:
        """Return the comparison of some settings by their first `count` replications.

        `without_chance`, `pairs`: as of `compare`.
        """
        question = self.question
        samples = {}
        robots = {}
        limits = {}
        for i in group:
            samples[i] = self.runs.sample(i, question.model, count)
            robots[i] = question.robots(i)
            if question.has_limit(i):
                limits[i] = self._limit(i, count)
        return compare(
            samples,
            robots=robots,
            is_max=question.goal == "bins_per_hour",
            confidence=question.options.confidence,
            within=question.options.within,
            without_chance=without_chance,
            limits=limits,
            pairs=pairs,
        )

    def _limit(self, i: int, count: int) -> float:
        """Return the best mean of the goal that a setting can have on the first seeds, without
        traffic.
        """
        records = self.runs.known(i, self.question.model)[:count]
        return fmean(self.runs.limit(i, record) for record in records)

    # -- the result

    def result(self) -> StudyResult:
        """Return the result of the study as it is now."""
        question = self.question
        comparisons = self.compared()
        with_runs = [*self.jammed]
        undecided: list[int] = []
        on_the_edge: list[int] = []
        for comparison in comparisons:
            with_runs += comparison.leads
            undecided += comparison.undecided
            on_the_edge += comparison.on_the_edge
        shown = sorted(with_runs, key=question.place)
        failed = sorted(self.failures, key=question.place)
        accounted_for = {*shown, *failed}
        missing = [i for i in range(len(question.settings)) if i not in accounted_for]
        # With circumstances there is a best setting of each combination, and none of all.
        best = None
        best_values = None
        if comparisons and not question.circumstances:
            best = comparisons[0].best
            best_values = question.settings[best].values
        beyond = {}
        if not missing:
            # Otherwise a setting that has not run may be better than the last one that has.
            beyond = question.beyond([comparison.best for comparison in comparisons])
        result = StudyResult(
            answer="",
            orchard=orchard_words(question.scenario, question.varied),
            best=best_values,
            table=[self._row(i, comparisons) for i in shown],
            goal=question.goal,
            horizon=question.options.horizon,
            confidence=question.options.confidence,
            within=question.options.within,
            scenario=question.scenario.model_dump(),
            varied=as_lists(question.varied),
            wall_seconds=time.time() - self.begun,
            stopped_by=self.stopped_by,
            undecided=question.values_of(undecided),
            seconds_needed=self._seconds_needed(comparisons, missing),
            beyond=beyond,
            notes=self._notes(comparisons, shown, missing, best),
            version=software(),
            violations=self.runs.violations,
            given=question.circumstances,
            not_run=question.values_of(sorted(missing, key=question.place)),
            break_even=self._break_even(comparisons, best),
            failed=question.values_of(failed),
            check_failed=question.values_of(self.failures_of_checks),
            on_the_edge=question.values_of(sorted(on_the_edge, key=question.place)),
        )
        # The answer and the last notes are words about the result itself.
        notes = [*result.notes, *map(break_even_words, result.break_even)]
        return replace(result, answer=answer(result), notes=notes)

    def _row(self, i: int, comparisons: Sequence[Comparison]) -> Row:
        """Return the row of a setting in the table."""
        confidence = self.question.options.confidence
        setting = self.question.settings[i]
        records = self.runs.known(i, self.question.model)
        for comparison in comparisons:
            if i in comparison.leads:
                row = row_of(setting, records[: comparison.count], confidence)
                return self._compared_row(row, i, comparison)
        # It has jammed.
        return row_of(setting, records, confidence)

    def _compared_row(self, row: Row, i: int, comparison: Comparison) -> Row:
        """Return a row with its standing in a comparison, its check and what is proven of it."""
        if not self.question.has_choices:
            standing: Standing = "alone"
        elif i == comparison.best:
            standing = "best"
        else:
            standing = comparison.standing(i)
        behind = None
        if i != comparison.top:
            behind = comparison.ahead[i]
        return replace(
            row,
            standing=standing,
            lead=comparison.interval_shown(i),
            behind=behind,
            check=self.checks.get(i),
            proven_seconds=self.proven.get(i),
        )

    def _seconds_needed(
        self, comparisons: Sequence[Comparison], missing: Sequence[int]
    ) -> float | None:
        """Return about how long it takes to run each missing setting once; or, if none is missing,
        to decide what is undecided, s.

        None: it is not known, or all is decided.
        """
        if missing and not comparisons:
            return None
        if missing:
            return self.runs.seconds_for(missing, self.question.model, 1)
        more = 0
        for comparison in comparisons:
            if not comparison.undecided:
                continue
            replications = comparison.replications_needed()
            if replications is None:
                return None
            more = max(more, replications - comparison.count)
        if not more:
            return None
        return self.runs.seconds_for(self.alive, self.question.model, more)

    def _break_even(self, comparisons: Sequence[Comparison], best: int | None) -> list[BreakEven]:
        """Return what the last robots of the best setting may cost, if there are prices."""
        if best is None or not self.question.settings[best].has_prices:
            return []
        count = comparisons[0].count
        known = {}
        for i in comparisons[0].leads:
            records = self.runs.first_records(i, self.question.model, count)
            known[i] = KnownSetting(self.question.settings[i], records)
        best_setting = known.pop(best)
        return break_evens(best_setting, list(known.values()), self.question.options.confidence)

    def _notes(
        self,
        comparisons: Sequence[Comparison],
        shown: Sequence[int],
        missing: Sequence[int],
        best: int | None,
    ) -> list[str]:
        """Return what a reader must know beside the table.

        `shown`, `missing`: the settings with and without a run. `best`: None if there is none, or
        one for each combination of circumstances.
        """
        question = self.question
        notes = StudyNotes(self.runs, question.model, question.options, question.varied)
        sentences = notes.nothing_random()
        sentences += notes.missing(missing, was_stopped=self.stopped_by == "stopped")
        sentences += question.left_out
        sentences += notes.failed(self.failures)
        sentences += notes.jammed(self.jammed)
        sentences += notes.unequal(shown)
        sentences += notes.faulty([i for i in shown if not self._jams(i)])
        best_settings = [question.settings[comparison.best] for comparison in comparisons]
        best_numbers = [setting.scenario.carrier_count for setting in best_settings]
        if question.is_open and question.most_carriers in best_numbers:
            sentences.append(no_room(question.most_carriers))
        scenario = question.scenario
        if best is not None:
            sentences += notes.row_ends(best)
            scenario = question.settings[best].scenario
        if not question.circumstances:
            sentences += notes.part_full(scenario)
            sentences += notes.rare_truck(scenario)
        sentences += notes.heavier_bins(question.scenario)
        sentences += notes_on_kept_values(question.varied, question.scenario)
        sentences += notes.unchecked(self.failures_of_checks)
        return sentences + self.notes_of_checks + notes.damaged()
