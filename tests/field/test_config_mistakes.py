"""Every mistake in a scenario is named with its place, all of them at once; a file that is no
scenario at all is refused in few words.
"""

import difflib
import itertools
import pickle
from pathlib import Path
from typing import Any

import pytest
import yaml
from scenario_mistakes import refusal, refused

from orchard.field import yaml_file
from orchard.field.problems import MOST_NAMED, ScenarioError, Section
from orchard.field.scenario import People, Scenario, load, parse
from orchard.field.yaml_file import LARGEST_FILE

# A text of a scenario, and words of its refusal.
OUT_OF_RANGE = [
    ("rows: 2", "rows = 2: must be a whole number from 3 to 100"),
    ("rows: 101", "rows = 101: must be a whole number from 3 to 100"),
    ("rows: 126", "of a larger orchard, simulate each block by itself)"),
    ("pickers: 1", "pickers = 1: must be a whole number from 2 to 60"),
    (
        "row_width: 3.14",
        "row_width = 3.14: must be a number from 3.15 to 12.0 (width of a row between its trees, m;"
        " from row to row it is 0.5 m more)",
    ),
    ("row_width: 12.01", "row_width = 12.01: must be a number from 3.15 to 12.0"),
    ("carriers: 0", "carriers = 0: must be null or a whole number from 1 to 120"),
    ("carriers: 121", "carriers = 121: must be null or a whole number from 1 to 120"),
    ("picking_speed: 0.0005", "picking_speed = 0.0005: must be null or a number from 0.001 to 1.0"),
    ("picking_speed: -1", "picking_speed = -1: must be"),
    ("seed: -1", "seed = -1: must be a whole number from 0 to 9223372036854775807"),
    ("seed: 9223372036854775808", "must be a whole number from 0 to 9223372036854775807"),
    ("weeds: 51", "weeds = 51: must be a whole number from 0 to 50"),
    ("people: {workers: -1}", "people.workers = -1: must be a whole number from 0 to 50"),
    ("people: {visitors: 51}", "people.visitors = 51: must be"),
    ("animals: {dogs: 51}", "animals.dogs = 51: must be"),
    ("animals: {cats: 51}", "animals.cats = 51: must be"),
    (
        "weeds: 5\nagents: {piker: a.B}",
        ":2: agents.piker: not a kind (picker, carrier, tractor, bin,",
    ),
    (
        "laser: {noise: 0.2}",
        (
            "laser.noise = 0.2: must be a number from 0.0 to 0.02 (standard deviation of a measured"
            " range, m)"
        ),
    ),
]


@pytest.mark.parametrize(("text", "wanted"), OUT_OF_RANGE)
def test_out_of_range(text: str, wanted: str) -> None:
    assert wanted in refusal(text)


WRONG_TYPES = [
    "rows: true",
    "rows: 5.0",
    "rows: '5'",
    "rows: null",
    "rows: [5]",
    "rows: {a: 5}",
    "rows: five",
    "rows: 010",
    "rows: 1:05",
    "rows: 1_0",
    "rows: 2020-02-02",
    "row_width: true",
    "row_width: wide",
    "row_width: .nan",
    "row_width: .inf",
    "picking_speed: -.inf",
    "laser: {noise: .NaN}",
    "carriers: true",
    "carriers: many",
    "seed: 1.5",
    "tractor: 1",
    "tractor: yes",
    "tractor: null",
    "people: 3",
    "picking_speed: 1e999999999",
    'rows: "\\ud800"',
    "people: null",
    "people: [1, 2]",
    "animals: dogs",
    "laser: 0.1",
    "weeds: .inf",
]


@pytest.mark.parametrize("text", WRONG_TYPES)
def test_wrong_type(text: str) -> None:
    key = text.split(":")[0]
    line = refusal(text)
    assert line.startswith(f"my.yaml:1: {key}")
    assert ": must be " in line


# A text, the path that is unknown, and the key that was meant.
UNKNOWN_KEYS = [
    ("row: 5", "row", "rows"),
    ("picker: 5", "picker", "pickers"),
    ("Row-Width: 5", "Row-Width", "row_width"),
    ("lazer: {noise: 0}", "lazer", "laser"),
    ("people: {wokers: 1}", "people.wokers", "workers"),
    ("workers: 1", "workers", "people.workers"),
    ("cat: 1", "cat", "animals.cats"),
    ("people: {dogs: 1}", "people.dogs", "animals.dogs"),
]


@pytest.mark.parametrize(("text", "path", "guess"), UNKNOWN_KEYS)
def test_an_unknown_key_tells_the_closest(text: str, path: str, guess: str) -> None:
    line = refusal(text)
    assert line.startswith(f"my.yaml:1: {path} = ")
    assert f"did you mean {guess}?" in line


