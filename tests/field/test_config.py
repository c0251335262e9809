"""The scenario: what the shipped ones stand for, what is fine in a file, what a change makes of it;
and whatever is given as a scenario is one, or is refused in words.

Shipped scenarios (config/) have figures of published sources, which their comments name. Tests
compute them again from the source's own units.
"""

import json
from pathlib import Path

import pytest
import yaml
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from docs.published import FIGURES
from docs.scenario_schema import schema_text
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import People, Scenario, check, load, parse, to_yaml, with_changes
from orchard.field.shipped import load_or_shipped, shipped
from orchard.report.bounds import Bounds

CONFIG = Path(__file__).parents[2] / "config"


def test_the_default_file_says_exactly_the_defaults() -> None:
    assert load(CONFIG / "orchard.yaml") == Scenario()
    assert yaml.safe_load((CONFIG / "orchard.yaml").read_text()) == Scenario().model_dump()


@pytest.mark.parametrize(
    ("name", "tonnes", "rate", "bins"),
    [("hand_picking", 39.0, 1.5, 112), ("kiwi_robot", 20.0, 0.87, 57)],
)
def test_a_hectare_of_kiwifruit_fills_the_bins_of_its_yield(
    name: str, tonnes: float, rate: float, bins: int
) -> None:
    """`tonnes` a hectare of 10,000 m2; a bin has 350 kg. `rate`: bins an hour of a picker."""
    hectare = load(CONFIG / f"{name}.yaml")
    assert hectare.rows * hectare.row_length * hectare.row_pitch == pytest.approx(10_000, rel=0.01)
    assert hectare.chosen["picking_rate"] == pytest.approx(rate)
    layout = lay_out(hectare)
    assert hectare.rows * hectare.row_length / layout.metres_per_bin == pytest.approx(
        tonnes * 1000 / 350, rel=0.01
    )
    # The last bin of each picker may be part full.
    assert bins <= layout.bins < bins + hectare.pickers


def test_a_robot_of_four_arms_takes_as_long_as_its_fruit() -> None:
    """A bin has 350 kg of fruit of 117 g. Four arms pick one each in 5.5 s."""
    assert 3600 / load(CONFIG / "kiwi_robot.yaml").chosen["picking_rate"] == pytest.approx(
        350 / 0.117 * 5.5 / 4, rel=0.01
    )


def test_a_platform_for_apples_needs_a_minute_for_each_bin() -> None:
    """The platform fills a bin in nine minutes, and the exchange takes one minute more."""
    platforms = load(CONFIG / "apple_platform.yaml")
    assert platforms.rows * platforms.row_length * platforms.row_pitch == pytest.approx(
        10_000, rel=0.01
    )
    assert platforms.row_pitch == pytest.approx(3.66)
    bounds = Bounds(lay_out(platforms))
    assert bounds.picking_seconds == pytest.approx(9 * 60, rel=0.01)
    assert bounds.bin_seconds - bounds.picking_seconds > 60.0


def test_carts_bring_the_fruit_of_the_same_people() -> None:
    """People pick as many kilograms an hour on the same hectare."""
    people = load(CONFIG / "hand_picking.yaml")
    carts = load(CONFIG / "cart_robots.yaml")
    assert carts.crop.tonnes_per_hectare == people.crop.tonnes_per_hectare
    picked = [each.chosen["picking_rate"] * each.crop.kilograms_per_bin for each in (people, carts)]
    assert picked[1] == pytest.approx(picked[0], rel=0.01)
    # Five miles an hour.
    assert carts.carrying.speed == pytest.approx(5 * 1609.344 / 3600, rel=0.02)


def test_robots_for_apples_fill_the_bins_of_their_fruit() -> None:
    """They pick 2,500 apples of 0.19 kg an hour, into bins of 386 kg: 45 % of 59.5 bins an acre.

    An acre is 0.404686 hectares.
    """
    robots = load(CONFIG / "apple_robots.yaml")
    assert robots.chosen["picking_rate"] == pytest.approx(2500 * 0.19 / 386, rel=0.01)
    hectare = 59.5 * 0.386 / 0.404686
    assert robots.crop.tonnes_per_hectare == pytest.approx(0.45 * hectare, rel=0.01)


