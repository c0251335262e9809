"""Tables that grow while plans are translated: rows of named columns, lists of places as bits, and
lines on which robots drive.
"""

from collections.abc import Iterable
from copy import copy
from itertools import repeat
from threading import RLock
from typing import Any

import numpy as np

from orchard.event_model import program_columns


class Table:
    """Rows of named columns, in an array that grows."""

    def __init__(self, columns: np.dtype[Any]) -> None:
        self._rows = np.zeros(256, columns)
        self._names = columns.names or ()
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def copy(self) -> "Table":
        """Return a table with the same rows, which grows alone."""
        table = copy(self)
        table._rows = self._rows.copy()
        return table

    def append(self, **values: Any) -> None:
        """Append a row. A column that is not named is 0."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        # A whole row at once: to set one column by its name costs as much as this.
        self._rows[self._count] = tuple(map(values.get, self._names, repeat(0)))
        self._count += 1

    def extend(self, rows: np.ndarray) -> None:
        """Append some rows."""
        last = self._count + len(rows)
        while last > len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count : last] = rows
        self._count = last

    @property
    def plain(self) -> np.ndarray:
        """The rows alone, of which columns are read by `array["name"]`."""
        return self._rows[: self._count]

    @property
    def array(self) -> np.ndarray:
        """The rows, with space behind them. When a row is appended it may become another array."""
        return self._rows.view(np.recarray)


class PlaceLists:
    """Lists of places, each a row of bits. The list 0 is empty."""

    def __init__(self, most: int) -> None:
        """`most`: places that there may be."""
        # Harvests in several threads may share a program, which grows.
        self._lock = RLock()
        self._most = most
        # Words of 64 bits of a list, rounded up.
        self.words = -(-most // 64)
        # The name of a place -> its bit.
        self.bits: dict[str, int] = {}
        self._numbers: dict[tuple[str, ...], int] = {}
        self._rows = np.zeros((64, self.words), np.uint64)
        self.number_of([])

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the lock, which is of this process."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a copy, with a lock of its own."""
        vars(self).update(state)
        self._lock = RLock()

    def copy(self) -> "PlaceLists":
        """Return the same lists, to which others can be added alone."""
        lists = copy(self)
        lists.bits = dict(self.bits)
        lists._numbers = dict(self._numbers)
        lists._rows = self._rows.copy()
        return lists

    def __len__(self) -> int:
        return len(self._numbers)

    @property
    def array(self) -> np.ndarray:
        """The lists, (lists, words) bits, with space behind them."""
        return self._rows

    def names_of(self, number: int) -> tuple[str, ...]:
        """Return the names in a list."""
        return list(self._numbers)[number]

    def number_of(self, places: Iterable[str]) -> int:
        """Return the number of a list. Raises NotImplementedError for too many places."""
        key = tuple(sorted(set(places)))
        number = self._numbers.get(key)
        if number is not None:
            return number
        with self._lock:
            if key not in self._numbers:
                self._note(key)
            return self._numbers[key]

    def _note(self, key: tuple[str, ...]) -> None:
        """Note the places of a new list, and number it when all is noted: others may look."""
        number = len(self._numbers)
        if number == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        for place in key:
            word, bit = divmod(_number(self.bits, place, self._most), 64)
            self._rows[number, word] |= np.uint64(1 << bit)
        self._numbers[key] = number


class Lines:
    """Lines on which robots drive, each in one direction."""

    def __init__(self, most: int) -> None:
        """`most`: lines that there may be."""
        self.most = most
        self._rows = Table(program_columns.LINE)
        self._numbers: dict[tuple[int, float, int], int] = {}

    def copy(self) -> "Lines":
        """Return the same lines, to which others can be added alone."""
        lines = copy(self)
        lines._rows = self._rows.copy()
        lines._numbers = dict(self._numbers)
        return lines

    @property
    def array(self) -> np.ndarray:
        """The rows, with space behind them."""
        return self._rows.array

    def number_of(self, axis: int, other: float, sign: int) -> int:
        """Return the number of the line along an axis, at its other coordinate, in a direction.

        Raises NotImplementedError for too many lines.
        """
        key = (axis, round(other, 3), sign)
        is_new = key not in self._numbers
        number = _number(self._numbers, key, self.most)
        if is_new:
            self._rows.append(axis=axis, other=key[1], sign=sign)
        return number


def _number(numbers: dict[Any, int], key: Any, most: int) -> int:
    if key not in numbers and len(numbers) == most:
        raise NotImplementedError(
            f"the event model knows {most} places, or lines on which robots drive, and no more"
        )
    return numbers.setdefault(key, len(numbers))
