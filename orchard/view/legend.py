"""What the colours mean: a strip of words, each in its colour, for robots' pins and for the arcs between those who speak."""

import rerun as rr

from orchard.view import palette

LEGEND = "legend"
LETTER, GAP, LINE = 6.4, 16.0, 36.0  # points of the screen, about: a letter's width, what is between two words, a line's height
TALK = {"asked": "call", "answered": "offer", "sent": "come", "told": "here"}  # words of the legend -> events


def entries() -> list[tuple[str, palette.Colour]]:
    """The words and their colours."""
    talk = [(word, palette.TALK[said].colour) for word, said in TALK.items()]
    return [("A pin:", palette.WIRE), *palette.STATES.items(), ("An arc:", palette.WIRE), *talk]


def places() -> list[float]:
    """The middle of each word, from the left."""
    middles, x = [], GAP / 2
    for word, _ in entries():
        middles.append(x + LETTER * len(word) / 2)
        x += LETTER * len(word) + GAP
    return middles


def size() -> tuple[float, float]:
    """Width and height of the strip."""
    word, _ = entries()[-1]
    return places()[-1] + LETTER * len(word) / 2 + GAP / 2, LINE


def log_legend(rec: rr.RecordingStream) -> None:
    """Once: it is the same in every recording."""
    words, colours = zip(*entries(), strict=True)
    middles = [(x, 0.38 * LINE) for x in places()]
    radii = [0.01 if word.endswith(":") else -5.0 for word in words]
    rec.log(LEGEND, rr.Points2D(middles, labels=words, colors=colours, radii=radii, show_labels=True), static=True)
