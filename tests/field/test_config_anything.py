"""Whatever is taken for a scenario is one, or an error that can be printed."""

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from orchard.field.problems import ScenarioError
from orchard.field.scenario import People, Scenario, check, load, parse, to_yaml, with_changes

SECTIONS = ("people", "animals", "laser", "picking")
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


@given(legal)
def test_a_scenario_survives_yaml(scenario: Scenario) -> None:
    assert parse(to_yaml(scenario)) == scenario


def scenario_or_error(make: object, *arguments: object) -> None:
    """Either a scenario, or an error that can be printed."""
    try:
        assert isinstance(make(*arguments), Scenario)
    except ScenarioError as error:
        assert error.problems
        assert len(str(error).encode("utf-8")) < 20_000


names = st.sampled_from([*Scenario.model_fields, "workers", "visitors", "dogs", "cats", "noise", "spread", "failure", "cv", "rowz"])
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
    {},
    optional={name: st.integers(0, 60) | anything for name in Scenario.model_fields if name not in SECTIONS}
    | {name: st.dictionaries(keys, st.integers(0, 60) | anything, max_size=3) for name in SECTIONS},
)


@given(anything | st.dictionaries(keys, anything, max_size=5) | nearly)
def test_any_value_is_a_scenario_or_an_error(values: object) -> None:
    scenario_or_error(check, values)


@settings(max_examples=40)
@given(st.dictionaries(st.text(max_size=3) | st.sampled_from(["rows", "people.workers", "people", "laser.noise.x"]), anything, max_size=3))
def test_any_change_is_a_scenario_or_an_error(changes: dict) -> None:
    scenario_or_error(lambda: with_changes(Scenario(), **changes))


SCRAPS = [*"\n\n :-?[]{},#&*!|>'\"%@`~=<\t\r\\", ": ", "\n  ", "- ", "---\n", "...\n", "&a ", "*a", "<<: "]
SCRAPS += ["!!int ", "!!map ", "!!set ", "%TAG ! x\n", '"\\x41"', "\\U00110000", "rows", "people", "workers", "laser", "noise"]
SCRAPS += ["5", "0x1F", "0o7", "1e3", ".inf", ".nan", "true", "null", "2001-01-01"]
scraps = st.lists(st.sampled_from(SCRAPS) | st.text(max_size=2), max_size=25).map("".join)
TEXT = "rows: 4\npeople: {workers: 3, visitors: 0}\nlaser: {noise: 0.01}\nagents: {picker: my.Picker}\n"
damaged = st.builds(lambda at, scrap, gone: TEXT[:at] + scrap + TEXT[at + gone :], st.integers(0, len(TEXT)), scraps, st.integers(0, 2))


@settings(max_examples=200)
@given(st.text() | scraps | damaged)
@example("agents: {1: 2}")
@example("rows: 3\n" * 8000)
@example("{" + "a," * 30_000 + "}")
def test_any_text_is_a_scenario_or_an_error(text: str) -> None:
    scenario_or_error(parse, text)


@settings(max_examples=40)
@given(nearly)
def test_any_yaml_of_values_is_a_scenario_or_an_error(values: dict) -> None:
    scenario_or_error(parse, yaml.dump(values))


@given(content=st.binary(max_size=200))
def test_any_file_is_a_scenario_or_an_error(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "any.yaml"
    file.write_bytes(content)
    scenario_or_error(load, file)
