"""The machine as plain Python, over arrays that refuse a wrong index."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from plain_kernel import CheckedArray, kernel_functions, use_plain_python
from quiet import quiet_layouts

from orchard.event_model import columns as c
from orchard.event_model import harvest as harvests
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import entry, machine
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario

# Plain Python takes a hundred times as long as compiled code.
MOST_BINS = 12
QUIET = [layout for layout in quiet_layouts(seed=5, count=16) if layout.bins <= MOST_BINS]
EVENTFUL: dict[str, Any] = {
    "picking": {"failure": {"mean_between": 60.0, "mean_repair": 60.0}},
    "carrying": {
        "failure": {"mean_between": 200.0, "mean_repair": 60.0},
        "battery": {"hours": 0.3, "hours_to_charge": 0.05, "reserve": 0.9},
    },
    "people": {"workers": 3, "visitors": 1},
}
# What a harvest changes, and what it gives.
CHANGED = ("robots", "bins", "calls", "timers", "deliveries", "exchanges", "trips")


@pytest.fixture
def in_plain_python() -> Iterator[Callable[[Layout], EventHarvest]]:
    """Yield what does a harvest in plain Python."""

    def run(layout: Layout) -> EventHarvest:
        with pytest.MonkeyPatch.context() as patch:
            use_plain_python(patch)
            assert not list(kernel_functions(machine))
            return EventHarvest(layout).run()

    yield run
    assert vars(harvests)["run"] is entry.run


@pytest.mark.parametrize("layout", QUIET, ids=range(len(QUIET)))
def test_plain_python_does_the_same_and_breaks_no_bounds(
    layout: Layout, in_plain_python: Callable[[Layout], EventHarvest]
) -> None:
    assert_plain_is_compiled(layout, in_plain_python)


@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_plain_python_does_the_same_where_much_happens(
    dispatch: str, in_plain_python: Callable[[Layout], EventHarvest]
) -> None:
    values = EVENTFUL | {"rows": 6, "pickers": 3, "carriers": 3, "dispatch": dispatch}
    assert_plain_is_compiled(lay_out(Scenario(**values)), in_plain_python)


def assert_plain_is_compiled(
    layout: Layout, in_plain_python: Callable[[Layout], EventHarvest]
) -> None:
    """Compare all that a harvest changes."""
    plain = in_plain_python(layout)
    compiled = EventHarvest(layout).run()
    for name in CHANGED:
        assert_same(name, getattr(plain.model, name), getattr(compiled.model, name))


def assert_same(name: str, array: Any, other: Any) -> None:
    """Compare two arrays of a model, column by column."""
    if array.dtype.names is None:
        np.testing.assert_array_equal(array, other, name)
    for column in array.dtype.names or ():
        np.testing.assert_array_equal(array[column], other[column], f"{name}.{column}")


@pytest.mark.parametrize("index", [-1, 3, 1.0, c.NONE])
def test_an_index_that_is_no_row_is_refused(index: Any) -> None:
    array = CheckedArray([0, 1, 2], (3,), "i")
    with pytest.raises(AssertionError):
        array[index]
    with pytest.raises(AssertionError):
        array[index] = 1
