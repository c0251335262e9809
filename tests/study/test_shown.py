"""What a study says and shows: the sentence, the table, the CSV, the picture, the report, and the
whole as JSON.
"""

import csv
import io
import json
import shlex
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import cache
from html.parser import HTMLParser
from xml.etree import ElementTree

import msgspec
import pytest
from made_studies import (
    a_result,
    a_row,
    by_both,
    by_carriers,
    by_policies,
    carriers,
    checked,
    interval,
)
from made_surveys import UNEQUAL, orchard_of
from PIL import Image
from rich.console import Console

from orchard.field.scenario import Scenario, check, parse
from orchard.study import picture, report, table
from orchard.study.answer_words import answer
from orchard.study.orchard_words import orchard_words
from orchard.study.result import StudyResult
from orchard.study.settings import varied_of
from orchard.study.words import number_words, value_words

NINE, TEN, ELEVEN = (
    a_row(rate, 0.6, setting=carriers(n)) for n, rate in ((9, 84.1), (10, 84.0), (11, 84.2))
)
PRICED = replace(NINE, cost_per_bin=interval(7.7, 0.05))
LONE = replace(NINE, bins_per_hour=interval(84.1))
JAMMED = a_row(None, setting=carriers(12))
BOTH = [
    a_row(90.0 - n, 0.6, setting={"carriers": n, "dispatch": name})
    for n in (8, 9)
    for name in ("nearest", "predictive")
]


def of(*table, best=None, ties=(), unsure=(), **changes):
    unsure = [row.setting for row in unsure]
    return a_result(
        list(table),
        (best or table[0]).setting,
        tuple(row.setting for row in ties),
        undecided=unsure,
        **changes,
    )


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


MACHINES = (
    "5.5 m from row to row, carriers at 1 m/s, pickers that drive at 1 m/s, 5 s at the bay,"
    " 0.2 s to couple a bin, 0.4 s to uncouple it"
)
MADE_OF = f"20 rows of 70 m, one bin a row, 10 pickers, two-way, rolling dispatch, {MACHINES}"
HOSTILE = 'mine.<script>alert("1")</script>&[bold]'


@cache
def whole():
    result = by_carriers(notes=["The budget allowed 3 seeds"])
    checks = {9: checked(71.9, 0.9, 0.021), 10: checked(71.9, 0.5, -0.011, jammed=1)}
    rows = [replace(row, check=checks.get(row.setting["carriers"])) for row in result.table]
    return replace(result, table=rows, answer=answer(replace(result, table=rows)))


def hostile():
    rows = [
        a_row(80.0 + n, 0.5, setting={"dispatch": name})
        for n, name in enumerate(("nearest", HOSTILE))
    ]
    return a_result(rows, {"dispatch": HOSTILE}, notes=[HOSTILE], answer=HOSTILE)


def printed(result, width):
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(table.as_table(result))
    return console.export_text().splitlines()


@pytest.mark.parametrize("width", [80, 120])
def test_the_table_fits_and_loses_nothing(width):
    lines = printed(whole(), width)
    assert max(map(len, lines)) <= width
    text = " ".join("\n".join(lines).split())
    assert "…" not in text
    best = next(line for line in lines if line.startswith("10 *"))
    assert all(
        cell in best for cell in ("72.8", "2.88", "0.5", "316", "77 %", "79.2", "carriers", "71.9")
    )
    assert all(
        cell in text
        for cell in (
            "±0.6",
            "±0.03",
            "±1.0",
            "(92%)",
            "±0.5",
            "-1.1 %",
            "5 runs of each by the fast model",
        )
    )
    assert sum(line.startswith("9 =") for line in lines) == 1
    jammed = next(line for line in lines if "jammed" in line)
    assert "20" in jammed and "unloading" in jammed
    assert "interval of 95 % confidence" in text


def test_what_is_too_long_is_folded_and_not_cut():
    """What is too long for a narrow table is folded and not cut."""
    rows = [
        replace(row, setting=row.setting | {"dispatch": "my_policies.TheOneThatIsBest"})
        for row in whole().table
    ]
    lines = printed(a_result(rows, rows[6].setting), 80)
    assert max(map(len, lines)) <= 80 and "…" not in "".join(lines)


def test_columns_that_tell_nothing_are_left_out():
    """A column without a figure and a key with one value are left out."""
    heads, lines = table.heads_and_lines(by_policies())
    assert {"a bin", "checked", "harvest, s", "optimum, s"}.isdisjoint(heads)
    assert [line[0] for line in lines][3:] == ["predictive *", "predictive-farthest ="]
    assert "harvest, s" in table.heads_and_lines(by_carriers(goal="harvest_seconds"))[0]
    assert "harvest, s" not in table.heads_and_lines(by_carriers(goal="bins_per_hour"))[0]
    assert (
        "rows"
        not in table.heads_and_lines(replace(whole(), varied={"rows": [20], **whole().varied}))[0]
    )


