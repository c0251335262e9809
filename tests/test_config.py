"""The scenario file: what is allowed, and that every mistake is named with its place, all of them at once."""

import itertools
import json
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from orchard.config import (
    LARGEST_FILE,
    TIME_STEP,
    People,
    Scenario,
    ScenarioError,
    check,
    json_schema,
    load,
    parse,
    schema_text,
    to_yaml,
    with_changes,
)

CONFIG = Path(__file__).parent.parent / "config"
SECTIONS = ("people", "animals", "laser")


def refused(text: str) -> list[str]:
    """What is wrong with a scenario text, a line a problem."""
    with pytest.raises(ScenarioError) as caught:
        parse(text, "my.yaml")
    return str(caught.value).splitlines()


def refusal(text: str) -> str:
    """The one thing that is wrong with a scenario text."""
    (line,) = refused(text)
    return line


# --- what is shipped ---


def test_the_time_step_is_a_tenth_of_a_second() -> None:
    assert TIME_STEP == 0.1


def test_the_default_file_says_exactly_the_defaults() -> None:
    assert load(CONFIG / "orchard.yaml") == Scenario()
    assert yaml.safe_load((CONFIG / "orchard.yaml").read_text()) == Scenario().model_dump()


def test_the_realistic_file_picks_at_a_persons_rate() -> None:
    realistic = load(CONFIG / "realistic.yaml")
    bins_an_hour = realistic.picking_speed * 3600 / 70
    assert 1.2 <= bins_an_hour <= 1.8
    assert (realistic.pickers, realistic.carrier_count) == (5, 2)


def test_the_committed_schema_is_the_models() -> None:
    assert (CONFIG / "scenario.schema.json").read_text() == schema_text(), "run: python -m orchard.config"
    assert json.loads(schema_text()) == json_schema()


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.name)
def test_every_scenario_file_names_the_schema(file: Path) -> None:
    assert file.read_text().startswith("# yaml-language-server: $schema=scenario.schema.json\n")
    load(file)


def fields(section: dict, schema: dict) -> dict[str, dict]:
    """All fields that are not sections, by name."""
    found = {}
    for name, field in section["properties"].items():
        below = schema["$defs"].get(field.get("$ref", "").rpartition("/")[2])
        found |= fields(below, schema) if below else {name: field}
    return found


def test_every_field_is_described_and_limited() -> None:
    found = fields(json_schema(), json_schema())
    assert {"rows", "workers", "noise", "carriers"} <= set(found)
    for name, field in found.items():
        assert field["description"], name
        limited = field["anyOf"][0] if "anyOf" in field else field
        assert field.get("type") in ("boolean", "object") or {"minimum", "maximum"} <= set(limited), name


@pytest.mark.parametrize(("pickers", "carriers"), [(2, 2), (3, 3), (5, 4), (10, 7), (11, 8), (20, 14)])
def test_carriers_follow_the_pickers(pickers: int, carriers: int) -> None:
    assert Scenario(rows=20, pickers=pickers).carrier_count == carriers
    assert Scenario(rows=20, pickers=pickers, carriers=9).carrier_count == 9


# --- what is fine ---


@pytest.mark.parametrize("text", ["", "# nothing but a comment\n", "---\n", "{}", "\ufeff", "people: {}\n"])
def test_an_empty_file_is_all_defaults(text: str, tmp_path: Path) -> None:
    file = tmp_path / "empty.yaml"
    file.write_text(text, encoding="utf-8")
    assert load(file) == Scenario()


def test_an_integer_is_fine_where_a_number_is_wanted() -> None:
    assert parse("row_width: 6\nlaser: {noise: 0}").row_width == 6.0
    assert type(parse("row_width: 6").row_width) is float


@pytest.mark.parametrize(("text", "speed"), [("1e-1", 0.1), ("5.0E-2", 0.05), (".5", 0.5), ("1.", 1.0), ("+0.25", 0.25), ("1", 1.0)])
def test_numbers_are_written_in_any_usual_way(text: str, speed: float) -> None:
    assert parse(f"picking_speed: {text}").picking_speed == speed


@pytest.mark.parametrize(("pickers", "rows"), [(2, 3), (3, 3), (20, 20)])
def test_a_picker_a_row_is_fine(pickers: int, rows: int) -> None:
    assert parse(f"pickers: {pickers}\nrows: {rows}").pickers == pickers


def test_fifty_people_and_fifty_animals_are_fine() -> None:
    scenario = parse("people: {workers: 25, visitors: 25}\nanimals: {dogs: 0, cats: 50}")
    assert (scenario.people.visitors, scenario.animals.cats) == (25, 50)


