"""The page's form, orders, links, desks and past runs, without a browser."""

import asyncio
import json
import os
import sys
from copy import copy
from pathlib import Path
from types import SimpleNamespace

import pytest
from made_surveys import UNEQUAL, orchard_of
from patience import PATIENCE

from orchard.app.charts import BINS, BUSY, WAITING, course_of
from orchard.app.command import Files, PrintedLines, fresh_files
from orchard.app.desks import MOST, Desks
from orchard.app.draft import Draft, title_of
from orchard.app.entries import LABELS, entries, flat
from orchard.app.harvest_run import HarvestCommand, RunSettings, command
from orchard.app.link import draft_of, query_of
from orchard.app.own_classes import from_elsewhere
from orchard.app.page import Page
from orchard.app.past_runs import differences, lineages, past_runs
from orchard.app.study_run import StudyRun, StudySettings, study_command
from orchard.field.scenario import DISPATCH_POLICIES, Scenario, with_changes


def test_the_page_asks_for_every_value_of_a_scenario():
    assert list(entries()) == list(flat(Scenario()))
    assert with_changes(Scenario(), **flat(Scenario(rows=7, carriers=3))) == Scenario(
        rows=7, carriers=3
    )


def test_limits_and_steps_come_from_the_model():
    rows, noise, seed = (entries()[path] for path in ("rows", "laser.noise", "seed"))
    assert (rows.low, rows.high, rows.step, rows.limits) == (3, 100, 1, "3 to 100")
    assert (noise.step, noise.limits, noise.label) == (0.0002, "0 to 0.02 m", "Laser noise")
    assert not seed.has_slider, "a browser's numbers do not hold it"


def test_labels_are_words_of_a_reader():
    assert LABELS.keys() <= entries().keys(), "each of them is of a value that there is"
    scenario = with_changes(Scenario(), **{"sensors.gnss.white": 0.01, "dispatch_errors": "end"})
    assert title_of(scenario).endswith(
        "seed 1, GNSS error of a tick 0.01, after a refused order end"
    )


NO_NUMBERS = {"abc": "from 3.65 to 12.5", "": "number", "1e999": "to 12.5"}
WRONG_FIELDS = [
    ({"rows": 101.0}, {"rows": "from 3 to 100"}),
    ({"rows": 5.5}, {"rows": "a whole number"}),
    ({"rows": None}, {"rows": "a whole number"}),
    ({"pickers": 6.0}, {"pickers": "one picker a row", "rows": "one picker a row"}),
    (
        {"people.workers": 30.0, "people.visitors": 30.0},
        {"people.workers": "at most 50 together", "people.visitors": "at most 50"},
    ),
    ({"seed": "many"}, {"seed": "a whole number"}),
    ({"seed": "9223372036854775808"}, {"seed": "to 9223372036854775807"}),
    ({"rows": 2.0, "laser.noise": 1.0}, {"rows": "from 3", "laser.noise": "to 0.02"}),
    *(({"row_width": typed}, {"row_width": told}) for typed, told in NO_NUMBERS.items()),
]


def test_a_rule_about_several_values_names_them_by_their_labels():
    """A rule about several values names them as the form does, and not as the file."""
    draft = Draft(Scenario())
    draft.enter({"people.workers": 30, "people.visitors": 30})
    told = draft.problems["people.workers"]
    assert told.startswith("Workers = 30, Visitors = 30: ")


class Upload:
    """A file that a page sends, which may be other than a browser's. `was_read`: whether it was."""

    def __init__(self, name, content):
        self.name = name
        self._content = content
        self.was_read = False

    def size(self):
        return len(self._content)

    async def read(self):
        self.was_read = True
        return self._content


