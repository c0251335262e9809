"""A study whose budget ends early: what it has run by then, what it answers, and what it says is
missing.

`FewRuns` are workers that stop after so many runs, so no clock decides.
"""

import math
import re
from dataclasses import replace

import pytest
from few_runs import FewRuns
from small_studies import AMPLE, CHANCE, QUIET
from stage import empty_orchard

from orchard.field.scenario import Scenario, with_changes
from orchard.study import study as module
from orchard.study.comparing import LOOKS
from orchard.study.options import StudyOptions
from orchard.study.result import StudyResult
from orchard.study.study import study


def test_a_used_budget_is_told(tmp_path):
    short = study(
        CHANCE,
        {"carriers": [1, 2, 3]},
        replace(AMPLE, budget_seconds=1e-3, store=tmp_path / "s.db"),
    )
    assert short.stopped_by == "budget" and short.best is None and short.table == []
    assert any("there was no time for a run of 3 settings" in note for note in short.notes)


def short(
    monkeypatch: pytest.MonkeyPatch, runs: int, scenario: Scenario, varied: dict, **options: object
) -> tuple[StudyResult, FewRuns]:
    """Do a study whose budget ends after so many runs. Return its result, and its workers."""
    workers = FewRuns(runs)
    monkeypatch.setattr(module, "processes", lambda count: workers)
    return study(scenario, varied, replace(AMPLE, **options)), workers


# Six people pick, whose times are drawn, so settings need several runs.
GANG = Scenario(
    rows=8,
    pickers=6,
    row_length=40.0,
    picking_rate=20.0,
    bins_per_row=3,
    picking={"spread": {"distribution": "lognormal", "cv": 0.28}},
    **QUIET,
)


FLEETS = [1, 2, 3, 4, 6]


def test_a_setting_that_is_alone_runs_until_its_rate_is_known(monkeypatch, tmp_path):
    """After the runs of the first look the interval is wider than what counts: more are done."""
    runs = LOOKS[0] + 3
    told, _ = short(
        monkeypatch, runs, GANG, {"carriers": [3]}, within=1e-6, store=tmp_path / "s.db"
    )
    assert (told.stopped_by, told.table[0].replications) == ("budget", runs)


@pytest.mark.parametrize(("runs", "tried"), [(1, [1]), (2, [1, 6]), (3, [1, 3, 6])])
def test_a_budget_that_ends_early_has_seen_the_whole_range(runs, tried, monkeypatch, tmp_path):
    """It says what has not run, and nothing of what lies beyond the range."""
    cut, _ = short(
        monkeypatch,
        runs,
        GANG,
        {"carriers": FLEETS},
        horizon="long",
        store=tmp_path / "s.db",
    )
    assert [row.setting["carriers"] for row in cut.table] == tried
    missing = [number for number in FLEETS if number not in tried]
    best = cut.best["carriers"]
    assert cut.not_run == [{"carriers": number} for number in missing]
    assert cut.answer.startswith("So far ")
    nearest = min(missing, key=lambda number: abs(FLEETS.index(number) - FLEETS.index(best)))
    assert f"; {len(missing)} of 5 settings have not run, such as {nearest} carriers" in cut.answer
    assert not re.search("at (least|most)|range is too small|gain", cut.answer, re.IGNORECASE)
    assert cut.beyond == {} and cut.seconds_needed > 0.0


def test_a_budget_that_ends_early_names_what_is_unseen(monkeypatch, tmp_path):
    """Of 12 settings of pickers and carriers the four corners are known, and the answer names one
    next to the best of them.
    """
    prices = {"picker_per_hour": 28.0, "carrier_per_hour": 12.0, "overhead_per_hour": 35.0}
    cut, workers = short(
        monkeypatch,
        4,
        with_changes(GANG, prices=prices),
        {"pickers": [2, 4, 6, 8], "carriers": [1, 2, 3]},
        horizon="long",
        store=tmp_path / "s.db",
    )
    corners = [(2, 1), (2, 3), (8, 1), (8, 3)]
    assert [(run.scenario.pickers, run.scenario.carriers) for run in workers.done] == corners
    pickers = cut.best["pickers"]
    named = f"such as ({pickers} pickers, 2 carriers), and may be better"
    assert f"; 8 of 12 settings have not run, {named}" in cut.answer


