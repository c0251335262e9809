"""The legend of a recording: two lines of words below the views, each beside a mark in the colour
that it explains.
"""

from typing import NamedTuple

import rerun as rr

from orchard.view import palette
from orchard.view.palette import Colour

LEGEND = "legend"
LETTER, GAP, MARK, LINE = (
    7.0,
    30.0,
    9.0,
    26.0,
)  # screen points: of a letter; between words; of a mark; of a line
RISE = 12.0  # screen points: Rerun writes a label this far below its point
HEADING: Colour = (200, 200, 205)


Form = list[tuple[float, float]]  # the corners of a mark, in units of its width
FORMS: dict[str, Form] = {
    "line": [(0.0, 0.0), (1.2, 0.0)],
    "flag": [(0.2, 0.8), (0.2, -0.7), (1.2, -0.3), (0.2, 0.1)],
}


ARCS = {
    "asked": "call",
    "answered": "offer",
    "sent": "come",
    "told": "here",
}  # words of the legend -> events
SCANS = {**palette.SCANS, "others": palette.OTHER_SCANS}
LINES: tuple[
    tuple[tuple[str, Colour, str], ...], ...
] = (  # words, each with its colour and its mark: "dot", "line", "flag" or none
    (("Pin:", HEADING, ""), *((state, colour, "dot") for state, colour in palette.STATES.items())),
    (
        ("Arc, a message:", HEADING, ""),
        *((word, palette.TALK[said].colour, "line") for word, said in ARCS.items()),
        ("Laser hits:", HEADING, ""),
        *((kind, colour, "dot") for kind, colour in SCANS.items()),
        ("full bin", palette.YELLOW, "flag"),
        ("bay, queue", palette.PAINT, "line"),
    ),
)


class Placed(NamedTuple):
    """A word and where it stands, screen points from the legend's top left."""

    word: str
    colour: Colour
    mark: str
    x: float  # of the left end
    y: float  # of the middle
    middle: float  # x of the middle of the word, which is to the right of its mark


def _placed() -> tuple[list[Placed], float]:
    """Return all words, and the width of the legend."""
    found, widest = [], 0.0
    for number, line in enumerate(LINES):
        x = GAP / 2
        for word, colour, mark in line:
            begin, width = x + (2 * MARK if mark else 0.0), LETTER * len(word)
            found.append(Placed(word, colour, mark, x, (number + 0.5) * LINE, begin + width / 2))
            x = begin + width + GAP
        widest = max(widest, x - GAP / 2)
    return found, widest


PLACED, WIDTH = _placed()
HEIGHT = LINE * len(LINES)  # screen points


def log_legend(rec: rr.RecordingStream) -> None:
    """Log the legend once. It is the same in every recording."""
    words, colours = [place.word for place in PLACED], [place.colour for place in PLACED]
    labels = [(place.middle, place.y - RISE) for place in PLACED]
    rec.log(
        LEGEND,
        rr.Points2D(labels, labels=words, colors=colours, radii=[0.01], show_labels=True),
        static=True,
    )
    dots = [place for place in PLACED if place.mark == "dot"]
    middles, hues = (
        [(place.x + MARK / 2, place.y) for place in dots],
        [place.colour for place in dots],
    )
    rec.log(f"{LEGEND}/dots", rr.Points2D(middles, colors=hues, radii=[-MARK / 2]), static=True)
    for mark, form in FORMS.items():
        marked = [place for place in PLACED if place.mark == mark]
        strips = [[(place.x + MARK * x, place.y + MARK * y) for x, y in form] for place in marked]
        hues = [place.colour for place in marked]
        rec.log(
            f"{LEGEND}/{mark}s", rr.LineStrips2D(strips, colors=hues, radii=[-1.5]), static=True
        )