def test_a_forklift_brings_the_tonnes_that_were_published() -> None:
    """The times for which a load is away, 906 and 771 s, were fitted. With them the limit of the
    long run is the lower published rate: of a forklift with 4 boxes, and of a straddle trailer with
    8. The forklift alone is a shipped scenario.
    """
    published = {figure.quantity: figure.low for figure in FIGURES}
    few = published["t/h, forklift, 4 boxes"]
    many = published["t/h, straddle trailer, 8 boxes"]
    forklift = load(CONFIG / "forklift.yaml")
    for bins, away, tonnes in ((4, 906.0, few), (8, 771.0, many)):
        trailers = {"trailers": {"bins": bins, "count": 1}, "seconds_away": away}
        scenario = Scenario.model_validate(forklift.model_dump() | {"load_out": trailers})
        # A bin is 0.33 t.
        bins_per_second = Bounds(lay_out(scenario)).terms["trailers"]
        assert bins_per_second * 3600 * 0.33 == pytest.approx(tonnes, rel=0.01)


def test_trailers_of_the_gangs_keep_up_with_them() -> None:
    """In ten minutes six bins are filled, 36 an hour. Four trailers of three bins, each away for
    ten minutes, could bring almost twice as much.
    """
    gangs = load(CONFIG / "tractor_trailers.yaml")
    assert gangs.pickers * gangs.chosen["picking_rate"] == pytest.approx(36.0)
    terms = Bounds(lay_out(gangs)).terms
    assert terms["trailers"] > 1.9 * terms["pickers"]


@pytest.mark.parametrize("name", ["apple_robots", "forklift", "tractor_trailers"])
def test_a_shipped_scenario_is_harvested(name: str) -> None:
    """The event model harvests it whole, and the page offers it as it does the others."""
    assert name in shipped()
    layout = lay_out(load(CONFIG / f"{name}.yaml"))
    harvest = DiscreteHarvest(layout).run()
    assert harvest.is_over
    assert harvest.delivered == layout.bins


def test_the_committed_schema_is_the_models() -> None:
    assert (CONFIG / "scenario.schema.json").read_text() == schema_text(), "run: make docs"


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.name)
def test_every_scenario_file_names_the_schema(file: Path) -> None:
    assert file.read_text().startswith("# yaml-language-server: $schema=scenario.schema.json\n")
    load(file)