@pytest.fixture
def refused(monkeypatch):
    """Upload a file to a page that shows nothing. Return the lines with which it is refused."""
    lines = []
    monkeypatch.setattr("orchard.app.page.complain", lambda title, told: lines.extend(told))
    page = Page.__new__(Page)
    page._upload = SimpleNamespace(reset=lambda: None)

    def upload(name, content):
        file = Upload(name, content)
        asyncio.run(page._open(SimpleNamespace(file=file)))
        return lines, file.was_read

    return upload


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"rows: 5\0", "is not YAML: unacceptable character #x0000"),
        ("rows: 5".encode("utf-16"), "not UTF-8 text"),
        (b"\x89PNG\r\n\x1a\n", "not UTF-8 text"),
        (b"#" * 70_000, "is larger than 65536 bytes"),
        (b"a: &a [*a]", "aliases (*name): not allowed in a scenario"),
        (b"!!python/object/apply:os.system ['true']", "tags (!name): not allowed"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused_in_a_line(refused, content, told):
    (line,), _ = refused("orchard.yaml", content)
    assert line.startswith("orchard.yaml") and told in line


def test_a_file_that_is_far_too_large_is_not_read(refused):
    """A browser refuses such a file. Another program sends it all the same."""
    (line,), was_read = refused("orchard.yaml", b"#" * 1_000_000)
    assert "too large" in line
    assert not was_read


def test_the_name_of_a_file_is_shown_short_and_harmless(refused):
    (line,), _ = refused("\x1b[31m\u202e" + "x" * 5000, b"\0")
    assert line.isprintable() and len(line) < 300


def test_of_many_mistakes_in_a_file_some_are_named(refused):
    lines, _ = refused("orchard.yaml", "".join(f"k{n}: 1\n" for n in range(200)).encode())
    assert len(lines) == 51 and lines[-1] == "and 150 more problems"


def test_a_comma_is_a_decimal_sign_as_a_point_is():
    for typed in ("85.5", "85,5", " 85,50 ", "855e-1"):
        draft = Draft(Scenario())
        draft.enter({"row_length": typed})
        assert draft.scenario == Scenario(row_length=85.5), typed
    draft.enter({"prices.per_bin": "0,125"})
    assert draft.scenario.prices.per_bin == 0.125, "nobody parts thousands so"


def test_a_comma_that_may_part_thousands_is_refused():
    """Both meanings are said. Only one that is right is advised."""
    draft = Draft(Scenario())
    draft.enter({"prices.per_bin": "1,250", "crop.kilograms_per_bin": "1,250", "rows": "5,500"})
    assert draft.scenario is None
    told = draft.problems
    assert told["prices.per_bin"].endswith("; 1,250 may mean 1.25 or 1250: write 1.25 or 1250")
    assert told["crop.kilograms_per_bin"].endswith("; 1,250 may mean 1.25 or 1250: write 1250")
    assert "may mean" not in told["rows"], "there are no 5.5 rows, and no 5500"


def test_each_message_begins_with_the_label_of_its_field():
    """It is said once, and no key of the file is in it."""
    draft = Draft(Scenario())
    draft.enter({"row_length": "long", "picking.failure.mean_between": "1", "seed": "-1"})
    assert draft.problems == {
        "row_length": "Row length: must be a number from 20 to 400 m",
        "picking.failure.mean_between": (
            "Time between failures: must be a number from 60 to 86400 s, or tick “never”"
        ),
        "seed": "Seed: must be a whole number from 0 to 9223372036854775807",
    }
    draft = Draft(Scenario())
    draft.enter({"chargers": "0", "carrying.battery.hours": "3"})
    told = draft.problems["chargers"]
    assert told.startswith("Chargers = 0, Hours of a battery = 3: must be 1 to 120 chargers")
    assert told.endswith("without chargers, “Hours of a battery” must be “endless”")


@pytest.mark.parametrize(("changes", "told"), WRONG_FIELDS)
def test_what_is_wrong_is_told_at_its_field(changes, told):
    draft = Draft(Scenario())
    for path, value in changes.items():
        draft.enter({path: value})
    assert draft.scenario is None
    assert draft.problems.keys() == told.keys()
    assert all(words in draft.problems[path] for path, words in told.items())


def test_a_large_seed_keeps_every_digit():
    draft = Draft(Scenario())
    draft.enter({"seed": " 9223372036854775807 "})
    assert draft.scenario == Scenario(seed=2**63 - 1)


def test_the_classes_of_a_scenario_survive_changes():
    draft = Draft(Scenario(agents={"picker": "tests.support.own_agents.Eastward"}))
    draft.enter({"rows": "7"})
    assert draft.scenario == Scenario(
        rows=7, agents={"picker": "tests.support.own_agents.Eastward"}
    )
    draft.drop_classes()
    assert draft.scenario == Scenario(rows=7)


def test_a_survey_survives_changes_of_other_values():
    """A survey survives changes and refuses another number of rows."""
    surveyed = orchard_of(UNEQUAL, agents={"picker": "tests.support.own_agents.Eastward"})
    draft = Draft(surveyed)
    draft.enter({"seed": "7"})
    draft.drop_classes()
    assert draft.scenario == orchard_of(UNEQUAL, seed=7)
    assert "surveyed rows" in title_of(draft.scenario)
    draft.enter({"rows": "7"})
    assert (draft.scenario, draft.problems) == (None, {"rows": "Rows: must be 4 with this survey"})
    draft.enter({"rows": "4", "row_width": 4.0})
    assert draft.problems == {
        "row_width": "Spacing of rows: is as surveyed, and cannot be changed here"
    }


def test_built_in_rules_are_chosen_beside_a_class_of_a_file():
    """Built-in rules are chosen on the page and a class of a file stays one of the choices."""
    assert entries()["dispatch"].choices == DISPATCH_POLICIES
    own = "examples.seams.farthest_first.FarthestFirst"
    draft = Draft(Scenario(dispatch=own))
    assert (draft.classes, draft.scenario) == ({"dispatch": own}, Scenario(dispatch=own))
    draft.enter({"dispatch": "predictive"})
    assert (draft.classes, draft.scenario) == ({}, Scenario(dispatch="predictive"))
    draft.enter({"dispatch": own})
    draft.drop_classes()
    assert draft.scenario == Scenario()


def test_a_link_chooses_a_built_in_rule_and_runs_no_class():
    assert draft_of([("dispatch", "nearest")])[0].scenario == Scenario(dispatch="nearest")
    draft, _ = draft_of([("dispatch", "this.Zen")])
    assert "a class of your own must be named in a scenario file" in draft.problems["dispatch"]
    assert "this" not in sys.modules
    assert query_of(Scenario(rows=7, dispatch="this.Zen")) == "rows=7"
    assert query_of(Scenario(dispatch="nearest")) == "dispatch=nearest"


def test_a_link_is_checked_once_however_long_it_is(monkeypatch):
    checks = []
    monkeypatch.setattr(
        "orchard.app.draft.with_changes",
        lambda base, **values: checks.append(values) or with_changes(base, **values),
    )
    draft, _ = draft_of([("rows", "3"), ("tractor", "maybe")] * 1000)
    assert len(checks) == 2, "of the default, and of the link"
    assert [*draft.problems] == ["tractor"]


def test_a_class_for_a_robot_that_is_gone_is_told():
    draft = Draft(Scenario(pickers=3, agents={"picker_03": "tests.support.own_agents.Eastward"}))
    assert draft.scenario is not None
    draft.enter({"pickers": "2"})
    assert draft.scenario is None
    assert "agents.picker_03: no such agent or kind" in draft.problems["agents"]


def test_own_classes_are_of_the_start_directory_and_do_not_run(tmp_path, monkeypatch):
    """Own classes are of the directory of the start and none runs when it is looked for."""
    (tmp_path / "mine.py").write_text("raise SystemExit('it ran')")
    (tmp_path / "yours").mkdir()
    (tmp_path / "yours" / "there.py").touch()
    (tmp_path / "yours" / "far").mkdir()
    (tmp_path / "yours" / "far" / "off.py").touch()
    (tmp_path / "lib").mkdir()
    (
        tmp_path / "lib" / "deeper.py"
    ).touch()  # on the path, but not the user's own, as a library in .venv
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    inside = {
        "picker": "mine.Picker",
        "carrier": "yours.there.Carrier",
        "bin": "mine:Bin",
        "cat": "yours.far.off.Cat",
    }
    outside = {
        "tractor": "subprocess.Popen",
        "dog": "sys.exit",
        "dog_02": "numpy.load",
        "worker": "no.A",
        "weed": "tests.support.own_agents.Rude",
    }
    outside["visitor"] = "deeper.Visitor"
    refused = from_elsewhere(Scenario(agents=inside | outside).own_classes, tmp_path)
    assert [words.partition(":")[0] for words in refused] == list(outside)
    assert from_elsewhere({"weed": "bench.field.Weed"}, Path.cwd()) == []


def test_a_module_that_is_found_elsewhere_first_is_no_own_one(tmp_path, monkeypatch):
    """A file of that name in the folder is not the one that would run. Nor is one that lacks."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "shadowed.py").touch()
    (tmp_path / "shadowed.py").touch()
    (tmp_path / "plain.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    classes = {"picker": "shadowed.Picker", "carrier": "plain.inner.Carrier", "bin": "plain.Bin"}
    refused = from_elsewhere(classes, tmp_path)
    assert [words.partition(":")[0] for words in refused] == ["picker", "carrier"]


WRONG_PACES = [
    (RunSettings("lockstep", "max"), {"speed": "from 0.1 to 1000"}),
    (RunSettings("realtime", "max"), {"speed": "it cannot be max"}),
    (RunSettings("realtime", "", as_fast_as_it_goes=True), {"speed": "it cannot be max"}),
    (
        RunSettings("local", "1,250", "-1"),
        {"speed": "1,250 may mean 1.25 or 1250: write 1.25", "duration": "from 1 to 1000000"},
    ),
    (
        RunSettings("local", "", "soon", as_fast_as_it_goes=True),
        {"duration": "empty: the whole harvest"},
    ),
]


@pytest.mark.parametrize(("pace", "told"), WRONG_PACES)
def test_what_is_wrong_with_a_pace_is_told_at_its_field(pace, told):
    assert pace.problems.keys() == told.keys()
    assert all(words in pace.problems[name] for name, words in told.items())


def test_a_pace_is_what_run_py_is_told(tmp_path):
    def options(pace):
        line = command(pace, Files(tmp_path, "run"), 9090)
        return [
            line[line.index(name) + 1] if name in line else None
            for name in ("--mode", "--speed", "--duration")
        ]

    assert options(RunSettings("realtime", "12", "0" + "90.5", as_fast_as_it_goes=True)) == [
        "realtime",
        "12",
        "90.5",
    ]
    assert options(RunSettings("lockstep", "", " ", as_fast_as_it_goes=True)) == [
        "lockstep",
        "max",
        None,
    ]
    assert options(RunSettings("local", "0,125", "1000000")) == ["local", "0.125", "1000000"]


def test_two_runs_of_a_second_have_files_of_their_own(tmp_path):
    assert len({fresh_files(tmp_path, "harvest").scenario for _ in range(5)}) == 5


SUMMARY = {
    "mode": "local",
    "finished": True,
    "rows": 3,
    "sim_seconds": 60.0,
    "bins_delivered": 3,
    "bins_per_hour": 180.0,
    "picker_waiting_seconds": 1.0,
    "carrier_utilisation": 0.5,
    "scenario": {"rows": 3, "agents": {"picker": "no.such.Class"}},
    "times_real_time": 8.0,
    "rows_picked": 3,
    "bins": 3,
    "row_length": 70.0,
    "metres_picked": 210.0,
    "schedule_sim_seconds": 50.0,
    "state_seconds": {},
    "history": {
        "seconds": [10.0, 20.0],
        "bins_delivered": [0, 1],
        "pickers_waited_seconds": [0, 10.0],
        "carriers_busy_seconds": [20.0, 30.0],
    },
}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"rows": 7, "people.workers": 0},
        {"seed": 2**63 - 1, "laser.noise": 0.0125, "tractor": False},
    ],
)
def test_a_link_brings_back_its_scenario(changes):
    scenario = with_changes(Scenario(), **changes)
    query = query_of(scenario)
    assert len(query.split("&")) == max(1, len(changes)), "only what differs from the default"
    draft, unknown = draft_of(pair.split("=") for pair in query.split("&") if pair)
    assert unknown == []
    assert (draft.scenario if draft else Scenario()) == scenario


def test_what_is_wrong_in_a_link_is_told():
    draft, unknown = draft_of(
        [("rows", "999"), ("pikers", "3"), ("agents", "os.system"), ("tractor", "perhaps")]
    )
    assert unknown == ["pikers: no such setting; did you mean pickers?", "agents: no such setting"]
    assert draft.problems.keys() == {"rows", "tractor"}


def test_a_link_without_settings_holds_no_draft():
    """A link without settings holds no draft and names are told up to a number."""
    draft, unknown = draft_of([(f"x{number}" * 100, "1") for number in range(2000)])
    assert draft is None
    assert len(unknown) == 6 and unknown[-1] == "and 1995 more"
    assert all(len(words) < 100 for words in unknown)


def test_each_browser_has_its_desk():
    """Each browser has its desk and two pages of one do not change each other."""
    desks = Desks()
    desk = desks.of("one")
    desks.keep("one", desk)
    desk.draft.enter({"rows": "9"})
    assert desks.of("one").draft.scenario == Scenario(rows=9)
    assert desks.of("other").draft.scenario == Scenario()
    page = copy(desks.of("one").draft)
    page.enter({"rows": "x"})
    assert desks.of("one").draft.scenario == Scenario(rows=9)


def test_a_desk_is_kept_once_its_browser_shows_the_page():
    desks = Desks()
    entered = desks.of("user")
    entered.draft.enter({"rows": "9"})
    desks.keep("user", entered)
    for number in range(2 * MOST):
        desks.of(f"request {number}").draft.enter({"rows": "7"})
    assert desks.of("user") is entered
    assert desks.of("request 0").draft.scenario == Scenario(), "a request leaves nothing"
    for number in range(MOST - 1):
        desks.keep(str(number), desks.of(str(number)))
    desks.keep("user", desks.of("user"))
    desks.keep("new", desks.of("new"))
    assert desks.of("user") is entered, "it was there last"
    assert desks.of("0") is not desks.of("0"), "the one that was away longest is dropped"


def test_a_scenario_has_a_title_and_a_draft_its_own_values():
    assert title_of(Scenario(carriers=1)) == "5 rows, 2 pickers, 1 carrier, seed 1"
    other = with_changes(
        Scenario(rows=7, agents={"picker": "a.B"}), tractor=False, **{"laser.noise": 0.01}
    )
    assert (
        title_of(other)
        == "7 rows, 2 pickers, 2 carriers, seed 1, tractor off, laser noise 0.01, own classes"
    )
    assert differences([Scenario(), other, other])["Rows"] == ["5", "7", "7"]
    assert differences([Scenario(), other])["picker"] == ["built-in", "a.B"]
    assert list(differences([Scenario(seed=1), Scenario(seed=2)])) == ["Seed"]
    assert copy(Draft(other)).values == Draft(other).values


STRANGE = {
    "broken": ({"scenario": {"rows": 999}}, "rows = 999: must be a whole number from 3 to 100"),
    "empty": ({"history": {"seconds": []}}, "history: each sample needs all its values"),
    "uneven": (
        {"history": SUMMARY["history"] | {"seconds": [1.0]}},
        "history: each sample needs all its values",
    ),
    "text": ({"sim_seconds": "many"}, "Expected `float`, got `str` - at `$.sim_seconds`"),
    "nan": ({"bins_per_hour": float("nan")}, "JSON is malformed"),
}


def test_past_runs_are_the_summaries_and_any_other_file_is_named(tmp_path):
    files = {
        "good": json.dumps(SUMMARY),
        "list": "[]",
        "half": "{",
        "nothing": "",
        "deep": "[" * 100_000,
        "study-1": "{}",
    }
    for name, text in (
        files | {name: json.dumps(SUMMARY | change) for name, (change, _) in STRANGE.items()}
    ).items():
        (tmp_path / f"{name}.json").write_text(text)
    os.utime(tmp_path / "half.json", (1e12, 1e12))
    (past,), others = past_runs(tmp_path)
    assert past.name == "good" and past.figures["Simulated"] == "1:00 min"
    assert past.scenario.agents == {"picker": "no.such.Class"}, (
        "it is read, and no class is looked for"
    )
    assert [words.partition(".json is passed over: ")[0] for words in others] == sorted(
        [*STRANGE, "list", "half", "nothing", "deep"]
    )
    assert all(any(why in words for words in others) for _, why in STRANGE.values())


def test_forks_stand_under_their_parent_whatever_summaries_say(tmp_path):
    """Newest first, as any list of runs.

    Two that name each other stay in the list, and so does a run that names itself.
    """
    parents = {
        "old": None,
        "first": "old",
        "other": "gone",
        "of_first": "first",
        "second": "old",
        "own": "own",
        "a": "b",
        "b": "a",
    }
    for number, (name, parent) in enumerate(parents.items()):
        since = {} if parent is None else {"forked_from": {"run": parent, "seconds": 59.9}}
        (tmp_path / f"{name}.json").write_text(json.dumps(SUMMARY | since))
        os.utime(tmp_path / f"{name}.json", (number, number))
    shown = [
        [past.name for past in line]
        for line in lineages({past.name: past for past in past_runs(tmp_path)[0]})
    ]
    assert shown[-4:] == [
        ["old"],
        ["old", "second"],
        ["old", "first"],
        ["old", "first", "of_first"],
    ]
    assert sorted(line[-1] for line in shown) == sorted(parents)


def test_output_of_a_command_that_is_no_result_is_named(tmp_path, monkeypatch):
    """What a command prints and leaves that is no result is named."""
    files = Files(tmp_path, "odd")
    deep = '{"study": {"none": ' + "[" * 100_000
    code = f"print({deep!r}); open({str(files.summary)!r}, 'w').write('{{\"answer\": NaN}}')"
    monkeypatch.setattr(
        "orchard.app.study_run.study_command", lambda settings, files: [sys.executable, "-c", code]
    )
    study = StudyRun(Scenario(), StudySettings(), files)
    study._listener.join(PATIENCE)
    assert (study.is_over, study.result, study.state) == (True, None, "failed")
    assert (
        study.output.line_count == 2
        and "odd.json is passed over: JSON is malformed" in study.output.lines[-1]
    )


@pytest.mark.parametrize(
    "change", [{"sim_seconds": "many"}, {"history": 3}, {"rows": float("nan")}]
)
def test_a_summary_that_no_run_can_have_written_is_no_summary(tmp_path, change):
    run = HarvestCommand.__new__(HarvestCommand)
    run.files = Files(tmp_path, "odd")
    run.output = PrintedLines(0, ())
    run.summary = None
    run.files.summary.write_text(json.dumps(SUMMARY | change))
    run.finish()
    assert run.summary is None and "odd.json is passed over" in run.output.lines[0]


def test_the_course_is_what_the_charts_show():
    course = course_of(SUMMARY["history"], Scenario(rows=3, pickers=2, carriers=2))
    assert course == {
        BINS: [[0.17, 0], [0.33, 1]],
        WAITING: [[0.17, 0.0], [0.33, 50.0]],
        BUSY: [[0.17, 100.0], [0.33, 50.0]],
    }


def test_the_page_asks_as_a_user_would_type_it(tmp_path):
    asked = study_command(
        StudySettings(dispatch=("nearest", "predictive"), horizon="harvest"),
        Files(tmp_path, "study"),
    )
    words = asked[asked.index("study") : asked.index("--progress")]
    assert words[2:] == [
        "--vary",
        "carriers",
        "--vary",
        "dispatch=nearest,predictive",
        "--horizon",
        "harvest",
        "--budget",
        "300s",
    ]
