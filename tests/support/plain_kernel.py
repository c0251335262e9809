"""The machine of the event model as plain Python, over arrays that check each index and value.

Compiled code checks nothing: an index past an array's end reads what lies there, and a negative one
the array's end. Here both are refused, and so is a value that its column cannot hold.
"""

from typing import Any

import numpy as np

from orchard.event_model import columns
from orchard.event_model.kernel import machine
from orchard.event_model.plain import functions

_run = functions(machine.__name__, {})["run"]


def run_checked(model: columns.Model, until: int) -> Any:
    """Carry a harvest on, as the compiled machine does, over checked arrays."""
    arrays = {name: getattr(model, name) for name in columns.ARRAYS}
    checked = model._replace(**{name: _checked(array) for name, array in arrays.items()})
    reason = _run(checked, until)
    for name, array in arrays.items():
        _write_back(getattr(checked, name), array)
    return reason


def _checked(array: np.ndarray) -> "CheckedArray":
    """Return a checked copy of an array of numbers, or of rows with named columns."""
    if array.dtype.names is None:
        return CheckedArray(array.tolist(), array.shape, array.dtype.kind)
    kinds: dict[str, str] = {name: array.dtype[name].kind for name in array.dtype.names}
    return CheckedArray(_rows(array, kinds), array.shape, "")


def _rows(array: np.ndarray, kinds: dict[str, str]) -> list[Any]:
    if array.ndim > 1:
        return [_rows(part, kinds) for part in array]
    return [CheckedRow(kinds, row) for row in array.tolist()]


def _write_back(checked: "CheckedArray", array: np.ndarray) -> None:
    """Copy what the machine has changed into the array of the harvest."""
    if array.dtype.names is None:
        array[...] = np.array(checked.items, array.dtype).reshape(array.shape)
        return
    if array.ndim > 1:
        # The only rows in two dimensions are the random draws, which no harvest changes.
        return
    for number, row in enumerate(checked.items):
        array[number] = tuple(row.values.values())


class CheckedArray:
    """An array of numbers or rows, which refuses indices that are not in it.

    Like an array of numpy, it shares its items with its parts: `array[2][0] = 5` changes `array`.
    """

    def __init__(self, items: list[Any], shape: tuple[int, ...], kind: str) -> None:
        """`items`: lists in lists, of this shape. `kind`: `dtype.kind` of numbers; "" for rows."""
        self.items = items
        self.shape = shape
        self.kind = kind

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, tuple):
            item = self.items
            for length, number in zip(self.shape, index, strict=False):
                item = item[_checked_index(number, length)]
            inner = self.shape[len(index) :]
            return CheckedArray(item, inner, self.kind) if inner else item
        item = self.items[_checked_index(index, self.shape[0])]
        if len(self.shape) > 1:
            return CheckedArray(item, self.shape[1:], self.kind)
        return item

    def __setitem__(self, index: Any, value: Any) -> None:
        if index == slice(None):
            for number in range(len(self)):
                if len(self.shape) > 1:
                    self[number][:] = value
                else:
                    self[number] = value
        elif isinstance(index, tuple):
            *first, last = index
            self[tuple(first) if len(first) > 1 else first[0]][last] = value
        else:
            assert len(self.shape) == 1, "an array is assigned to a part of another one"
            self.items[_checked_index(index, self.shape[0])] = _checked_value(value, self.kind)


class CheckedRow:
    """A row of named columns."""

    values: dict[str, Any]

    def __init__(self, kinds: dict[str, str], values: tuple[Any, ...]) -> None:
        """`kinds`: the name of each column, in order, and its `dtype.kind`."""
        # An assignment to `self.kinds` would be one to a column: see `__setattr__`.
        vars(self)["kinds"] = kinds
        vars(self)["values"] = dict(zip(kinds, values, strict=True))

    def __getattr__(self, name: str) -> Any:
        return self.values[name]

    def __setattr__(self, name: str, value: Any) -> None:
        self.values[name] = _checked_value(value, vars(self)["kinds"][name])


def _checked_index(index: Any, length: int) -> int:
    assert isinstance(index, int), f"{index} is no index"
    assert 0 <= index < length, f"there are {length} rows, and none is {index}"
    return index


def _checked_value(value: Any, kind: str) -> Any:
    if kind == "f":
        return float(value)
    assert isinstance(value, int), f"{value} is no whole number"
    # Unsigned columns hold sets of places, a bit for each. They may use all 64 bits.
    assert kind != "u" or value >= 0, f"{value} is no set of places"
    assert abs(value) < 2**63 or kind == "u", f"{value} is too large"
    return bool(value) if kind == "b" else value
