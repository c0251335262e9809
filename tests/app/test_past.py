"""What the page keeps and reads, without a browser: links, the desks of browsers, the runs that have ended."""

import json

import pytest

from orchard.app.course import Course
from orchard.app.desks import MOST, Desks
from orchard.app.draft import Draft, title_of
from orchard.app.link import draft_of, query_of
from orchard.app.past import differences, past_runs
from orchard.field.scenario import Scenario, with_changes

SUMMARY = {"mode": "local", "finished": True, "rows": 3, "sim_seconds": 60.0, "bins_delivered": 3, "bins_per_hour": 180.0,
           "picker_waiting_seconds": 1.0, "carrier_utilisation": 0.5, "scenario": {"rows": 3, "agents": {"picker": "no.such.Class"}},
           "history": {"seconds": [10.0, 20.0], "bins_delivered": [0, 1], "pickers_waited_seconds": [0, 10.0],
                       "carriers_busy_seconds": [20.0, 30.0]}}  # fmt: skip


@pytest.mark.parametrize("changes", [{}, {"rows": 7, "people.workers": 0}, {"seed": 2**63 - 1, "laser.noise": 0.0125, "tractor": False}])
def test_a_link_brings_back_its_scenario(changes):
    scenario = with_changes(Scenario(), **changes)
    query = query_of(scenario)
    assert len(query.split("&")) == max(1, len(changes)), "only what differs from the default"
    draft, unknown = draft_of(pair.split("=") for pair in query.split("&") if pair)
    assert (draft.scenario, unknown) == (scenario, [])


def test_what_is_wrong_in_a_link_is_told():
    draft, unknown = draft_of([("rows", "99"), ("pikers", "3"), ("agents", "os.system"), ("tractor", "perhaps")])
    assert unknown == ["pikers: no such setting; did you mean pickers?", "agents: no such setting"]
    assert draft.problems.keys() == {"rows", "tractor"}


def test_each_browser_has_its_desk_and_two_pages_of_one_do_not_change_each_other():
    desks = Desks()
    desks.of("one").draft.set("rows", "9")
    assert desks.of("one").draft.scenario == Scenario(rows=9)
    assert desks.of("other").draft.scenario == Scenario()
    page = desks.of("one").draft.copy()
    page.set("rows", "x")
    assert desks.of("one").draft.scenario == Scenario(rows=9)
    for n in range(MOST - 1):
        desks.of(str(n))
    assert desks.of("one").draft.scenario == Scenario(rows=9), "it was there last"
    assert desks.of("other").draft.scenario == Scenario() and len(desks._desks) == MOST


def test_a_scenario_has_a_title_and_a_draft_its_own_values():
    assert title_of(Scenario()) == "5 rows, 2 pickers, 2 carriers, seed 1"
    other = with_changes(Scenario(rows=7, agents={"picker": "a.B"}), tractor=False, **{"laser.noise": 0.01})
    assert title_of(other) == "7 rows, 2 pickers, 2 carriers, seed 1, tractor off, laser noise 0.01, own classes"
    assert differences([Scenario(), other, other])["Rows"] == ["5", "7", "7"]
    assert differences([Scenario(), other])["picker"] == ["built-in", "a.B"]
    assert list(differences([Scenario(seed=1), Scenario(seed=2)])) == ["Seed"]
    assert Draft(other).copy().values == Draft(other).values


def test_past_runs_are_the_summaries_and_no_other_file(tmp_path):
    broken = [SUMMARY | change for change in ({"scenario": {"rows": 99}}, {"history": {"seconds": []}}, {"rows": "many"})]
    uneven = SUMMARY | {"history": SUMMARY["history"] | {"seconds": [1.0]}}
    files = {"good": json.dumps(SUMMARY), "list": "[]", "half": "{", "empty": "", "uneven": json.dumps(uneven)}
    for name, text in (files | {f"broken{n}": json.dumps(one) for n, one in enumerate(broken)}).items():
        (tmp_path / f"{name}.json").write_text(text)
    (past,) = past_runs(tmp_path)
    assert past.name == "good" and past.figures["Simulated"] == "1:00 min"
    assert past.scenario.agents == {"picker": "no.such.Class"}, "it is read, and no class is looked for"


def test_the_course_is_what_the_charts_show():
    course = Course(SUMMARY["history"], Scenario(rows=3, pickers=2, carriers=2))
    assert course.bins() == [[0.17, 0], [0.33, 1]]
    assert course.waiting() == [[0.17, 0.0], [0.33, 50.0]]
    assert course.busy() == [[0.17, 100.0], [0.33, 50.0]]
