"""Many arrays as one argument of compiled functions.

A compiled function that gets many arrays is called slowly. So it gets their addresses as one array,
and opens them as fields (orchard/sim/kernels/arrays.py).
"""

import numpy as np
import pytest

from orchard.sim.kernels.arrays import ArrayRecord
from orchard.sim.kernels.jit import jit

# A record has a name for each array, its type and its number of dimensions.
ROW = np.dtype([("metres", np.float64), ("count", np.int64)])
RECORD = ArrayRecord({"rows": (ROW, 1), "grid": (np.int64, 2), "cube": (np.float64, 3)})
opens = RECORD.opens


@jit
def _change(addresses):
    """Change a value of `rows` and one of `cube`. Return the number of rows."""
    given = opens(addresses)
    given.rows[1].count += given.grid[1, 2] + given.grid.shape[0]
    given.cube[1, 0, 2] = given.rows[0].metres
    return len(given.rows)


def arrays() -> dict[str, np.ndarray]:
    rows = np.array([(0.5, 1), (2.0, 3)], ROW).view(np.recarray)
    grid = np.arange(6, dtype=np.int64).reshape(2, 3)
    return {"rows": rows, "grid": grid, "cube": np.zeros((2, 1, 3))}


def test_a_compiled_function_reads_and_writes_a_records_arrays() -> None:
    given = arrays()
    assert _change(RECORD.addresses(given)) == 2
    # 3 were there; the last value of the grid is 5, and it has 2 rows.
    assert given["rows"]["count"].tolist() == [1, 3 + 5 + 2]
    assert given["cube"].ravel().tolist() == [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]


def test_some_arrays_of_a_record_take_the_place_of_others() -> None:
    given = arrays()
    other = {"grid": np.full((3, 2), 7, np.int64)}
    assert _change(RECORD.addresses(other, RECORD.addresses(given))) == 2
    # The last value of the grid is 7 now, and it has 3 rows.
    assert given["rows"]["count"].tolist() == [1, 3 + 7 + 3]


@pytest.mark.parametrize(
    "wrong",
    [
        {"grid": np.zeros((2, 3))},
        {"grid": np.zeros(6, np.int64)},
        {"grid": np.zeros((3, 2), np.int64).T},
        {"rows": np.zeros(2)},
    ],
    ids=["another type", "a dimension too few", "another order in memory", "no records"],
)
def test_arrays_of_another_kind_are_refused(wrong: dict[str, np.ndarray]) -> None:
    (name,) = wrong
    with pytest.raises(ValueError, match=f"^{name}: this is no array of .* dimensions$"):
        RECORD.addresses(arrays() | wrong)