def test_the_least_cost_of_one_harvest_has_its_time():
    """Eight pickers cost what four do, and are done in half the time."""
    rows = [
        a_row(rate, setting={"pickers": pickers}, cost_per_bin=interval(12.0))
        for pickers, rate in ((4, 20.0), (8, 40.0))
    ]
    told = a_result(rows, {"pickers": 8}, ({"pickers": 4},), goal="cost_per_bin")
    heads, lines = table.heads_and_lines(told)
    assert [line[heads.index("harvest, s")] for line in lines] == ["3,600", "1,800"]
    assert answer(told).startswith(
        "8 pickers: 12.0 a bin, 40.0 bins an hour, 1,800 s for the harvest; "
    )
    long_rows = [replace(row, harvest_seconds=None) for row in rows]
    long_run = replace(told, table=long_rows, horizon="long")
    assert "harvest, s" not in table.heads_and_lines(long_run)[0] and " s for" not in answer(
        long_run
    )


def test_how_far_behind_a_run_is_has_a_figure():
    """How far behind one run is has a figure and only the best has none."""
    rows = [
        a_row(88.2, setting=carriers(3), lead=interval(0.0), behind=None),
        a_row(84.0, setting=carriers(2), lead=None, behind=0.05),
        a_row(88.2, setting=carriers(4), lead=interval(0.0), behind=0.0),
        a_row(80.0, setting=carriers(1), lead=interval(0.1, 0.02), behind=0.1),
    ]
    heads, lines = table.heads_and_lines(a_result(rows, carriers(3)))
    behind = heads.index("behind, %")
    assert [line[behind] for line in lines] == ["-", "5.0", "0.0 ±0.0", "10.0 ±2.0"]


def test_an_order_to_the_terminal_is_shown_as_it_is():
    """What looks like an order to the terminal is shown as it is."""
    assert any(HOSTILE in line for line in printed(hostile(), 200))


def test_the_csv_has_every_figure_with_its_unit(tmp_path):
    table.save_csv(whole(), tmp_path / "study.csv")
    lines = {
        line["carriers"]: line
        for line in csv.DictReader(io.StringIO((tmp_path / "study.csv").read_text()))
    }
    assert list(lines) == [str(row.setting["carriers"]) for row in whole().table]
    ten = lines["10"]
    twenty = lines["20"]
    assert float(ten["bins_per_hour_mean"]) == 72.8
    assert [float(ten[f"cost_per_bin_{end}"]) for end in ("low", "high")] == pytest.approx(
        [2.8547, 2.9147], abs=1e-4
    )
    told = [ten[name] for name in ("standing", "check_jammed", "check_difference", "lead_high")]
    assert told == ["best", "1", "-0.011", "0.015"]
    assert (twenty["jammed"], twenty["bins_per_hour_mean"], twenty["check_jammed"]) == ("5", "", "")
    assert lines["9"]["standing"] == "equal"


