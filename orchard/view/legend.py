"""The legend of a recording: two lines of words below the views, each beside a mark in the colour
that it explains.
"""

from collections.abc import Sequence
from typing import NamedTuple

import rerun as rr

from orchard.view import palette
from orchard.view.palette import Colour

LEGEND = "legend"
# All that follows is in screen points.
LETTER = 7.0  # Width of a letter.
GAP = 30.0  # Between words.
MARK = 9.0  # Width of a mark.
LINE = 26.0  # Height of a line.
RISE = 12.0  # Rerun writes a label this far below its point.

HEADING: Colour = (200, 200, 205)


#: The corners of a mark, in units of its width.
Form = list[tuple[float, float]]
FORMS: dict[str, Form] = {
    "line": [(0.0, 0.0), (1.2, 0.0)],
    "flag": [(0.2, 0.8), (0.2, -0.7), (1.2, -0.3), (0.2, 0.1)],
}


# Words of the legend -> events.
ARCS = {
    "asked": "call",
    "answered": "offer",
    "sent": "come",
    "told": "here",
}
SCANS = {**palette.SCANS, "others": palette.OTHER_SCANS}


class Word(NamedTuple):
    """A word of the legend, and what it explains: a colour, with a mark or as it is."""

    text: str
    colour: Colour
    mark: str = ""  # "dot", "line", "flag" or none


LINES: tuple[tuple[Word, ...], ...] = (
    (
        Word("Pin:", HEADING),
        *(Word(state, colour, "dot") for state, colour in palette.STATES.items()),
    ),
    (
        Word("Arc, a message:", HEADING),
        *(Word(text, palette.TALK[event].colour, "line") for text, event in ARCS.items()),
        Word("Laser hits:", HEADING),
        *(Word(kind, colour, "dot") for kind, colour in SCANS.items()),
        Word("full bin", palette.YELLOW, "flag"),
        Word("bay, queue", palette.PAINT, "line"),
    ),
)


class Placed(NamedTuple):
    """A word and where it stands, screen points from the legend's top left.

    `x`: of the left end. `y`: of the middle. `middle`: x of the middle of the word, which is to the
    right of its mark.
    """

    word: Word
    x: float
    y: float
    middle: float


def _placed() -> tuple[list[Placed], float]:
    """Return all words, and the width of the legend."""
    placed = []
    widest = 0.0
    for number, line in enumerate(LINES):
        x = GAP / 2
        y = (number + 0.5) * LINE
        for word in line:
            begin = x
            if word.mark:
                # A mark, and as much room after it.
                begin += 2 * MARK
            width = LETTER * len(word.text)
            placed.append(Placed(word, x, y, begin + width / 2))
            x = begin + width + GAP
        widest = max(widest, x - GAP / 2)
    return placed, widest


PLACED, WIDTH = _placed()
# Screen points.
HEIGHT = LINE * len(LINES)


def log_legend(rec: rr.RecordingStream) -> None:
    """Log the legend once. It is the same in every recording."""
    words = rr.Points2D(
        [(place.middle, place.y - RISE) for place in PLACED],
        labels=[place.word.text for place in PLACED],
        colors=_colours(PLACED),
        radii=[0.01],
        show_labels=True,
    )
    rec.log(LEGEND, words, static=True)
    dots = _with_mark("dot")
    middles = [(place.x + MARK / 2, place.y) for place in dots]
    # Rerun takes negative radii for screen points.
    points = rr.Points2D(middles, colors=_colours(dots), radii=[-MARK / 2])
    rec.log(f"{LEGEND}/dots", points, static=True)
    for mark, form in FORMS.items():
        marked = _with_mark(mark)
        strips = [_strip(place, form) for place in marked]
        lines = rr.LineStrips2D(strips, colors=_colours(marked), radii=[-1.5])
        rec.log(f"{LEGEND}/{mark}s", lines, static=True)


def _colours(placed: Sequence[Placed]) -> list[palette.Colour]:
    """Return the colours of words."""
    return [place.word.colour for place in placed]


def _with_mark(mark: str) -> list[Placed]:
    """Return the words that have this mark."""
    return [place for place in PLACED if place.word.mark == mark]


def _strip(place: Placed, form: Form) -> Form:
    """Return the corners of a word's mark, screen points from the legend's top left."""
    return [(place.x + MARK * x, place.y + MARK * y) for x, y in form]