# --- each mistake ---


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("rows: 2", "rows = 2: must be a whole number from 3 to 20"),
        ("rows: 21", "rows = 21: must be a whole number from 3 to 20"),
        ("pickers: 1", "pickers = 1: must be a whole number from 2 to 20"),
        ("row_width: 4.99", "row_width = 4.99: must be a number from 5.0 to 12.0 (width of a row between its trees, m)"),
        ("row_width: 12.01", "row_width = 12.01: must be a number from 5.0 to 12.0"),
        ("carriers: 0", "carriers = 0: must be null or a whole number from 1 to 40"),
        ("carriers: 41", "carriers = 41: must be null or a whole number from 1 to 40"),
        ("picking_speed: 0.01", "picking_speed = 0.01: must be a number from 0.02 to 1.0"),
        ("picking_speed: -1", "picking_speed = -1: must be"),
        ("seed: -1", "seed = -1: must be a whole number from 0 to 9223372036854775807"),
        ("seed: 9223372036854775808", "must be a whole number from 0 to 9223372036854775807"),
        ("weeds: 51", "weeds = 51: must be a whole number from 0 to 50"),
        ("people: {workers: -1}", "people.workers = -1: must be a whole number from 0 to 50"),
        ("people: {visitors: 51}", "people.visitors = 51: must be"),
        ("animals: {dogs: 51}", "animals.dogs = 51: must be"),
        ("animals: {cats: 51}", "animals.cats = 51: must be"),
        ("laser: {noise: 0.2}", "laser.noise = 0.2: must be a number from 0.0 to 0.02 (standard deviation of a measured range, m)"),
    ],
)
def test_out_of_range(text: str, wanted: str) -> None:
    assert wanted in refusal(text)


@pytest.mark.parametrize(
    "text",
    [
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
        "people: null",
        "people: [1, 2]",
        "animals: dogs",
        "laser: 0.1",
        "weeds: .inf",
    ],
)
def test_wrong_type(text: str) -> None:
    key = text.split(":")[0]
    line = refusal(text)
    assert line.startswith(f"my.yaml:1: {key}")
    assert ": must be " in line


def test_a_section_that_is_none_tells_its_keys() -> None:
    assert refusal("animals: 3") == "my.yaml:1: animals = 3: must be a map with some of the keys dogs, cats"


@pytest.mark.parametrize(
    ("text", "path", "guess"),
    [
        ("row: 5", "row", "rows"),
        ("picker: 5", "picker", "pickers"),
        ("Row-Width: 5", "Row-Width", "row_width"),
        ("lazer: {noise: 0}", "lazer", "laser"),
        ("people: {wokers: 1}", "people.wokers", "workers"),
        ("workers: 1", "workers", "people.workers"),
        ("cat: 1", "cat", "animals.cats"),
        ("people: {dogs: 1}", "people.dogs", "animals.dogs"),
    ],
)
def test_an_unknown_key_tells_the_closest(text: str, path: str, guess: str) -> None:
    line = refusal(text)
    assert line.startswith(f"my.yaml:1: {path} = ")
    assert f"did you mean {guess}?" in line


def test_an_unknown_key_tells_the_known_ones() -> None:
    assert refusal("xyzzy: 1").endswith(
        "unknown key; known here: rows, pickers, row_width, carriers, picking_speed, seed, people, animals, weeds, tractor, laser, agents"
    )


@pytest.mark.parametrize("text", ["3: 1", "null: 1", "true: 1", "1.5: 1", '"": 1', '"a\\nb": 1', '"\\ud800": 1', '"\\e[31m": 1', "<<: 1"])
def test_a_strange_key_is_an_unknown_one_and_prints_cleanly(text: str) -> None:
    line = refusal(text)
    assert "unknown key" in line
    assert line.isprintable()


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("rows: 3\npickers: 4", "my.yaml:2: pickers, rows = 4, 3: must be at most one picker a row"),
        ("pickers: 6", "my.yaml:1: pickers, rows = 6, 5: must be at most one picker a row"),
        ("people:\n  workers: 26\n  visitors: 25", "my.yaml:3: people.workers, people.visitors = 26, 25: must be at most 50 together"),
        ("people: {workers: 48}", "my.yaml:1: people.workers, people.visitors = 48, 3: must be at most 50 together"),
        ("animals: {dogs: 50, cats: 1}", "my.yaml:1: animals.dogs, animals.cats = 50, 1: must be at most 50 together"),
    ],
)
def test_what_fields_allow_together(text: str, wanted: str) -> None:
    assert refusal(text) == wanted