def test_a_farm_that_is_read_as_a_scenario_tells_what_reads_it() -> None:
    line = refusal("blocks: [{file: top.yaml}]")
    assert line.endswith(
        "unknown key of a scenario: it is one of a farm's file, which only orchard study reads;"
        " harvest each block's own file"
    )


def test_an_unknown_key_tells_the_known_ones() -> None:
    assert refusal("xyzzy: 1").endswith(
        "unknown key; known here: rows, pickers, row_length, metres_per_bin, bins_per_row, crop,"
        " row_width, carriers, queue_room, picking_speed, picking_rate, picking, picker_rates,"
        " picker_absences, carrying, handling, load_out, chargers, seed, people, animals, weeds,"
        " tractor, laser, sensors, agents, agents_without_body, dispatch, dispatch_errors,"
        " rows_to_pickers, order_in_row, route, bay, bays, shift, prices, survey"
    )


@pytest.mark.parametrize(
    "text",
    [
        "3: 1",
        "null: 1",
        "true: 1",
        "1.5: 1",
        '"": 1',
        '"a\\nb": 1',
        '"\\ud800": 1',
        '"\\e[31m": 1',
        "<<: 1",
    ],
)
def test_a_strange_key_is_an_unknown_one_and_prints_cleanly(text: str) -> None:
    line = refusal(text)
    assert "unknown key" in line
    assert line.isprintable()


ONE_OF_BOTH = "at most one of both can be set: each says what the other is"
CROP = "crop: {tonnes_per_hectare: 39, kilograms_per_bin: 350}"
# A text, and the only line of its refusal.
WHOLE_LINES = [
    ("animals: 3", "my.yaml:1: animals = 3: must be a map with some of the keys dogs, cats"),
    (
        "picking_speed: 1\npicking_rate: 9",
        f"my.yaml:2: picking_speed = 1.0, picking_rate = 9.0: {ONE_OF_BOTH}",
    ),
    (
        "metres_per_bin: 9\nbins_per_row: 2",
        f"my.yaml:2: metres_per_bin = 9.0, bins_per_row = 2.0: {ONE_OF_BOTH}",
    ),
    (
        f"metres_per_bin: 9\n{CROP}",
        f"my.yaml:2: metres_per_bin = 9.0, crop.tonnes_per_hectare = 39.0: {ONE_OF_BOTH}",
    ),
    (
        f"bins_per_row: 2\n{CROP}",
        f"my.yaml:2: bins_per_row = 2.0, crop.tonnes_per_hectare = 39.0: {ONE_OF_BOTH}",
    ),
    (
        "crop: {tonnes_per_hectare: 39}",
        (
            "my.yaml:1: crop.tonnes_per_hectare = 39.0, crop.kilograms_per_bin = None: must be set"
            " together"
        ),
    ),
    (
        "row_length: 30\nbins_per_row: 10",
        (
            "my.yaml:2: bins_per_row = 10.0, row_length = 30.0: a bin would fill in 3 m of row;"
            " must be 5 to 400 m"
        ),
    ),
    (
        "picking_rate: 60\nmetres_per_bin: 100",
        (
            "my.yaml:1: picking_rate = 60.0: must be 0.036 to 36 where 100 m of row fill a bin: a"
            " picker goes 0.001 to 1 m/s"
        ),
    ),
    (
        "picking_rate: 51\npicking: {spread: {distribution: gamma}}",
        (
            "my.yaml:2: picking_rate = 51.0, picking.spread.distribution = gamma, picking.spread.cv"
            " = 0.3: the distribution must be none at this picking_rate, because no picker picks"
            " faster than 1 m/s"
        ),
    ),
    # Counts that are too large together.
    ("rows: 3\npickers: 4", "my.yaml:2: pickers = 4, rows = 3: must be at most one picker a row"),
    ("pickers: 6", "my.yaml:1: pickers = 6, rows = 5: must be at most one picker a row"),
    (
        "people:\n  workers: 26\n  visitors: 25",
        "my.yaml:3: people.workers = 26, people.visitors = 25: must be at most 50 together",
    ),
    (
        "people: {workers: 48}",
        "my.yaml:1: people.workers = 48, people.visitors = 3: must be at most 50 together",
    ),
    (
        "animals: {dogs: 50, cats: 1}",
        "my.yaml:1: animals.dogs = 50, animals.cats = 1: must be at most 50 together",
    ),
]


@pytest.mark.parametrize(("text", "wanted"), WHOLE_LINES)
def test_what_contradicts_itself_is_told_in_one_line(text: str, wanted: str) -> None:
    assert refusal(text) == wanted


def test_a_model_made_by_hand_is_checked_too() -> None:
    with pytest.raises(ScenarioError, match="one picker a row"):
        Scenario(rows=3, pickers=4)
    with pytest.raises(ScenarioError, match="at most 50 together"):
        People(workers=50, visitors=1)