def test_a_file_of_the_user_comes_before_a_shipped_scenario(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_or_shipped(None) == Scenario()
    assert load_or_shipped(Path("hand_picking")) == load(CONFIG / "hand_picking.yaml")
    Path("hand_picking").write_text("rows: 7")
    assert load_or_shipped(Path("hand_picking")) == Scenario(rows=7)
    with pytest.raises(ScenarioError, match="realistc: no such file"):
        load_or_shipped(Path("realistc"))


def fields(section: dict, schema: dict) -> dict[str, dict]:
    """Return all fields of a section, and of the sections in it, by name. `schema`: the whole one,
    which has these sections in `$defs`.
    """
    by_name = {}
    for name, field in section["properties"].items():
        ref = (field.get("items") or (field.get("anyOf") or [field])[0]).get("$ref", "")
        below = schema["$defs"].get(ref.rpartition("/")[2])
        by_name |= fields(below, schema) if below else {name: field}
    return by_name


def test_every_field_is_described_and_limited() -> None:
    """A number has limits, a text a pattern, and a list a greatest length."""
    schema = json.loads(schema_text())
    by_name = fields(schema, schema)
    assert {"rows", "workers", "noise", "carriers"} <= set(by_name)
    for name, field in by_name.items():
        assert field["description"], name
        limited = field["anyOf"][0] if "anyOf" in field else field
        assert (
            field.get("type") in ("boolean", "object")
            or {"minimum", "maximum"} <= set(limited)
            or "pattern" in limited
            or "maxItems" in limited
        ), name


@pytest.mark.parametrize(
    ("pickers", "carriers"), [(2, 2), (3, 3), (5, 4), (10, 7), (11, 8), (20, 14)]
)
def test_carriers_follow_the_pickers(pickers: int, carriers: int) -> None:
    """There are 7 for every 10, rounded up, unless the scenario says how many."""
    assert Scenario(rows=20, pickers=pickers).carrier_count == carriers
    assert Scenario(rows=20, pickers=pickers, carriers=9).carrier_count == 9


@pytest.mark.parametrize(
    "text", ["", "# nothing but a comment\n", "---\n", "{}", "\ufeff", "people: {}\n", "null"]
)
def test_an_empty_file_is_all_defaults(text: str, tmp_path: Path) -> None:
    file = tmp_path / "empty.yaml"
    file.write_text(text, encoding="utf-8")
    assert load(file) == Scenario()


def test_marks_and_line_ends_of_other_systems_are_no_harm(tmp_path: Path) -> None:
    (tmp_path / "good.yaml").write_bytes(b"\xef\xbb\xbfrows: 4\r\npickers: 2\r\n")
    assert load(tmp_path / "good.yaml") == Scenario(rows=4, pickers=2)


def test_an_integer_is_fine_where_a_number_is_wanted() -> None:
    assert parse("row_width: 6\nlaser: {noise: 0}").row_width == 6.0
    assert type(parse("row_width: 6").row_width) is float


@pytest.mark.parametrize(
    ("text", "speed"),
    [("1e-1", 0.1), ("5.0E-2", 0.05), (".5", 0.5), ("1.", 1.0), ("+0.25", 0.25), ("1", 1.0)],
)
def test_numbers_are_written_in_any_usual_way(text: str, speed: float) -> None:
    assert parse(f"picking_speed: {text}").picking_speed == speed


@given(
    st.floats(20.0, 200.0),
    st.floats(5.0, 12.0),
    st.floats(10.0, 60.0),
    st.floats(250.0, 450.0),
    st.floats(1.0, 4.0),
)
def test_yield_and_rate_in_a_growers_units_give_metres_and_speed(
    length, width, tonnes, kilograms, rate
):
    """Sizes in m, tonnes a hectare, kilograms a bin, bins an hour. And the same orchard in bins a
    row and m/s has the same values.
    """
    crop = {"tonnes_per_hectare": tonnes, "kilograms_per_bin": kilograms}
    sizes = {"row_length": length, "row_width": width}
    # The ground of a row, with half of the trees on each side, and the bins that it fills.
    hectares = length * (width + 0.5) / 10_000
    bins = 1000 * tonnes * hectares / kilograms
    # A scenario allows bins that fill in 5 to 400 m of row, and at most 40 bins a row.
    assume(5.0 <= length / bins <= 200.0)
    grower = Scenario(**sizes, crop=crop, picking_rate=rate)
    assert grower.bin_metres == pytest.approx(length / bins)
    assert lay_out(grower).picking_seconds(1, grower.bin_metres) == pytest.approx(3600 / rate)
    if bins <= 40:
        assert Scenario(
            **sizes, bins_per_row=bins, picking_speed=grower.mean_picking_speed
        ).chosen == pytest.approx(grower.chosen)


@pytest.mark.parametrize("more", [{}, {"metres_per_bin": 20.0}, {"bins_per_row": 4.0}])
def test_longer_rows_leave_the_rate_as_it_was(more):
    """The rate is in bins an hour. Where a bin is so many metres of row, the speed stays, too."""
    short, long = (
        Scenario(row_length=length, picking_rate=1.5, **more) for length in (70.0, 110.0)
    )
    assert short.chosen["picking_rate"] == pytest.approx(1.5)
    assert long.chosen["picking_rate"] == pytest.approx(1.5)
    assert (short.mean_picking_speed == long.mean_picking_speed) == ("metres_per_bin" in more)


def test_changes_are_checked_anew() -> None:
    scenario = Scenario()
    assert with_changes(scenario, rows=8, seed=7).rows == 8
    assert with_changes(scenario) == scenario
    with pytest.raises(ScenarioError) as caught:
        with_changes(scenario, rows=3, pickers=4, weeds=99)
    assert [problem.path for problem in caught.value.problems] == ["weeds", "pickers, rows"]


def test_changes_leave_the_callers_maps_as_they_were():
    own = {"picker": "mine.Picker"}
    assert with_changes(Scenario(), agents=own, **{"agents.bin": "mine.Bin"}).agents == {
        "picker": "mine.Picker",
        "bin": "mine.Bin",
    }
    assert own == {"picker": "mine.Picker"}


def test_a_change_reaches_into_a_section_and_leaves_the_rest() -> None:
    """By default there are four workers and three visitors."""
    scenario = Scenario()
    by_path = with_changes(scenario, **{"people.workers": 9})
    assert by_path.people == People(workers=9, visitors=3)
    assert with_changes(scenario, people={"workers": 9}) == by_path
    assert with_changes(scenario, people=People(workers=9)) == by_path
    assert scenario.people.workers == 4


@pytest.mark.parametrize(
    "path", ["rowz", "people.wokers", "rows.x", "", ".", "people.", "people.workers.x", "a.b.c"]
)
def test_a_change_of_what_is_not_there(path: str) -> None:
    with pytest.raises(ScenarioError):
        with_changes(Scenario(), **{path: 1})


def test_values_from_python_are_as_strict() -> None:
    for value in (True, 5.0, "5", 10**5000, float("nan"), object(), None, b"5"):
        with pytest.raises(ScenarioError, match="rows = "):
            check({"rows": value})


SECTIONS = ("people", "animals", "laser", "picking")
legal = st.builds(
    Scenario,
    rows=st.integers(10, 20),
    pickers=st.integers(2, 10),
    row_width=st.floats(5.0, 12.0),
    carriers=st.none() | st.integers(1, 40),
    picking_speed=st.floats(0.002, 1.0),
    metres_per_bin=st.none() | st.floats(5.0, 200.0),
    seed=st.integers(0, 2**63 - 1),
    people=st.builds(People, workers=st.integers(0, 25), visitors=st.integers(0, 25)),
    tractor=st.booleans(),
    laser=st.floats(0.0, 0.02).map(lambda noise: {"noise": noise}),
)


@given(legal)
def test_a_scenario_survives_yaml(scenario: Scenario) -> None:
    assert parse(to_yaml(scenario)) == scenario


def scenario_or_error(make: object, *arguments: object) -> None:
    """Assert that a function returns a scenario, or refuses its arguments in few words."""
    try:
        assert isinstance(make(*arguments), Scenario)
    except ScenarioError as refusal:
        error = refusal
    else:
        return
    assert error.problems
    assert len(str(error).encode("utf-8")) < 20_000


# What may stand in a file: `names` and other keys, `leaves` and what is made of them; `nearly` is a
# scenario in which a value or two are wrong.
names = st.sampled_from(
    [
        *Scenario.model_fields,
        "workers",
        "visitors",
        "dogs",
        "cats",
        "noise",
        "spread",
        "failure",
        "cv",
        "rowz",
    ]
)
keys = (
    names
    | st.text(st.characters(), max_size=5)
    | st.integers()
    | st.none()
    | st.floats()
    | st.booleans()
    | st.tuples(st.integers())
)
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
anything = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=4),
    max_leaves=8,
)
nearly = st.fixed_dictionaries(
    {},
    optional={
        name: st.integers(0, 60) | anything
        for name in Scenario.model_fields
        if name not in SECTIONS
    }
    | {name: st.dictionaries(keys, st.integers(0, 60) | anything, max_size=3) for name in SECTIONS},
)


