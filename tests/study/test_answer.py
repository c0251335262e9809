"""The sentence of a study is right in all its cases."""

from dataclasses import replace

import pytest
from made_studies import a_result, a_row, by_carriers, by_policies, carriers, checked, interval

from orchard.study.words import sentence

NINE, TEN, ELEVEN = (a_row(rate, 0.6, setting=carriers(n)) for n, rate in ((9, 84.1), (10, 84.0), (11, 84.2)))
PRICED = replace(NINE, cost_per_bin=interval(7.7, 0.05))
LONE = replace(NINE, bins_per_hour=interval(84.1))
JAMMED = a_row(None, setting=carriers(12))
BOTH = [a_row(90.0 - n, 0.6, setting={"carriers": n, "dispatch": name}) for n in (8, 9) for name in ("nearest", "predictive")]


def of(*table, best=None, ties=(), **changes):
    return a_result(list(table), (best or table[0]).setting, tuple(row.setting for row in ties), **changes)


@pytest.mark.parametrize(
    ("result", "told"),
    [
        (of(PRICED, TEN, ELEVEN, ties=(TEN, ELEVEN)), "9 carriers: 84.1 ± 0.6 bins an hour, 7.70 a bin; 10 and 11 cannot be told apart."),
        (
            of(PRICED, TEN, ELEVEN, a_row(84.0, setting=carriers(12)), ties=(TEN, ELEVEN, a_row(84.0, setting=carriers(12)))),
            "9 carriers: 84.1 ± 0.6 bins an hour, 7.70 a bin; 10 to 12 cannot be told apart.",
        ),
        (
            of(NINE, TEN, ELEVEN, best=ELEVEN, ties=(NINE, TEN)),
            "11 carriers: 84.2 ± 0.6 bins an hour; 9 to 11 carriers cannot be told apart: 9 is the fewest.",
        ),
        (of(NINE, TEN, ELEVEN, ties=(ELEVEN,)), "9 carriers: 84.1 ± 0.6 bins an hour; 11 cannot be told apart."),
        (
            of(NINE, TEN, varied={"carriers": [*range(1, 21)], "dispatch": ["nearest", "predictive"]}),
            "9 carriers: 84.1 ± 0.6 bins an hour, the best of 2 of 40 settings.",
        ),
        (
            of(NINE, TEN, ties=(TEN,), stopped_by="budget"),
            "9 carriers: 84.1 ± 0.6 bins an hour; 10 cannot be told apart within the budget.",
        ),
        (of(NINE, TEN, ties=(TEN,), stopped_by="stopped"), "9 carriers: 84.1 ± 0.6 bins an hour; 10 cannot be told apart so far."),
        (of(NINE), "9 carriers: 84.1 ± 0.6 bins an hour."),
        (of(LONE, horizon="long"), "9 carriers: 84.1 bins an hour in the long run."),
        (of(PRICED, goal="cost_per_bin"), "9 carriers: 7.70 ± 0.05 a bin, 84.1 bins an hour."),
        (of(NINE, goal="harvest_seconds"), "9 carriers: 856 s for the harvest, 84.1 bins an hour."),
        (of(replace(LONE, setting={})), "this scenario: 84.1 bins an hour."),
        (of(replace(LONE, setting=carriers(1))), "1 carrier: 84.1 bins an hour."),
        (of(replace(LONE, setting={"picking_speed": 0.03})), "picking speed 0.03: 84.1 bins an hour."),
        (
            of(replace(LONE, setting={"people.workers": 4, "route": "two-way", "carriers": 9, "dispatch": "nearest"})),
            "9 carriers, 4 workers with nearest on two-way: 84.1 bins an hour.",
        ),
        (
            of(*BOTH, best=BOTH[0], ties=BOTH[1:]),
            "8 carriers with nearest: 82.0 ± 0.6 bins an hour; 8 carriers with predictive, 9 carriers with nearest and "
            "9 carriers with predictive cannot be told apart from it.",
        ),
        (of(*BOTH, best=BOTH[0], ties=BOTH[2:3]), "8 carriers with nearest: 82.0 ± 0.6 bins an hour; 9 cannot be told apart."),
        (by_policies(), "predictive: 72.8 ± 1.2 bins an hour; predictive-farthest cannot be told apart from it."),
        (
            of(replace(NINE, jammed=2), JAMMED),
            "9 carriers: 84.1 ± 0.6 bins an hour; 2 of its 5 runs jammed.",
        ),
        (
            a_result([JAMMED, replace(JAMMED, setting=carriers(13))], None),
            "All 2 settings jammed: robots waited for each other for ever.",
        ),
        (a_result([JAMMED], None), "12 carriers jammed: robots waited for each other for ever."),
        (a_result([], None), "No setting has been run yet."),
        (
            of(replace(NINE, check=checked(83.2, 0.5, -0.011)), replace(TEN, check=checked(83.0, 0.5, -0.012))),
            "9 carriers: 84.1 ± 0.6 bins an hour; the simulator says 83.2 ± 0.5, 1.1 % less.",
        ),
        (
            of(replace(NINE, check=checked(83.2, 0.5, -0.011, jammed=1)), replace(TEN, check=checked(86.0, 0.5, 0.024))),
            "9 carriers: 84.1 ± 0.6 bins an hour; the simulator says 83.2 ± 0.5, 1.1 % less, and 1 of 3 of its runs jammed, "
            "and prefers 10 carriers with 86.0 ± 0.5.",
        ),
        (of(replace(LONE, check=checked(84.1, 0.0, 0.0))), "9 carriers: 84.1 bins an hour; the simulator says 84.1, the same."),
        (of(replace(LONE, check=checked(84.1, 0.0, 0.0, jammed=3))), "9 carriers: 84.1 bins an hour; in the simulator it jams."),
    ],
)
def test_the_answer_in_one_sentence(result, told):
    assert sentence(result) == told


def test_many_ties_are_counted_and_not_all_named():
    result = by_policies()
    more = {"dispatch": "mine.Policy"}, {"dispatch": "yours.Policy"}
    tied = [row.setting for row in result.table if row.setting != result.best] + list(more)
    told = sentence(replace(result, indistinguishable=tied))
    assert told.endswith("; nearest, longest-waiting, farthest-first and 3 more cannot be told apart from it.")


def test_ties_in_two_keys_are_named_the_nearest_first():
    worse = a_row(70.0, 20.0, setting={"carriers": 1, "dispatch": "nearest"})
    told = sentence(of(worse, *BOTH, best=BOTH[0], ties=(worse, BOTH[3])))
    assert told.endswith("; 9 carriers with predictive and 1 carrier with nearest cannot be told apart from it.")


def test_the_fewest_of_the_cheapest_is_named():
    assert "9 and 10 carriers cannot be told apart: 9 is the fewest" in sentence(by_carriers())