def words_of(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_picture_has_rates_above_costs():
    rates, costs = picture.figure(whole()).axes
    assert (rates.get_ylabel(), costs.get_ylabel(), costs.get_xlabel()) == (
        "bins an hour",
        "cost of a bin",
        "carriers",
    )
    assert {"bound", "fast model", "simulator", "best", "jammed"} == set(words_of(rates))


def test_two_keys_are_a_line_for_each_value_of_the_second():
    (rates,) = picture.figure(by_both()).axes
    assert rates.get_xlabel() == "carriers"
    assert {"nearest", "farthest-first", "predictive"} < set(words_of(rates))
    lines = [
        line
        for line in rates.lines
        if line.get_label() in ("nearest", "farthest-first", "predictive")
    ]
    assert (
        len({line.get_marker() for line in lines})
        == len({line.get_linestyle() for line in lines})
        == 3
    ), "told apart in grey"


def test_values_that_are_no_numbers_stand_side_by_side():
    (rates,) = picture.figure(by_policies()).axes
    assert [tick.get_text().replace("\n", "") for tick in rates.get_xticklabels()] == [
        row.setting["dispatch"] for row in by_policies().table
    ]


def test_a_unit_of_the_scenario_stands_at_the_axis():
    rows = [a_row(80.0, setting={"picking_speed": speed}) for speed in (0.03, 1.0)]
    assert (
        picture.figure(a_result(rows, rows[0].setting)).axes[0].get_xlabel() == "picking speed, m/s"
    )


@pytest.mark.parametrize(
    "result",
    [a_result([], None), a_result([a_row(None)], None), a_result([a_row(80.0)], carriers(9))],
)
def test_a_study_that_has_hardly_begun_has_a_picture(result):
    assert picture.inline_svg(result).startswith("<svg")


def test_the_picture_is_the_same_each_time(tmp_path):
    """The picture is the same each time and its words are text."""
    for name in ("a.svg", "b.svg", "a.png"):
        picture.save(whole(), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    text = "".join(ElementTree.parse(tmp_path / "a.svg").getroot().itertext())
    assert "bins an hour" in text and "best" in text
    with Image.open(tmp_path / "a.png") as drawn:
        assert drawn.size == (1200, 990)
    with pytest.raises(ValueError, match=r"study.doc: a picture's name ends in .svg or .png"):
        picture.save(whole(), tmp_path / "study.doc")


def test_two_pages_that_draw_at_once_get_the_same_picture():
    alone = picture.inline_svg(whole())
    with ThreadPoolExecutor(2) as pages:
        assert set(pages.map(picture.inline_svg, [whole()] * 12)) == {alone}


class Structure(HTMLParser):
    VOID = ("meta", "br", "link")

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.tags = []
        self.words = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_the_report_holds_all_of_it_and_needs_nothing_else(tmp_path):
    report.save(whole(), tmp_path / "study.html")
    text = (tmp_path / "study.html").read_text()
    read = Structure(text)
    assert read.open == [] and {"svg", "table", "h1", "pre", "title"} <= set(read.tags)
    assert {"script", "link", "img"}.isdisjoint(read.tags) and "http" not in text.replace(
        "http://www.w3.org", ""
    )
    assert "<b:" not in text and 'lang="en"' in text
    words = "".join(read.words)
    assert (
        f"The orchard: {MADE_OF}" in words
        and "10 carriers: 2.88 ± 0.03 a bin" in words
        and "The budget allowed 3 seeds" in words
    )
    assert (
        "orchard study scenario.yaml --vary carriers=1,2,4,6,8,9,10,12,14,20 --goal cost_per_bin"
        in words
    )
    scenario = text[text.index("<pre>") + 5 : text.index("</pre>")]
    assert parse(scenario) == Scenario(rows=20, pickers=10)


def test_the_command_for_a_study_has_all_digits_and_the_model():
    """The command for a study has all digits and names the model."""
    by_full = replace(
        a_result([replace(NINE, model="full")], None),
        varied={
            "picking_speed": [0.123456789, None],
            "tractor": [True],
            "people": [{"workers": 0}],
        },
        within=0.0123456,
    )
    told = report.command(by_full)
    assert "--vary picking_speed=0.123456789,null --vary tractor=true --vary " in told
    assert varied_of([word for word in shlex.split(told) if word.startswith("people=")]) == (
        {"people": [{"workers": 0}]},
        [],
    )
    assert told.endswith(" --within 0.0123456 --model full")


def test_the_report_escapes_what_others_have_named():
    text = report.document(hostile())
    read = Structure(text)
    assert "script" not in read.tags
    assert read.open == [] and HOSTILE in "".join(read.words)


def test_the_orchard_is_named_without_what_varies():
    assert whole().orchard == MADE_OF
    scenario = Scenario(rows=3, row_length=60.5, carriers=1)
    of_fleet = "3 rows of 60.5 m, one bin a row, 2 pickers, 1 carrier, two-way, rolling dispatch"
    assert orchard_words(scenario) == f"{of_fleet}, {MACHINES}"
    assert (
        orchard_words(scenario, ["rows", "row_length", "pickers", "route", "dispatch"])
        == f"rows, one bin a row, 1 carrier, {MACHINES}"
    )
    assert orchard_words(orchard_of(UNEQUAL)).startswith("4 rows, as surveyed, ")


def test_the_orchard_is_named_with_its_spacing_and_its_machines():
    """What decides how many bins come is said, also where nobody has set it."""
    scenario = check(
        {
            "row_width": 3.16,
            "carrying": {"speed": 2.0},
            "picking": {"driving_speed": 0.8},
            "handling": {"unloading": 60, "coupling": 8, "uncoupling": 6, "exchange": 20},
        }
    )
    assert orchard_words(scenario, ["handling.coupling"]).endswith(
        "3.66 m from row to row, carriers at 2 m/s, pickers that drive at 0.8 m/s,"
        " 60 s at the bay, 6 s to uncouple it, 20 s with the empty bin"
    )


def test_a_crop_fills_bins_by_the_spacing_of_the_rows():
    apples = {"tonnes_per_hectare": 60, "kilograms_per_bin": 400}
    wide = check({"crop": apples})
    narrow = check({"crop": apples, "row_width": 3.16})
    assert wide.bin_metres == pytest.approx(400 / (6.0 * 5.5))
    assert narrow.bin_metres == pytest.approx(400 / (6.0 * 3.66))


def test_the_result_comes_back_from_json():
    text = json.dumps(asdict(whole()))
    assert msgspec.json.decode(text, type=StudyResult) == whole()