@given(anything | st.dictionaries(keys, anything, max_size=5) | nearly)
def test_any_value_is_a_scenario_or_an_error(values: object) -> None:
    scenario_or_error(check, values)


@settings(max_examples=40)
@given(
    st.dictionaries(
        st.text(max_size=3)
        | st.sampled_from(["rows", "people.workers", "people", "laser.noise.x"]),
        anything,
        max_size=3,
    )
)
def test_any_change_is_a_scenario_or_an_error(changes: dict) -> None:
    scenario_or_error(lambda: with_changes(Scenario(), **changes))


# Pieces of YAML, of which wrong texts are made.
SCRAPS = [
    *"\n\n :-?[]{},#&*!|>'\"%@`~=<\t\r\\",
    ": ",
    "\n  ",
    "- ",
    "---\n",
    "...\n",
    "&a ",
    "*a",
    "<<: ",
]
SCRAPS += [
    "!!int ",
    "!!map ",
    "!!set ",
    "%TAG ! x\n",
    '"\\x41"',
    "\\U00110000",
    "rows",
    "people",
    "workers",
    "laser",
    "noise",
]
SCRAPS += ["5", "0x1F", "0o7", "1e3", ".inf", ".nan", "true", "null", "2001-01-01"]
scraps = st.lists(st.sampled_from(SCRAPS) | st.text(max_size=2), max_size=25).map("".join)
TEXT = (
    "rows: 4\npeople: {workers: 3, visitors: 0}\nlaser: {noise: 0.01}\nagents: {picker:"
    " my.Picker}\n"
)
damaged = st.builds(
    lambda at, scrap, gone: TEXT[:at] + scrap + TEXT[at + gone :],
    st.integers(0, len(TEXT)),
    scraps,
    st.integers(0, 2),
)


@settings(max_examples=200)
@given(st.text() | scraps | damaged)
@example("agents: {1: 2}")
@example("rows: 3  # and all of it again\n" * 2000)
@example("{" + "abcdefg," * 7500 + "}")
def test_any_text_is_a_scenario_or_an_error(text: str) -> None:
    scenario_or_error(parse, text)


@settings(max_examples=40)
@given(nearly)
def test_any_yaml_of_values_is_a_scenario_or_an_error(values: dict) -> None:
    scenario_or_error(parse, yaml.dump(values))


@given(content=st.binary(max_size=200))
def test_any_file_is_a_scenario_or_an_error(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.getbasetemp() / "any.yaml"
    file.write_bytes(content)
    scenario_or_error(load, file)
