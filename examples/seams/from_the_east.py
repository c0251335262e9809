"""A rule that gives rows to pickers: all start in the east, so first bins stand in the west.

rows_to_pickers: examples.seams.from_the_east.from_the_east
"""

from orchard import Block


def from_the_east(scenario):
    last = [scenario.rows * i // scenario.pickers for i in range(scenario.pickers + 1)]
    return {
        f"picker_{i + 1:02d}": Block(tuple(range(last[i] + 1, last[i + 1] + 1)), start="east")
        for i in range(scenario.pickers)
    }