def test_a_key_that_is_given_twice() -> None:
    assert (
        refusal("rows: 4\nseed: 1\nrows: 5")
        == "my.yaml:3: rows = 5: given twice, in lines 1 and 3; once is allowed"
    )
    assert "people.workers = 2: given twice, in lines 2 and 3" in refusal(
        "people:\n  workers: 1\n  workers: 2\n"
    )


def test_all_problems_are_told_at_once() -> None:
    lines = refused(
        "rowz: 4\n"
        "rows: 4\n"
        "pickers: 6\n"
        "row_width: wide\n"
        "people:\n"
        "  wokers: 3\n"
        "  workers: 30\n"
        "  visitors: 30\n"
        "animals: {dogs: 99}\n"
        "seed: 1\n"
        "seed: 2\n"
    )
    starts = [
        "my.yaml:1: rowz",
        "my.yaml:3: pickers = 6, rows = 4",
        "my.yaml:4: row_width",
        "my.yaml:6: people.wokers",
        "my.yaml:8: people.workers = 30, people.visitors = 30",
        "my.yaml:9: animals.dogs = 99",
        "my.yaml:11: seed",
    ]
    assert [line[: len(start)] for line, start in zip(lines, starts, strict=True)] == starts


def test_all_broken_rules_are_told_at_once() -> None:
    """Also those of which some are about one value, and others about several."""
    assert refused(
        "rows: 3\npickers: 4\nagents_without_body: {picker: a.B}\npeople: {workers: 51}\nanimals:"
        " {dogs: 30, cats: 30}"
    ) == [
        "my.yaml:2: pickers = 4, rows = 3: must be at most one picker a row",
        (
            "my.yaml:3: agents_without_body = {'picker': 'a.B'}: must be names that no other agent"
            " has; not picker"
        ),
        (
            "my.yaml:4: people.workers = 51: must be a whole number from 0 to 50 (number of"
            " workers, in yellow hats)"
        ),
        "my.yaml:5: animals.dogs = 30, animals.cats = 30: must be at most 50 together",
    ]


def test_no_rule_is_blamed_on_a_field_that_is_wrong_by_itself() -> None:
    assert "rows = 999: must be" in refusal("rows: 999\npickers: 20")
    assert "people.visitors = -1: must be" in refusal("people: {workers: 50, visitors: -1}")


def test_problems_are_data_too() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse("seed: 1\nrows: 999", "my.yaml")
    (problem,) = caught.value.problems
    assert problem.file == "my.yaml"
    assert problem.line == 2
    assert problem.path == "rows"
    assert problem.value == "999"


def unreadable(path: Path | str) -> str:
    """Return the error of a file that cannot be read."""
    with pytest.raises(ScenarioError) as caught:
        load(path)
    return str(caught.value)


def test_a_missing_file(tmp_path: Path) -> None:
    assert unreadable(tmp_path / "none.yaml") == f"{tmp_path / 'none.yaml'}: no such file"


def test_an_unreadable_file(tmp_path: Path) -> None:
    assert "cannot be read: Is a directory" in unreadable(tmp_path)
    assert "cannot be read: embedded null byte" in unreadable("a\0b")
    assert "cannot be read" in unreadable("x" * 5000)


def test_not_utf8(tmp_path: Path) -> None:
    file = tmp_path / "latin.yaml"
    file.write_bytes(b"rows: 5\n# caf\xe9\n")
    assert unreadable(file) == f"{file}:2: is not UTF-8 text"
    file.write_bytes("rows: 3".encode("utf-16"))
    assert unreadable(file) == f"{file}:1: is not UTF-8 text"


@pytest.mark.parametrize(
    "text",
    [
        "rows: [1",
        "rows: 'x",
        "rows: 3: 4",
        "a\n b: 1\nc",
        "\trows: 5",
        "? [1]\n: 2",
        "@",
        "rows: 1\n---\nrows: 2",
    ],
)
def test_not_yaml_tells_line_and_column(text: str) -> None:
    line = refusal(text)
    assert "is not YAML" in line
    assert "(line " in line
    assert ", column " in line


# Words of the refusal, and texts that are refused so.
NO_PLAIN_MAPS = [
    (
        "is not YAML",
        [
            "\0",
            "rows: 3\0",
            "a: \x07",
            "rows: \x1b[2J",
            'a: "\\UFFFFFFFF"',
            "%YAML 1." + "9" * 5000 + "\n--- {}",
        ],
    ),
    ("must be a map of keys and values", ["[1, 2]", "5", "rows", "- rows: 5"]),
    (
        "tags (!name): not allowed",
        ["rows: !!python/object/apply:os.system [ls]", "!!python/name:os.system", "rows: !!int 5"],
    ),
    ("tags (!name): not allowed", ["rows: !mine 5", "seed: !!timestamp x"]),
]


