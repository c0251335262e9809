"""A study: which of many settings of a scenario is best, by how much, and with what confidence.

This module does the runs. `orchard.study.question` has what is asked, and `orchard.study.findings`
what the runs say. Settings are numbered from 0, and `i` is such a number. After each look, a number
of replications of all settings, the study ends if the answer is certain.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from orchard.discrete.harvest import get_ready
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.bounds import proven_seconds
from orchard.study.checking import checked_settings, refused_and_left_out
from orchard.study.comparing import LOOKS, Comparison, interval
from orchard.study.findings import Findings
from orchard.study.notes import notes_on_left_out
from orchard.study.options import StudyOptions
from orchard.study.question import Question
from orchard.study.replications import Replications, confirmed, go_on
from orchard.study.result import StoppedBy, StudyResult
from orchard.study.settings import ALL_IT_TAKES, is_open, numbered
from orchard.study.store import Store
from orchard.study.workers import Workers, processes, scheduled

# s between two partial results.
REPORT_SECONDS = 0.5
# The share of the budget that the fast model may use if the full one is to check its answer.
FAST_SHARE = 0.5


def study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]] = ALL_IT_TAKES,
    options: StudyOptions = StudyOptions(),
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Compare all settings of a scenario, and return the answer.

    `varied`: dotted path of the scenario -> its values; each combination is a setting. If
    `carriers` has no values the study tries as many as it takes. `tell` gets the result so far,
    again and again. When `is_stopped` returns True, the study returns its result so far. The same
    study gives the same table, whatever the workers do and the store has already; only how much the
    budget allows depends on the machine.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError, RunFailed or
    StoreFailed if runs cannot be done or kept.
    """
    settings, problems = checked_settings(scenario, varied, options)
    refused, left_out = refused_and_left_out(settings, problems)
    if refused:
        raise ScenarioError(refused)
    if options.model != "full":
        get_ready([scenario])
    all_values = numbered(scenario, varied)
    question = Question(
        scenario=scenario,
        varied=all_values,
        settings=settings,
        options=options,
        is_open=is_open(varied),
        left_out=notes_on_left_out(settings, all_values, left_out),
    )
    if options.scheduler:
        started = scheduled(options.scheduler)
    else:
        started = processes(options.workers)
    with Store(options.store_file, options.anew) as store, started as workers:
        return _Study(question, store, workers, tell, is_stopped).run()


class _Study:
    """A study that runs: replications of all settings, look by look; then checks and proofs."""

    def __init__(
        self,
        question: Question,
        store: Store,
        workers: Workers,
        tell: Callable[[StudyResult], None],
        is_stopped: Callable[[], bool],
    ) -> None:
        """`tell`, `is_stopped`: as of `study`."""
        self.question = question
        self.options = question.options
        self.tell = tell
        # s by the clock of the machine.
        self.begun = time.time()
        self.reported_at = 0.0
        # The replications see settings that an open study adds: it is the same list.
        self.runs = Replications(
            question.settings,
            question.goal,
            self.options.horizon,
            store,
            workers,
            heard=self._report,
            is_stopped=is_stopped,
            failed=go_on,
        )
        self.findings = Findings(question=question, runs=self.runs, begun=self.begun)

    def run(self) -> StudyResult:
        """Do all that the budget allows, and return the answer."""
        fast_share = 1.0
        if self.options.confirms:
            fast_share = FAST_SHARE
        self.findings.stopped_by = self._replicate_until(self._end_of(fast_share))
        comparisons = self.findings.compared()
        if self.options.confirms and comparisons and not self.runs.is_stopped():
            self._confirm(comparisons)
        if self.options.horizon == "harvest":
            for comparison in comparisons:
                for i in (comparison.best, *comparison.leads):
                    self._prove(i)
        return self.findings.result()

    def _end_of(self, share: float) -> float:
        """Return when a share of the budget is used up, s by the clock of the machine."""
        return self.begun + share * self.options.budget_seconds

    def _report(self) -> None:
        """Tell the result so far, now that a run is over, but not more often than it is of use."""
        if time.time() - self.reported_at > REPORT_SECONDS:
            self.tell(self.findings.result())
            self.reported_at = time.time()

    # -- replications

    def _replicate_until(self, until: float) -> StoppedBy:
        """Do replications of all settings, and return why no more are done.

        The first look is one replication. It shows which settings jam, and whether other numbers of
        carriers must be tried, before more runs are spent on them.
        """
        for look in (1, *LOOKS):
            if not self._replicate(look, until):
                return self._why_cut()
            if all(map(self._is_certain, self.findings.compared())):
                return "certain"
        return "seeds"

    def _why_cut(self) -> StoppedBy:
        """Return why not all replications are done."""
        if self.runs.is_stopped():
            return "stopped"
        return "budget"

    def _replicate(self, count: int, until: float) -> bool:
        """Do `count` replications of all settings that do not jam. Return whether all are done.

        In an open study the answer may then need more numbers of carriers, which are done too.
        """
        question = self.question
        while True:
            alive = set(self.findings.alive)
            in_order = [i for i in question.in_order_of_runs() if i in alive]
            is_whole = self.runs.do(in_order, question.model, count, until)
            self.runs.raise_if_all_failed(question.model)
            if not is_whole:
                return False
            if not question.is_open:
                return True
            best = [comparison.best for comparison in self.findings.compared()]
            if not question.add_numbers(best):
                return True

    def _is_certain(self, comparison: Comparison) -> bool:
        """Whether no more runs are needed for a comparison."""
        return not comparison.undecided and not self._is_wide(comparison)

    def _is_wide(self, comparison: Comparison) -> bool:
        """Whether the best setting needs more runs, so that its figure is known well enough.

        A random setting needs the runs of the first look. If no setting is beside it, its interval
        must be narrow.
        """
        best = comparison.best
        if not self.question.settings[best].is_random:
            return False
        if comparison.count < LOOKS[0]:
            return True
        if len(comparison.leads) > 1:
            return False
        sample = self.runs.sample(best, self.question.model, comparison.count)
        figure = interval(sample, self.options.confidence)
        half_width = figure.high - figure.mean
        # An interval without a width says nothing of the spread: all values were equal by chance.
        return not 0.0 < half_width <= self.options.within * figure.mean

    # -- checks and proofs

    def _confirm(self, comparisons: Sequence[Comparison]) -> None:
        """Have the full model do the best setting of each comparison.

        If there is only one comparison, it does the setting next to the best one too.
        """
        best = [comparison.best for comparison in comparisons]
        if len(best) == 1:
            best += comparisons[0].runner_up
        self.findings.checks, self.findings.notes_of_checks = confirmed(
            self.runs, best, self.options.confidence, self._end_of(1.0)
        )

    def _prove(self, i: int) -> None:
        """Prove how short the harvest of a setting could be, if there is time.

        That of the first setting is proven even if the budget is used up. Where the seed draws how
        fast rows or pickers are, nothing is proven, because each seed has another orchard.
        """
        has_time = not self.findings.proven or time.time() < self._end_of(1.0)
        scenario = self.question.settings[i].scenario
        if has_time and not self.runs.is_stopped() and not scenario.work_is_drawn:
            self.findings.proven[i] = proven_seconds(lay_out(scenario))
