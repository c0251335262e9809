"""A rule that gives rows to pickers: no picker has two rows more than another.

rows_to_pickers: examples.seams.even_rows.even_rows
"""


def even_rows(scenario):
    last = [scenario.rows * i // scenario.pickers for i in range(scenario.pickers + 1)]
    return {f"picker_{i + 1:02d}": tuple(range(last[i] + 1, last[i + 1] + 1)) for i in range(scenario.pickers)}
