"""The answer of a study as a sentence, and what it says if there is no best setting.

Results of studies are made by hand (tests/support/made_studies.py). A row of a table is a setting,
with its rate and its interval. Ties are settings that are as good as the answer within what counts,
2 %; unsure ones may be better.
"""

from dataclasses import replace

import pytest
from made_studies import (
    a_result,
    a_row,
    by_policies,
    carriers,
    checked,
    interval,
)

from orchard.study.answer_words import answer
from orchard.study.words import number_words, value_words

# Settings that are nearly alike: bins an hour, and half the width of the interval.
NINE = a_row(84.1, 0.6, setting=carriers(9))
TEN = a_row(84.0, 0.6, setting=carriers(10))
ELEVEN = a_row(84.2, 0.6, setting=carriers(11))

# Its interval reaches from within 2 % of the best mean to beyond.
EIGHT = a_row(82.4, 0.6, setting=carriers(8), standing="unknown")


PRICED = replace(NINE, cost_per_bin=interval(7.7, 0.05))


LONE = replace(NINE, bins_per_hour=interval(84.1))


JAMMED = a_row(None, setting=carriers(12))


BOTH = [
    a_row(90.0 - n, 0.6, setting={"carriers": n, "dispatch": name})
    for n in (8, 9)
    for name in ("nearest", "predictive")
]


def of(*table, best=None, ties=(), unsure=(), **changes):
    """Return a result with these rows. The first one is the answer, unless `best` is given."""
    unsure = [row.setting for row in unsure]
    return a_result(
        list(table),
        (best or table[0]).setting,
        tuple(row.setting for row in ties),
        undecided=unsure,
        **changes,
    )


