"""The machine of the event model as plain Python does the same as compiled code.

It runs twice: over arrays that refuse a wrong index (`plain_kernel`), and as the program runs it
until the machine is compiled (`PlainMachine`).
"""

from typing import Any

import numpy as np
import pytest
from plain_kernel import CheckedArray, run_checked
from quiet import quiet_layouts

from orchard.event_model import codes as c
from orchard.event_model import start
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.plain import PlainMachine
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario

# Plain Python takes a hundred times as long as compiled code: only harvests of few bins are done.
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


@pytest.mark.parametrize("layout", QUIET, ids=range(len(QUIET)))
def test_plain_python_does_the_same_and_breaks_no_bounds(layout: Layout) -> None:
    assert_is_compiled(layout, EventHarvest(layout, carry_on=run_checked))


@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_plain_python_does_the_same_where_much_happens(dispatch: str) -> None:
    layout = eventful(dispatch)
    assert_is_compiled(layout, EventHarvest(layout, carry_on=run_checked))


@pytest.mark.parametrize("layout", QUIET[:4], ids=range(4))
def test_the_plain_machine_does_the_same(layout: Layout) -> None:
    assert_is_compiled(layout, EventHarvest(layout, carry_on=PlainMachine()))


@pytest.mark.parametrize("dispatch", ["nearest", "predictive", "rolling"])
def test_the_plain_machine_does_the_same_where_much_happens(dispatch: str) -> None:
    layout = eventful(dispatch)
    assert_is_compiled(layout, EventHarvest(layout, carry_on=PlainMachine()))


def test_the_plain_machine_sees_jobs_that_are_translated_later() -> None:
    """At the start only those parts of the program are translated that wait for no order."""
    start._prepared.cache_clear()
    layout = eventful("nearest")
    plain = EventHarvest(layout, free_roads=True, carry_on=PlainMachine()).run()
    assert plain.delivered == layout.bins


def eventful(dispatch: str) -> Layout:
    """Return a layout in which something of each kind happens."""
    values = EVENTFUL | {"rows": 6, "pickers": 3, "carriers": 3, "dispatch": dispatch}
    return lay_out(Scenario(**values))


def assert_is_compiled(layout: Layout, plain: EventHarvest) -> None:
    """Compare all that a harvest in plain Python changes."""
    plain.run()
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
