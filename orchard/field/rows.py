"""The rules that give rows to pickers: functions of the `Scenario` that return {picker: Block}.

`orchard/field/layout.py` asks `rows_to_pickers`, which takes the rule that the scenario names.
Rows are numbered from 1 in the north. Rules say where to cut them: a cut is a list of the row
before the first block, which is 0, and then the last row of each block.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any, Literal, NamedTuple, get_args

from orchard.field.kinds import name_of
from orchard.field.picking import Absences, absences_of
from orchard.field.plugins import MISTAKES, contained, load_plugin, place_of_class, unusable
from orchard.field.scenario import BALANCED, BALANCED_ENDS, BALANCED_TIMES, MANUAL, Scenario

End = Literal["west", "east"]


@dataclass(frozen=True)
class Block:
    """The rows of a picker: neighbours, in the order in which it picks them.

    They go from north to south, because pickers go on southward only.
    """

    rows: tuple[int, ...]
    #: The end of the first row at which the picker starts. From there on it leaves its rows at
    #: either end in turn.
    start: End = "west"


def balanced(scenario: Scenario) -> dict[str, Block]:
    """Return neighbouring rows for each picker so that none has two more than another."""
    count = scenario.pickers
    return _cut(scenario, [scenario.rows * i // count for i in range(count + 1)])


def balanced_ends(scenario: Scenario) -> dict[str, Block]:
    """Return the blocks of `balanced`, of which every second one starts at the east end.

    So the roads on both sides are used from the beginning.
    """
    return _from_both_ends(balanced(scenario))


def balanced_times(scenario: Scenario) -> dict[str, Block]:
    """Return neighbouring rows for each picker so that the last picker is done as early as can be.

    The rule takes the lengths of rows, `picker_rates` and `picker_absences` into account, but not
    what the seed draws, which no grower knows before. Every second picker starts at the east end.
    """
    lengths = [scenario.row_length] * scenario.rows
    if scenario.survey is not None:
        lengths = [row.length for row in scenario.survey.rows]
    crew = []
    for name in _pickers(scenario):
        speed = scenario.mean_picking_speed * scenario.picker_rates.get(name, 1.0)
        crew.append(_Member(speed, absences_of(scenario, name)))
    return _from_both_ends(_cut(scenario, _shortest_cut(tuple(lengths), tuple(crew))))


def _from_both_ends(blocks: Mapping[str, Block]) -> dict[str, Block]:
    """Return blocks of which every second one starts at the east end."""
    from_both = {}
    start: End = "west"
    for name, block in blocks.items():
        from_both[name] = Block(block.rows, start)
        if start == "west":
            start = "east"
        else:
            start = "west"
    return from_both


class _Member(NamedTuple):
    """A picker: its mean speed while it picks, m/s, and when it is away."""

    speed: float
    absences: Absences

    def done(self, metres: float) -> float:
        """Return when it has picked so many metres, s since the harvest began."""
        done = metres / self.speed
        # In their order: an absence counts if it begins before the work is done, with all earlier
        # ones.
        for begin, end in self.absences:
            if begin < done:
                done += end - begin
        return done


@lru_cache(maxsize=64)
def _shortest_cut(lengths: tuple[float, ...], crew: tuple[_Member, ...]) -> list[int]:
    """Return the cut with which the last picker is done as early as can be.

    Of several such cuts it is that with the least sum of squared times, so that all pickers need
    about equally long. `lengths`: of the rows, m. There are at least as many rows as pickers.

    Pickers are taken one after another (dynamic programming). For each number of rows that the
    pickers so far may have, only the best cut is kept.
    """
    metres_before = [0.0, *accumulate(lengths)]
    rows = len(lengths)
    # Number of rows that the pickers so far have -> when the last of these pickers is done, s; the
    # sum of their squared times; the cut. Tuples are compared in this order.
    best: dict[int, tuple[float, float, list[int]]] = {0: (0.0, 0.0, [0])}
    for number, member in enumerate(crew, start=1):
        cuts: dict[int, tuple[float, float, list[int]]] = {}
        # At least a row is left for each picker that follows.
        for last in range(number, rows - len(crew) + number + 1):
            for last_before, (latest, squares, cut) in best.items():
                if last_before >= last:
                    continue
                done = member.done(metres_before[last] - metres_before[last_before])
                total = (max(latest, done), squares + done * done, [*cut, last])
                if last not in cuts or total < cuts[last]:
                    cuts[last] = total
        best = cuts
    _, _, shortest_cut = best[rows]
    return shortest_cut


def manual(scenario: Scenario) -> dict[str, Block]:
    """Return rows // pickers neighbouring rows for each picker, as the manual does.

    The last picker gets the remainder too.
    """
    share = scenario.rows // scenario.pickers
    return _cut(scenario, [*(i * share for i in range(scenario.pickers)), scenario.rows])


RULES: dict[str, Callable[[Scenario], dict[str, Block]]] = {
    BALANCED: balanced,
    BALANCED_ENDS: balanced_ends,
    MANUAL: manual,
    BALANCED_TIMES: balanced_times,
}


def rows_to_pickers(scenario: Scenario) -> dict[str, Block]:
    """Return the block of each picker by the rule that the scenario names.

    That is a built-in rule, or a user's function. For a picker the function may return a plain
    sequence of rows in place of a block; the picker then starts in the west. Raises ScenarioError
    for a function that cannot be used, or whose result breaks a rule of `_checked`.
    """
    key = "rows_to_pickers"
    path = scenario.rows_to_pickers
    if path in RULES:
        return RULES[path](scenario)
    rule = load_plugin(key, path)
    try:
        return _checked(contained(rule, scenario), scenario)
    except MISTAKES as error:
        wanted = "a function of the scenario that returns {picker: Block or rows}"
        raise unusable(key, path, error, wanted, place_of_class(rule)) from error


def _checked(result: Mapping[str, Any], scenario: Scenario) -> dict[str, Block]:
    """Return what a user's rule returned as blocks.

    Raises TypeError if it is no map with all pickers, and ValueError unless each row goes to one
    picker, each picker gets neighbouring rows in their order, and starts at an end that there is.
    """
    names = _pickers(scenario)
    if not isinstance(result, Mapping) or not set(names) <= set(result):
        keys = ", ".join(names)
        raise TypeError(f"it returned {result!r}; it must return a map with the keys {keys}")
    blocks = {}
    rows_of = {}
    all_rows: list[int] = []
    for name in names:
        block = _block_of(result[name])
        blocks[name] = block
        rows_of[name] = block.rows
        all_rows += block.rows
    is_complete = sorted(all_rows) == list(range(1, scenario.rows + 1))
    if not is_complete or not all(rows_of.values()):
        raise ValueError(
            f"{rows_of}: each row of 1 to {scenario.rows} must go to one picker, "
            "and each picker must get at least one"
        )
    if not all(_are_neighbours(rows) for rows in rows_of.values()):
        raise ValueError(
            f"{rows_of}: the rows of a picker must be neighbours, "
            "in their order from north to south"
        )
    wrong_starts = []
    for name, block in blocks.items():
        if block.start not in get_args(End):
            wrong_starts.append(f"{name} at {block.start!r}")
    if wrong_starts:
        wrong = ", ".join(wrong_starts)
        raise ValueError(f"a picker starts at the end 'west' or 'east', and not {wrong}")
    return blocks


def _block_of(given_rows: Any) -> Block:
    """Return a block, or plain rows, as a block of whole numbers.

    Users may give other numbers that stand for whole ones, as those of numpy. Raises ValueError for
    what is no whole number.
    """
    if isinstance(given_rows, Block):
        block = given_rows
    else:
        block = Block(given_rows)
    return Block(tuple(map(_whole, block.rows)), block.start)


def _whole(row: Any) -> int:
    """Return the number of a row. Raises ValueError if it is not whole, as 2.5 or "2"."""
    number = int(row)
    if number != row:
        raise ValueError(f"it returned the row {row!r}; rows are whole numbers from 1")
    return number


def _are_neighbours(rows: tuple[int, ...]) -> bool:
    return rows == tuple(range(rows[0], rows[-1] + 1))


def _cut(scenario: Scenario, cut: list[int]) -> dict[str, Block]:
    """Return a block for each picker.

    `cut`: the row before the first block, then the last row of each block.
    """
    blocks = {}
    for name, (row_before, last) in zip(_pickers(scenario), pairwise(cut), strict=True):
        blocks[name] = Block(tuple(range(row_before + 1, last + 1)))
    return blocks


def _pickers(scenario: Scenario) -> list[str]:
    return [name_of("picker", i + 1) for i in range(scenario.pickers)]
