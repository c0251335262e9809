"""The rules that give rows to pickers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchard.field.rows import RULES, Block, rows_to_pickers
from orchard.field.scenario import Scenario

sizes = st.integers(3, 20).flatmap(lambda rows: st.tuples(st.just(rows), st.integers(2, rows)))


def blocks_of(rule: str, rows: int, pickers: int) -> list[Block]:
    return list(rows_to_pickers(Scenario(rows=rows, pickers=pickers, rows_to_pickers=rule)).values())


@pytest.mark.parametrize("rule", RULES)
@given(size=sizes)
def test_each_row_goes_to_one_picker_and_its_rows_are_neighbours_from_north_to_south(rule: str, size: tuple[int, int]) -> None:
    rows = [block.rows for block in blocks_of(rule, *size)]
    assert all(rows)
    assert [row for block in rows for row in block] == list(range(1, size[0] + 1)), "in the order of the pickers, so none passes another"


@pytest.mark.parametrize("rule", ["balanced", "balanced-ends"])
@given(size=sizes)
def test_no_picker_has_two_rows_more_than_another_if_they_are_balanced(rule: str, size: tuple[int, int]) -> None:
    counts = [len(block.rows) for block in blocks_of(rule, *size)]
    assert max(counts) - min(counts) <= 1


@given(size=sizes)
def test_every_second_picker_starts_in_the_east_if_both_ends_are_used(size: tuple[int, int]) -> None:
    starts = [block.start for block in blocks_of("balanced-ends", *size)]
    assert starts == (["west", "east"] * 10)[: size[1]]
    assert {block.start for block in blocks_of("balanced", *size)} == {"west"}


@pytest.mark.parametrize(("rows", "pickers", "counts"), [(5, 2, [2, 3]), (3, 3, [1, 1, 1]), (20, 3, [6, 6, 8]), (20, 11, [1] * 10 + [10])])
def test_the_manuals_rule_gives_the_last_picker_the_remainder(rows: int, pickers: int, counts: list[int]) -> None:
    assert [len(block.rows) for block in blocks_of("manual", rows, pickers)] == counts


def test_rows_are_balanced_unless_the_scenario_says_otherwise() -> None:
    assert rows_to_pickers(Scenario(rows=20, pickers=11)) == rows_to_pickers(Scenario(rows=20, pickers=11, rows_to_pickers="balanced"))