def test_every_setting_has_a_run_before_one_has_two(monkeypatch, tmp_path):
    _, workers = short(
        monkeypatch, 7, GANG, {"carriers": FLEETS}, horizon="long", store=tmp_path / "s.db"
    )
    runs = [(run.scenario.seed, run.scenario.carriers) for run in workers.done]
    # Limits alone tell the best here, but one run is no answer.
    assert runs == [(1, 1), (1, 6), (1, 3), (1, 2), (1, 4), (2, 1), (2, 6)]


def test_one_run_tells_that_a_lower_limit_is_worse(monkeypatch, tmp_path):
    """The limit of one carrier is more than 2 % behind the run of six. No run exceeds its limit, so
    one run is enough to call it worse. How far behind it is, is shown.
    """
    cut, _ = short(
        monkeypatch, 2, GANG, {"carriers": [1, 6]}, horizon="long", store=tmp_path / "s.db"
    )
    one, six = cut.table
    assert one.bound_bins_per_hour < 0.98 * six.bins_per_hour.mean
    assert (one.standing, one.lead, six.standing, six.behind) == ("worse", None, "best", None)
    assert one.behind == pytest.approx(six.bins_per_hour.mean / one.bins_per_hour.mean - 1.0)
    assert cut.undecided == [] and "not enough runs" not in cut.answer


@pytest.mark.parametrize("varied", [{"carriers": [1, 2]}, {"pickers": [2, 3], "carriers": [1, 2]}])
def test_a_best_setting_at_the_end_of_a_range_is_at_least_that(varied, monkeypatch, tmp_path):
    """The answer says "at least", although one run of each setting does not decide."""
    told, _ = short(
        monkeypatch,
        math.prod(map(len, varied.values())),
        GANG,
        varied,
        horizon="long",
        store=tmp_path / "s.db",
    )
    assert told.best == {key: values[-1] for key, values in varied.items()}
    assert told.beyond == {key: values[-1] + 1 for key, values in varied.items()}
    words = ["at least 3 pickers", "at least 2 carriers"][-len(varied) :]
    assert told.answer.startswith(f"{', '.join(words).capitalize()}: ")


def test_a_budget_for_one_run_says_how_little_it_knows(tmp_path, monkeypatch):
    """Without a look at which more seeds are run, each setting has one run."""
    monkeypatch.setattr(module, "LOOKS", ())
    one = study(CHANCE, {"carriers": [1, 2, 3]}, replace(AMPLE, store=tmp_path / "s.db"))
    assert {row.replications for row in one.table} == {1}
    assert next(row.standing for row in one.table if row.setting != one.best) != "equal"
    assert "not enough runs to tell" in one.answer and one.seconds_needed > 0.0


@pytest.fixture
def slow_runs(monkeypatch):
    """Return workers each of whose runs takes 30 s, of a clock that stands still otherwise."""
    now = [1000.0]
    monkeypatch.setattr("orchard.study.replications.time.time", lambda: now[0])

    class SlowRuns(FewRuns):
        def do(self, work, items, goes_on):
            for item, record in super().do(work, items, goes_on):
                now[0] += 30.0
                yield item, record

    return SlowRuns


def test_the_estimate_knows_how_long_runs_took(tmp_path, monkeypatch, slow_runs):
    """The estimate of what is missing knows how long the runs of this study took on the clock.

    It counts the start of workers and the waits for a busy machine: here 30 s a run, of which three
    are missing.
    """
    monkeypatch.setattr("orchard.study.study.processes", lambda count: slow_runs(2))
    options = StudyOptions(budget_seconds=3600.0, store=tmp_path / "s.db")
    found = study(empty_orchard(rows=4, pickers=2), {"carriers": [1, 2, 3, 4, 5]}, options)
    assert len(found.not_run) == 3
    assert found.seconds_needed == pytest.approx(3 * 30.0)


def test_the_estimate_counts_the_runs_that_were_done(tmp_path, monkeypatch, slow_runs):
    """Two settings have ten runs each, of 30 s, and more are needed to tell them apart."""
    monkeypatch.setattr(module, "processes", lambda count: slow_runs(2 * LOOKS[0]))
    options = StudyOptions(
        model="fast", budget_seconds=3600.0, within=3e-3, store=tmp_path / "s.db"
    )
    told = study(GANG, {"carriers": [6, 7]}, options)
    assert told.undecided
    more_runs = [look - LOOKS[0] for look in LOOKS[1:]]
    assert told.seconds_needed in [pytest.approx(2 * 30.0 * more) for more in more_runs]