def test_a_model_made_by_hand_is_checked_too() -> None:
    with pytest.raises(ValueError, match="one picker a row"):
        Scenario(rows=3, pickers=4)
    with pytest.raises(ValueError, match="at most 50 together"):
        People(workers=50, visitors=1)


def test_a_key_that_is_given_twice() -> None:
    assert refusal("rows: 4\nseed: 1\nrows: 5") == "my.yaml:3: rows = 5: given twice, in lines 1 and 3; once is allowed"
    assert "people.workers = 2: given twice, in lines 2 and 3" in refusal("people:\n  workers: 1\n  workers: 2\n")


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
        "my.yaml:3: pickers, rows = 6, 4",
        "my.yaml:4: row_width",
        "my.yaml:6: people.wokers",
        "my.yaml:8: people.workers, people.visitors = 30, 30",
        "my.yaml:9: animals.dogs = 99",
        "my.yaml:11: seed",
    ]
    assert [line[: len(start)] for line, start in zip(lines, starts, strict=True)] == starts


def test_no_rule_is_blamed_on_a_field_that_is_wrong_by_itself() -> None:
    assert "rows = 99: must be" in refusal("rows: 99\npickers: 20")
    assert "people.visitors = -1: must be" in refusal("people: {workers: 50, visitors: -1}")


def test_problems_are_data_too() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse("seed: 1\nrows: 99", "my.yaml")
    (problem,) = caught.value.problems
    assert (problem.file, problem.line, problem.path, problem.value) == ("my.yaml", 2, "rows", "99")


# --- files that are no scenario at all ---


def unreadable(path: Path | str) -> str:
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


@pytest.mark.parametrize(
    "text", ["rows: [1", "rows: 'x", "rows: 3: 4", "a\n b: 1\nc", "\trows: 5", "? [1]\n: 2", "@", "rows: 1\n---\nrows: 2"]
)
def test_not_yaml_tells_line_and_column(text: str) -> None:
    line = refusal(text)
    assert "is not YAML" in line
    assert "(line " in line
    assert ", column " in line


@pytest.mark.parametrize("text", ["\0", "a: \x07", 'a: "\\UFFFFFFFF"', "%YAML 1." + "9" * 5000 + "\n--- {}"])
def test_what_the_yaml_reader_trips_over(text: str) -> None:
    assert "is not YAML" in refusal(text)


@pytest.mark.parametrize("text", ["[1, 2]", "5", "rows", "null", "- rows: 5"])
def test_yaml_that_is_not_a_map(text: str) -> None:
    if text == "null":
        assert parse(text) == Scenario()
    else:
        assert "must be a map of keys and values" in refusal(text)


@pytest.mark.parametrize(
    "text",
    ["rows: !!python/object/apply:os.system [ls]", "!!python/name:os.system", "rows: !!int 5", "rows: !mine 5", "seed: !!timestamp x"],
)
def test_tags_are_refused(text: str) -> None:
    assert "tags (!name): not allowed" in refusal(text)


def test_aliases_are_refused_so_nothing_can_grow() -> None:
    names = "abcdefghi"
    laughs = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in itertools.pairwise(names))
    assert "my.yaml:2: aliases (*name): not allowed" in refusal(laughs)
    assert "aliases" in refusal("a: &a {b: *a}")


@pytest.mark.parametrize("text", ["[" * 60000, "- " * 30000, "a: " + "{a: " * 10000, "? " * 30000])
def test_deep_nesting_is_refused_quickly(text: str) -> None:
    begin = time.perf_counter()
    assert "nested too deeply" in refusal(text)
    assert time.perf_counter() - begin < 1.0


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    file = tmp_path / "huge.yaml"
    with file.open("wb") as sparse:
        sparse.truncate(10**10)
    assert f"is larger than {LARGEST_FILE} bytes" in unreadable(file)
    assert f"is larger than {LARGEST_FILE} bytes" in refusal("# " + "x" * LARGEST_FILE)


@pytest.mark.parametrize(
    "text", ["rows: " + "9" * 5000, "rows: '" + "x" * 50000 + "'", '"' + "k" * 500 + '": 1', "rows: [" + "1, " * 10000 + "]"]
)
def test_a_long_value_is_shortened(text: str) -> None:
    assert len(refusal(text)) < 400


# --- changes and back ---


def test_changes_are_checked_anew() -> None:
    scenario = Scenario()
    assert with_changes(scenario, rows=8, seed=7).rows == 8
    assert with_changes(scenario) == scenario
    with pytest.raises(ScenarioError) as caught:
        with_changes(scenario, rows=3, pickers=4, weeds=99)
    assert [problem.path for problem in caught.value.problems] == ["weeds", "pickers, rows"]


