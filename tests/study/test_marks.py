"""What explains the table of a study, and the intervals of its picture."""

from made_studies import a_result, a_row, carriers, interval

from orchard.study.picture import half_widths
from orchard.study.table import legend


def test_the_legend_explains_the_marks_of_settings():
    """The legend explains the marks of settings that are compared."""
    rows = [a_row(10.0, setting=carriers(1)), a_row(20.0, setting=carriers(2))]
    text = legend(a_result(rows, carriers(2)))
    assert text.startswith("* the answer; = within 2 % of the best")
    assert "behind: how far behind the best mean" in text


def test_the_bars_of_a_picture_reach_from_the_mean_to_both_ends():
    """The interval is 10 ± 2. Matplotlib takes the lengths of all bars below, and then above."""
    assert half_widths([interval(10.0, 2.0)]).tolist() == [[2.0], [2.0]]
