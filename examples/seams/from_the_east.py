"""A rule that gives rows to pickers: all start in the east, so first bins stand in the west.

rows_to_pickers: examples.seams.from_the_east.from_the_east
"""

from orchard import Block


def from_the_east(scenario):
    blocks = {}
    last = 0
    for number in range(1, 1 + scenario.pickers):
        first = last + 1
        # So each picker has as many rows as any other one, or one more.
        last = scenario.rows * number // scenario.pickers
        rows = tuple(range(first, last + 1))
        blocks[f"picker_{number:02d}"] = Block(rows, start="east")
    return blocks
