"""What a study shows: the table, the CSV, the picture, the report, and the whole as JSON.

Results of studies are made by hand (tests/support/made_studies.py). A row of a table is a setting,
with its rate and its interval.
"""

import csv
import io
import json
import re
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

MACHINES = (
    "5.5 m from row to row, carriers at 1 m/s, pickers that drive at 1 m/s, 5 s at the bay,"
    " 0.2 s to couple a bin, 0.4 s to uncouple it"
)


MADE_OF = f"20 rows of 70 m, one bin a row, 10 pickers, two-way, rolling dispatch, {MACHINES}"


# A name that HTML and the terminal would take for an order.
HOSTILE = 'mine.<script>alert("1")</script>&[bold]'


@cache
def whole():
    """Return a result with all that can be shown: costs, checks by the simulator, a jam, a note."""
    result = by_carriers(notes=["The budget allowed 3 seeds"])
    checks = {9: checked(71.9, 0.9, 0.021), 10: checked(71.9, 0.5, -0.011, jammed=1)}
    rows = [replace(row, check=checks.get(row.setting["carriers"])) for row in result.table]
    return replace(result, table=rows, answer=answer(replace(result, table=rows)))


def hostile():
    """Return a result in which the policy, a note and the answer are HOSTILE."""
    rows = [
        a_row(80.0 + n, 0.5, setting={"dispatch": name})
        for n, name in enumerate(("nearest", HOSTILE))
    ]
    return a_result(rows, {"dispatch": HOSTILE}, notes=[HOSTILE], answer=HOSTILE)


def printed(result, width):
    """Return the lines of the table in a terminal of this width."""
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
    """The table is 80 columns wide, and an ellipsis would show a cut."""
    rows = [
        replace(row, setting=row.setting | {"dispatch": "my_policies.TheOneThatIsBest"})
        for row in whole().table
    ]
    lines = printed(a_result(rows, rows[6].setting), 80)
    assert max(map(len, lines)) <= 80 and "…" not in "".join(lines)


def test_columns_that_tell_nothing_are_left_out():
    """A column is left out if it has no figure, or if it is a key with one value."""
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
    """Only the best setting has no figure. That of a setting with one run has no interval.

    `lead`: by which share the best is ahead, with an interval; `behind`: the same without one.
    """
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
    """Rich would take [bold] for an order to write in bold."""
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
    """Return the words of the legend of a picture."""
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
    """Its bytes are the same each time, and its words are text and no outlines."""
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


def test_two_pictures_of_a_page_have_no_part_of_one_name():
    """A page with the same name twice is no valid page, and refers to the wrong part."""
    drawing = picture.figure(whole())
    names = []
    for title in ("A study", "What it hangs on"):
        svg = picture.inline_drawing(drawing, title)
        of_this = re.findall(r' id="([^"]+)"', svg)
        assert set(re.findall(r"url\(#([^)]+)\)", svg)) <= set(of_this)
        names += of_this
    assert names and len(set(names)) == len(names)


class Structure(HTMLParser):
    """What an HTML page consists of: its tags and words. Each tag must be closed in its order."""

    # Tags that are not closed.
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
    """The report shows a command that does the same study again, with all digits and the model."""
    by_full = replace(
        a_result([replace(a_row(84.1, 0.6, setting=carriers(9)), model="full")], None),
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
    """60 t/ha are 6 kg/m2. A metre of a row has the fruit of its spacing: 5.5 m by default, or 3.66
    m, the width between trunks and a trunk of 0.5 m.
    """
    apples = {"tonnes_per_hectare": 60, "kilograms_per_bin": 400}
    wide = check({"crop": apples})
    narrow = check({"crop": apples, "row_width": 3.16})
    assert wide.bin_metres == pytest.approx(400 / (6.0 * 5.5))
    assert narrow.bin_metres == pytest.approx(400 / (6.0 * 3.66))


def test_the_result_comes_back_from_json():
    text = json.dumps(asdict(whole()))
    assert msgspec.json.decode(text, type=StudyResult) == whole()
