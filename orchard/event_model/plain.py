"""The machine as plain Python: the same functions over lists, for harvests that shall not wait
until it is compiled, which takes 40 s.

An event takes some 30 to 80 µs, where compiled code takes less than one. Both do the same to the
last bit.
"""

import sys
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from types import FunctionType
from typing import Any

import numpy as np

from orchard.event_model import columns
from orchard.event_model.harvest import CarryOn
from orchard.event_model.kernel import entry, machine

# Arrays in which no row changes once a harvest has used it. A row is read when it is first needed.
CONSTANT = (
    "ops",
    "needs",
    "frees",
    "places",
    "lines",
    "passes",
    "ends",
    "ways",
    "speeds",
    "failures",
    "absences",
    "encounters",
    "looks",
)
CHANGED = tuple(name for name in columns.ARRAYS if name not in CONSTANT)
# Module -> what its functions find by name: these functions as plain Python, and all else.
Namespaces = dict[str, dict[str, Any]]


def machine_at_hand() -> CarryOn:
    """Return the compiled machine if it need not be compiled first; else the plain one."""
    return entry.run if entry.is_ready() else PlainMachine()


def functions(module: str, made: Namespaces) -> dict[str, Any]:
    """Return what a module of the kernel holds, its functions as plain Python.

    `made`: what modules hold of which this was done before. It is filled.
    """
    if module in made:
        return made[module]
    # It is entered before it is complete, because modules may use each other.
    names = made[module] = dict(vars(sys.modules[module]))
    for name, value in list(names.items()):
        if hasattr(value, "py_func"):
            python = value.py_func
            names[name] = FunctionType(python.__code__, functions(python.__module__, made), name)
    return names


@cache
def as_python(function: Any) -> Callable[..., Any]:
    """Return a function of the kernel as plain Python with all that it calls, for single calls on
    a model's arrays.
    """
    python = function.py_func
    plain: Callable[..., Any] = functions(python.__module__, {})[python.__name__]
    return plain


@cache
def _plain_run() -> Any:
    """Return `machine.run` as plain Python."""
    # All functions of the machine find the faster `_next_event` in place of their own.
    names = functions(machine.__name__, {})
    names["next_event"] = _next_event
    return names["run"]


class PlainMachine:
    """Carries one harvest on, as `kernel.entry.run` does."""

    def __init__(self) -> None:
        # Of each array of CONSTANT the one that was read last, and its rows.
        self._constant: dict[str, tuple[np.ndarray, RowsAsRead]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return a machine that has read nothing: what it has read stands in the arrays."""
        return {"_constant": {}}

    def __call__(self, model: columns.Model, until: int) -> int:
        """Carry a harvest on to a time, exclusive, and return why it stopped."""
        lists = {name: _as_lists(getattr(model, name)) for name in CHANGED}
        for name in CONSTANT:
            lists[name] = self._rows(name, getattr(model, name))
        reason: int = _plain_run()(model._replace(**lists), until)
        for name in CHANGED:
            _write(lists[name], getattr(model, name))
        return reason

    def _rows(self, name: str, array: np.ndarray) -> "RowsAsRead":
        """Return the rows of a constant array: the same ones while it is the same array."""
        known = self._constant.get(name)
        if known is None or known[0] is not array:
            known = self._constant[name] = (array, RowsAsRead(array))
        return known[1]


def _next_event(model: Any) -> tuple[int, int]:
    """Return as `machine.next_event`: Python finds the least of a list at once."""
    times = model.timers.lists
    soonest = min(map(min, times))
    for kind, of_robots in enumerate(times):
        if soonest in of_robots:
            return kind, of_robots.index(soonest)
    return 0, 0


class RowsAsRead(dict[Any, Any]):
    """An array of which each row is read when it is first asked for, by its index or indices."""

    def __init__(self, array: np.ndarray) -> None:
        self.shape = array.shape
        self._array = array.view(np.ndarray)

    def __missing__(self, index: Any) -> Any:
        """Read a row, or an item."""
        item = self._array[index]
        if self._array.dtype.names is None:
            row = item.tolist()
        else:
            row = _row_class(self._array.dtype)(item.tolist())
        self[index] = row
        return row


class ListGrid:
    """An array in several dimensions, as lists of lists."""

    __slots__ = ("lists", "shape")

    def __init__(self, array: np.ndarray) -> None:
        self.lists = array.tolist()
        self.shape = array.shape

    def __getitem__(self, index: Any) -> Any:
        item = self.lists
        for number in index if isinstance(index, tuple) else (index,):
            item = item[number]
        return item

    def __setitem__(self, index: Any, value: Any) -> None:
        """Set an item; by a slice, all items of two dimensions."""
        if isinstance(index, slice):
            for row in self.lists:
                row[:] = [value] * len(row)
            return
        item = self.lists
        for number in index[:-1]:
            item = item[number]
        item[index[-1]] = value


@cache
def _row_class(dtype: np.dtype[Any]) -> Any:
    """Return the class of an array's rows."""
    names = dtype.names or ()

    def fill(row: Any, values: tuple[Any, ...]) -> None:
        """Set the columns of a new row."""
        for name, value in zip(names, values, strict=True):
            setattr(row, name, value)

    return type("Row", (), {"__slots__": names, "__init__": fill})


def _as_lists(array: np.ndarray) -> Any:
    """Return an array as lists, its rows as objects."""
    plain = array.view(np.ndarray)
    if plain.dtype.names is not None:
        row = _row_class(plain.dtype)
        return [row(values) for values in plain.tolist()]
    return plain.tolist() if plain.ndim == 1 else ListGrid(plain)


def _write(lists: Any, array: np.ndarray) -> None:
    """Write lists back to the array of which they are."""
    plain = array.view(np.ndarray)
    if plain.dtype.names is not None:
        values = attrgetter(*plain.dtype.names)
        plain[:] = [values(row) for row in lists]
    else:
        plain[...] = lists.lists if isinstance(lists, ListGrid) else lists
