"""What a command says, in the words of the page: no key of a file, and no option."""

import pytest

from orchard.app.page_words import in_page_words, with_labels
from orchard.study.result import Interval
from orchard.study.sensitivity.result import Effect, SensitivityResult

ALL = Interval(mean=1.0, low=0.9, high=1.0)
NONE = Interval(mean=0.0, low=0.0, high=0.0)

# A line of a command, and what the page says.
LINES = [
    (
        "--finish-within 0.5h: no fleet finishes within 0.5 h of work; or a higher picking_rate",
        "Done within: no fleet finishes within 0.5 h of work; or a higher “Bins an hour each”",
    ),
    ("--finish-by 2d: no fleet finishes", "Done within: no fleet finishes"),
    (
        "the fast model alone answers; --model full asks the simulator",
        "the fast model alone answers",
    ),
    ("there was no time for row_width=4", "there was no time for “Spacing of rows”=4"),
    ("Ended by --duration after 4:00 min", "Ended by “End after” after 4:00 min"),
    ("command line: carriers = 1: 1 cannot be taken away", "carriers = 1: 1 cannot be taken away"),
    ("wait: of pickers, for an empty bin", "wait: of pickers, for an empty bin"),
]


@pytest.mark.parametrize(("line", "words"), LINES, ids=[line[:20] for line, _ in LINES])
def test_a_line_of_a_command_has_labels_of_the_form(line, words):
    assert in_page_words(line) == words


def test_what_a_result_hangs_on_has_labels_of_the_form():
    """The answer, the notes, and the keys from which table and picture are made."""
    rate = Effect(
        key="picking_rate", low=1.2, high=1.8, at_low=1.9, at_high=2.8, first_order=ALL, total=ALL
    )
    crop = Effect(
        key="crop.tonnes_per_hectare",
        low=32.0,
        high=44.0,
        at_low=2.3,
        at_high=2.3,
        first_order=NONE,
        total=NONE,
    )
    result = SensitivityResult(
        answer="comes from picking rate",
        orchard="3 rows",
        goal="bins_per_hour",
        horizon="harvest",
        within=0.02,
        confidence=0.95,
        effects=[rate, crop],
        mean=2.3,
        spread=Interval(mean=2.3, low=1.9, high=2.8),
        luck=NONE,
        unfitted=NONE,
        fit=1.0,
        points=64,
        points_asked=64,
        runs=128,
        jammed=[],
        stopped_by="certain",
        wall_seconds=1.0,
        scenario={},
        version="1",
        notes=["these move the mean by less than 2 %: crop tonnes per hectare"],
    )
    labelled = with_labels(result)
    assert "comes from Bins an hour each (1.2 to 1.8)" in labelled.answer
    assert labelled.notes == ["these move the mean by less than 2 %: Yield"]
    assert [effect.key for effect in labelled.effects] == ["Bins an hour each", "Yield"]
