"""A rule that gives rows to pickers: every picker starts at the east end, so the first bins are fetched on the west side.

rows_to_pickers: examples.seams.from_the_east.from_the_east
"""

from orchard import Block


def from_the_east(scenario):
    last = [scenario.rows * i // scenario.pickers for i in range(scenario.pickers + 1)]
    return {
        f"picker_{i + 1:02d}": Block(tuple(range(last[i] + 1, last[i + 1] + 1)), start="east")
        for i in range(scenario.pickers)
    }