def test_a_change_reaches_into_a_section_and_leaves_the_rest() -> None:
    scenario = Scenario()
    by_path = with_changes(scenario, **{"people.workers": 9})
    assert by_path.people == People(workers=9, visitors=3)
    assert with_changes(scenario, people={"workers": 9}) == by_path
    assert with_changes(scenario, people=People(workers=9)) == by_path
    assert scenario.people.workers == 4


@pytest.mark.parametrize("path", ["rowz", "people.wokers", "rows.x", "", ".", "people.", "people.workers.x", "a.b.c"])
def test_a_change_of_what_is_not_there(path: str) -> None:
    with pytest.raises(ScenarioError):
        with_changes(Scenario(), **{path: 1})


def test_values_from_python_are_as_strict() -> None:
    for value in (True, 5.0, "5", 10**5000, float("nan"), object(), None, b"5"):
        with pytest.raises(ScenarioError, match="rows = "):
            check({"rows": value})


# --- any scenario, any text, any mapping ---

legal = st.builds(
    Scenario,
    rows=st.integers(10, 20),
    pickers=st.integers(2, 10),
    row_width=st.floats(5.0, 12.0),
    carriers=st.none() | st.integers(1, 40),
    picking_speed=st.floats(0.02, 1.0),
    seed=st.integers(0, 2**63 - 1),
    people=st.builds(People, workers=st.integers(0, 25), visitors=st.integers(0, 25)),
    tractor=st.booleans(),
    laser=st.floats(0.0, 0.02).map(lambda noise: {"noise": noise}),
)


@settings(max_examples=60, deadline=None)
@given(legal)
def test_a_scenario_survives_yaml(scenario: Scenario) -> None:
    assert parse(to_yaml(scenario)) == scenario


def scenario_or_error(make: object, *arguments: object) -> None:
    """Either a scenario, or an error that can be printed."""
    try:
        assert isinstance(make(*arguments), Scenario)
    except ScenarioError as error:
        assert error.problems
        str(error).encode("utf-8")


names = st.sampled_from([*Scenario.model_fields, "workers", "visitors", "dogs", "cats", "noise", "rowz"])
keys = names | st.text(st.characters(), max_size=5) | st.integers() | st.none() | st.floats() | st.booleans() | st.tuples(st.integers())
leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([0, 3, 5, 20, 50, 10**400, -(10**4000)])
    | st.floats()
    | st.text(st.characters(), max_size=5)
    | st.binary(max_size=3)
    | st.dates()
)
anything = st.recursive(leaves, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=4), max_leaves=8)
nearly = st.fixed_dictionaries(
    {}, optional={name: st.integers(0, 60) | anything for name in Scenario.model_fields if name not in SECTIONS}
    | {name: st.dictionaries(keys, st.integers(0, 60) | anything, max_size=3) for name in SECTIONS}
)


@settings(max_examples=150, deadline=None)
@given(anything | st.dictionaries(keys, anything, max_size=5) | nearly)
def test_any_value_is_a_scenario_or_an_error(values: object) -> None:
    scenario_or_error(check, values)


@settings(max_examples=100, deadline=None)
@given(st.dictionaries(st.text(max_size=3) | st.sampled_from(["rows", "people.workers", "people", "laser.noise.x"]), anything, max_size=3))
def test_any_change_is_a_scenario_or_an_error(changes: dict) -> None:
    scenario_or_error(lambda: with_changes(Scenario(), **changes))


SCRAPS = [*"\n\n :-?[]{},#&*!|>'\"%@`~=<\t\r\\", ": ", "\n  ", "- ", "---\n", "...\n", "&a ", "*a", "<<: "]
SCRAPS += ["!!int ", "!!map ", "!!set ", "%TAG ! x\n", '"\\x41"', "\\U00110000", "rows", "people", "workers", "laser", "noise"]
SCRAPS += ["5", "0x1F", "0o7", "1e3", ".inf", ".nan", "true", "null", "2001-01-01"]
scraps = st.lists(st.sampled_from(SCRAPS) | st.text(max_size=2), max_size=25).map("".join)


@settings(max_examples=300, deadline=None)
@given(st.text() | scraps)
def test_any_text_is_a_scenario_or_an_error(text: str) -> None:
    scenario_or_error(parse, text)


@settings(max_examples=80, deadline=None)
@given(nearly)
def test_any_yaml_of_values_is_a_scenario_or_an_error(values: dict) -> None:
    scenario_or_error(parse, yaml.dump(values))


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=200))
def test_any_file_is_a_scenario_or_an_error(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "any.yaml"
    file.write_bytes(content)
    scenario_or_error(load, file)