# A result, and its answer as a sentence.
ANSWERS = [
    (
        of(NINE, TEN, ELEVEN, ties=(TEN, ELEVEN)),
        "9 carriers: 84.1 ± 0.6 bins an hour; one more gains less than 2 %.",
    ),
    (
        of(replace(NINE, lead=interval(0.018, 0.019)), TEN, ties=(TEN,)),
        "9 carriers: 84.1 ± 0.6 bins an hour; the best mean is 1.8 ± 1.9 % ahead, where 2 % count.",
    ),
    (
        of(NINE, TEN, ELEVEN, ties=(ELEVEN,)),
        "9 carriers: 84.1 ± 0.6 bins an hour; 11 gain less than 2 %.",
    ),
    (
        of(PRICED, TEN, ties=(TEN,), horizon="long"),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour, 7.70 a bin in the long run; one more gains less"
            " than 2 %."
        ),
    ),
    (
        of(PRICED, TEN, ELEVEN, ties=(TEN, ELEVEN), goal="cost_per_bin"),
        (
            "9 carriers: 7.70 ± 0.05 a bin, 84.1 bins an hour, 856 s for the harvest; 10 and 11 are"
            " within 2 % of it."
        ),
    ),
    (
        of(NINE, TEN, best=TEN, unsure=(NINE,), seconds_needed=39.2, stopped_by="budget"),
        "10 carriers: 84.0 ± 0.6 bins an hour; not enough runs to tell 9 from 10: 40 s more would.",
    ),
    (
        of(NINE, TEN, ELEVEN, best=TEN, ties=(ELEVEN,), unsure=(TEN,), seconds_needed=5.0),
        "10 carriers: 84.0 ± 0.6 bins an hour; not enough runs to tell 11 from 10: 5 s more would.",
    ),
    (
        of(NINE, TEN, best=TEN, unsure=(NINE,), seconds_needed=3488.0, stopped_by="budget"),
        (
            "10 carriers: 84.0 ± 0.6 bins an hour; not enough runs to tell 9 from 10: 59 min more"
            " would."
        ),
    ),
    (
        of(NINE, TEN, best=TEN, unsure=(NINE,), seconds_needed=8000.0, stopped_by="budget"),
        "10 carriers: 84.0 ± 0.6 bins an hour; not enough runs to tell 9 from 10: 3 h more would.",
    ),
    (
        of(NINE, TEN, ties=(TEN,), failed=[carriers(8)]),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour; 8 carriers failed, and is left out; one more"
            " gains less than 2 %."
        ),
    ),
    (
        of(NINE, TEN, ties=(TEN,), failed=[carriers(8), carriers(7)]),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour; 2 settings failed, such as 8 carriers, and are"
            " left out; one more gains less than 2 %."
        ),
    ),
    (
        # One run of each: that more have not run says how little is known.
        of(replace(LONE, replications=1), not_run=[carriers(8)], stopped_by="budget"),
        (
            "So far 9 carriers: 84.1 bins an hour; 1 of 2 settings has not run, 8 carriers, and may"
            " be better."
        ),
    ),
    (
        of(NINE, TEN, best=TEN, unsure=(NINE,), stopped_by="seeds"),
        "10 carriers: 84.0 ± 0.6 bins an hour; 80 runs of each are too few to tell 9 from 10.",
    ),
    (
        of(replace(LONE, replications=1), stopped_by="budget"),
        "9 carriers: 84.1 bins an hour, known from one run only.",
    ),
    # The best value is at an end of its range, and the value beyond it may be better. It is told as
    # "at least", or, if no other setting may be as good, as "at most".
    (
        of(NINE, TEN, best=TEN, ties=(NINE,), beyond={"carriers": 11}),
        (
            "At least 10 carriers: 84.0 ± 0.6 bins an hour; the range is too small, as 11 carriers"
            " may be better."
        ),
    ),
    (
        of(
            replace(LONE, setting={"carriers": 1, "chargers": 2}),
            beyond={"chargers": 3},
        ),
        (
            "At least chargers 2, 1 carrier: 84.1 bins an hour; the range is too small, as chargers"
            " 3 may be better."
        ),
    ),
    (
        of(
            replace(LONE, setting={"pickers": 2, "carriers": 5, "dispatch": "nearest"}),
            beyond={"pickers": 1, "carriers": 6},
        ),
        (
            "At most 2 pickers, at least 5 carriers, nearest: 84.1 bins an hour; the range is too"
            " small, as 1 picker and 6 carriers may be better."
        ),
    ),
    (
        of(NINE, TEN, best=TEN, unsure=(NINE,), seconds_needed=39.2, beyond={"carriers": 11}),
        (
            "At least 10 carriers: 84.0 ± 0.6 bins an hour; the range is too small, as 11 carriers"
            " may be better; not enough runs to tell 9 from 10: 40 s more would."
        ),
    ),
    (
        of(NINE, TEN, unsure=(TEN,), seconds_needed=39.2, beyond={"carriers": 8}),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour; the range is too small, as 8 carriers may be"
            " better; not enough runs to tell 10 from 9: 40 s more would."
        ),
    ),
    (
        of(NINE, TEN, ties=(TEN,), not_run=[carriers(8), carriers(11)], seconds_needed=2.5),
        (
            "So far 9 carriers: 84.1 ± 0.6 bins an hour; 2 of 4 settings have not run, such as 8"
            " carriers, and may be better: 3 s more would run each once."
        ),
    ),
    (
        of(NINE, TEN, unsure=(TEN,), not_run=[carriers(8)], seconds_needed=0.2),
        (
            "So far 9 carriers: 84.1 ± 0.6 bins an hour; 1 of 3 settings has not run, 8 carriers,"
            " and may be better: 1 s more would run it."
        ),
    ),
    (
        of(NINE, TEN, best=NINE, ties=(TEN,), beyond={"carriers": 8}),
        (
            "At most 9 carriers: 84.1 ± 0.6 bins an hour; the range is too small, as 8 carriers may"
            " be better."
        ),
    ),
    (of(NINE), "9 carriers: 84.1 ± 0.6 bins an hour."),
    (of(LONE, horizon="long"), "9 carriers: 84.1 bins an hour in the long run."),
    (of(NINE, goal="harvest_seconds"), "9 carriers: 856 s for the harvest, 84.1 bins an hour."),
    (of(replace(LONE, setting={})), "this scenario: 84.1 bins an hour."),
    (of(replace(LONE, setting=carriers(1))), "1 carrier: 84.1 bins an hour."),
    (
        of(replace(LONE, setting=carriers(None)), TEN, ties=(TEN,)),
        "automatic carriers: 84.1 bins an hour; 10 is within 2 % of it.",
    ),
    (of(replace(LONE, setting={"picking_speed": 0.03})), "picking speed 0.03: 84.1 bins an hour."),
    (
        of(
            replace(
                LONE,
                setting={
                    "people.workers": 4,
                    "route": "two-way",
                    "carriers": 9,
                    "dispatch": "nearest",
                },
            )
        ),
        "9 carriers, 4 workers with nearest on two-way: 84.1 bins an hour.",
    ),
    (
        of(*BOTH, best=BOTH[0], ties=BOTH[1:]),
        (
            "8 carriers with nearest: 82.0 ± 0.6 bins an hour; 8 carriers with predictive, 9"
            " carriers with nearest and 9 carriers with predictive are within 2 % of it."
        ),
    ),
    (
        by_policies(),
        "predictive: 72.8 ± 1.2 bins an hour; predictive-farthest is within 2 % of it.",
    ),
    (
        of(
            replace(NINE, check=checked(83.2, 0.5, -0.011)),
            replace(TEN, check=checked(83.0, 0.5, -0.012)),
        ),
        "9 carriers: 84.1 ± 0.6 bins an hour; the simulator says 83.2 ± 0.5, 1.1 % less.",
    ),
    (
        of(
            replace(NINE, check=checked(83.2, 0.5, -0.011, jammed=1)),
            replace(TEN, check=checked(86.0, 0.5, 0.024)),
        ),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour; the simulator says 83.2 ± 0.5, 1.1 % less, and 1"
            " of 3 of its runs jammed, and prefers 10 carriers with 86.0 ± 0.5."
        ),
    ),
    (
        of(NINE, EIGHT, ELEVEN, on_the_edge=[EIGHT.setting]),
        (
            "9 carriers: 84.1 ± 0.6 bins an hour; 8 may be within 2 % of the best mean, too: more"
            " runs hardly tell."
        ),
    ),
    (
        of(
            replace(LONE, harvest_seconds=interval(36000.0), ends="day 2 at 08:30"),
            horizon="harvest",
        ),
        "9 carriers: 84.1 bins an hour, 36,000 s for the harvest, which ends on day 2 at 08:30.",
    ),
    (
        of(replace(LONE, check=checked(84.1, 0.0, 0.0))),
        "9 carriers: 84.1 bins an hour; the simulator says 84.1, the same.",
    ),
    (
        of(replace(LONE, harvest_seconds=interval(1210.0), proven_seconds=1000.0)),
        "9 carriers: 84.1 bins an hour; 21 % above the proven optimum without traffic.",
    ),
    (
        of(replace(LONE, check=checked(84.1, 0.0, 0.0, jammed=3))),
        "9 carriers: 84.1 bins an hour; in the simulator it jams.",
    ),
]