@pytest.mark.parametrize(("words", "texts"), NO_PLAIN_MAPS)
def test_what_is_no_map_of_plain_values_is_refused(words: str, texts: list[str]) -> None:
    assert [text for text in texts if words not in refusal(text)] == []


def test_aliases_are_refused_so_nothing_can_grow() -> None:
    """Each line has nine times what the line before has: "billion laughs"."""
    names = "abcdefghi"
    laughs = "a: &a [x, x]\n" + "".join(
        f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in itertools.pairwise(names)
    )
    assert "my.yaml:2: aliases (*name): not allowed" in refusal(laughs)
    assert "aliases" in refusal("a: &a {b: *a}")


@pytest.mark.parametrize("text", ["[" * 60000, "- " * 30000, "a: " + "{a: " * 10000, "? " * 30000])
def test_deep_nesting_is_refused_after_a_few_levels(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes after the deepest allowed level is not read, because that could cost minutes.

    A level of these texts has at most five events of the parser.
    """
    events = []
    get_event = yaml.SafeLoader.get_event

    def counted(loader: yaml.SafeLoader) -> yaml.Event:
        events.append(get_event(loader))
        return events[-1]

    monkeypatch.setattr(yaml.SafeLoader, "get_event", counted)
    assert "nested too deeply" in refusal(text)
    assert 0 < len(events) <= 5 * yaml_file.DEEPEST


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    """The file has 10 GB of zeros, of which the disk stores none."""
    file = tmp_path / "huge.yaml"
    with file.open("wb") as sparse:
        sparse.truncate(10**10)
    assert f"is larger than {LARGEST_FILE} bytes" in unreadable(file)
    assert f"is larger than {LARGEST_FILE} bytes" in refusal("# " + "x" * LARGEST_FILE)


@pytest.mark.parametrize(
    "text",
    [
        "rows: " + "9" * 5000,
        "rows: '" + "x" * 50000 + "'",
        '"' + "k" * 500 + '": 1',
        "rows: [" + "1, " * 10000 + "]",
    ],
)
def test_a_long_value_is_shortened(text: str) -> None:
    assert len(refusal(text)) < 500


# A section, its values, and the beginning of each line of the refusal.
BUILT_DIRECTLY = [
    (Scenario, {"rows": 2}, ["rows = 2: must be a whole number from 3 to 100"]),
    (Scenario, {"rowz": 4}, ["rowz = 4: unknown key; did you mean rows?"]),
    (Scenario, {"rows": 3, "pickers": 5}, ["pickers = 5, rows = 3: must be at most one picker"]),
    (
        Scenario,
        {"rows": 2, "people": {"workers": -1}},
        ["rows = 2: must be", "people.workers = -1: must be a whole number from 0"],
    ),
    (People, {"workers": -1}, ["workers = -1: must be a whole number from 0 to 50"]),
]


@pytest.mark.parametrize(("section", "values", "message"), BUILT_DIRECTLY)
def test_a_section_that_is_built_directly_tells_its_mistakes(
    section: type[Section], values: dict[str, Any], message: list[str]
) -> None:
    """Its error and words are those of `load`, `check` and `with_changes`."""
    with pytest.raises(ScenarioError) as raised:
        section(**values)
    problems = raised.value.problems
    assert len(problems) == len(message)
    for problem, words in zip(problems, message, strict=True):
        assert str(problem).startswith(f"{section.__name__}: {words}")


def test_thousands_of_unknown_keys_cost_no_search_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only those that the text names are compared with known keys.

    The others are counted, and no problem is lost.
    """
    compared: list[str] = []
    search = difflib.get_close_matches

    def counting(word: str, *arguments: Any, **options: Any) -> list[str]:
        compared.append(word)
        return search(word, *arguments, **options)

    monkeypatch.setattr(difflib, "get_close_matches", counting)
    count = 5000
    with pytest.raises(ScenarioError) as raised:
        parse("\n".join(f"row_{number}: 1" for number in range(count)), "my.yaml")
    lines = str(raised.value).split("\n")
    assert lines[0].startswith("my.yaml:1: row_0 = 1: unknown key; did you mean rows?")
    assert all("known here: rows" in line for line in lines[:-1])
    assert lines[-1] == f"and {count - MOST_NAMED} more problems"
    assert [problem.line for problem in raised.value.problems] == list(range(1, count + 1))
    assert len(set(compared)) == MOST_NAMED


def test_mistakes_come_out_of_a_worker_process_as_they_are():
    with pytest.raises(ScenarioError) as raised:
        Scenario(rows=2)
    copy = pickle.loads(pickle.dumps(raised.value))
    assert str(copy) == str(raised.value)
    assert copy.problems == raised.value.problems