@pytest.mark.parametrize(("result", "told"), ANSWERS)
def test_the_answer_is_one_sentence_and_one_about_its_orchard(result, told):
    first, orchard = answer(result).split(" The orchard: ")
    assert first == told
    limit = number_words(result.best_row.bound_bins_per_hour)
    assert (
        orchard
        == f"{result.orchard}; without traffic the carriers would allow {limit} bins an hour."
    )


SPEEDS = [
    a_row(rate, 0.6, setting={"picking_speed": speed}, standing="alone", behind=None)
    for speed, rate in ((0.02, 20.0), (0.03, 30.0), (0.04, 40.0), (0.05, 50.0), (0.06, 60.0))
]


FLEETS = [
    replace(row, setting=row.setting | {"picking_speed": speed}, standing=standing)
    for row, speed, standing in (
        (NINE, 0.02, "best"),
        (TEN, 0.02, "worse"),
        (NINE, 0.03, "unknown"),
        (TEN, 0.03, "best"),
        (JAMMED, 0.04, "jammed"),
    )
]


# Results of studies that vary what nobody chooses, here the picking speed, and their answers.
GIVEN = [
    (
        a_result(SPEEDS[:2], None, given=["picking_speed"]),
        (
            "picking speed 0.02: 20.0 ± 0.6 bins an hour; picking speed 0.03: 30.0 ± 0.6 bins an"
            " hour; picking speed is given and not chosen, so there is no best."
        ),
    ),
    (
        a_result(
            SPEEDS,
            None,
            given=["picking_speed"],
            not_run=[{"picking_speed": 1.0}],
            seconds_needed=3.0,
        ),
        (
            "So far picking speed 0.02: 20.0 ± 0.6 bins an hour; 3 more in the table; picking speed"
            " 0.06: 60.0 ± 0.6 bins an hour; picking speed is given and not chosen, so there is no"
            " best; 1 of 6 settings has not run, picking speed 1: 3 s more would run it."
        ),
    ),
    (
        a_result(
            FLEETS,
            None,
            given=["picking_speed"],
            undecided=[FLEETS[2].setting],
            seconds_needed=7.0,
        ),
        (
            "picking speed 0.02: 9 carriers, 84.1 ± 0.6 bins an hour; "
            "picking speed 0.03: 10 carriers, 84.0 ± 0.6 bins an hour; picking speed 0.04: jammed; "
            "picking speed is given and not chosen, so each has a best of its own; "
            "not enough runs to tell 1 of the settings from the best: 7 s more would."
        ),
    ),
]


@pytest.mark.parametrize(("result", "told"), GIVEN)
def test_what_nobody_chooses_is_told_without_a_best_of_all(result, told):
    """A picking speed is given by the crop. So there is an answer for each speed, and no best."""
    assert answer(result) == f"{told} The orchard: {result.orchard}."


@pytest.mark.parametrize(
    ("result", "told"),
    [
        (
            a_result([JAMMED, replace(JAMMED, setting=carriers(13))], None),
            "All 2 settings jammed: some robots waited for ever.",
        ),
        (a_result([JAMMED], None), "12 carriers jammed: some robots waited for ever."),
        (
            a_result([JAMMED], None, not_run=[carriers(13)]),
            (
                "12 carriers jammed: some robots waited for ever; 1 of 2 settings has not run, 13"
                " carriers, and may be better."
            ),
        ),
        (a_result([], None), "No setting has been run yet."),
    ],
)
def test_a_study_without_a_best_setting_says_why(result, told):
    assert answer(result) == told


def test_no_value_has_the_words_of_its_key():
    values = {
        "picking.failure.mean_between": "never",
        "prices.per_bin": "none",
        "carriers": "automatic",
    }
    assert {key: value_words(None, key) for key in values} == values


def test_many_equal_settings_are_counted_and_not_all_named():
    result = by_policies()
    more = [
        replace(result.table[0], setting={"dispatch": name})
        for name in ("mine.Policy", "yours.Policy")
    ]
    rows = [
        replace(row, standing="equal") if row.standing == "worse" else row
        for row in (*result.table, *more)
    ]
    told = answer(replace(result, table=rows))
    assert "; nearest, longest-waiting, farthest-first and 3 more are within 2 % of it." in told
