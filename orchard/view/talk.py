"""Who speaks to whom: arcs between the two for a few seconds, and the log of events."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from orchard.layout import Layout
from orchard.view import palette

SHOWN_TICKS = 30  # how long a line stays
RENEWED_TICKS = 5  # how often the lines follow the robots
BEADS = 9
ALARMS = {"collision": "WARN", "refused": "WARN", "lost": "ERROR", "jam": "ERROR"}


def level_of(what: str) -> str:
    """DEBUG for what is said all the time, WARN and ERROR for what should not be, INFO for the rest."""
    return "DEBUG" if what.lower() in palette.QUIET else ALARMS.get(what.lower(), "INFO")


def line_of(what: str, who: str, whom: str, text: str) -> str:
    """An event as one line: 'bin_01 > carrier_02: call, lane 3 east'."""
    said = text if not what or text.lower().startswith(what.lower()) else f"{what}, {text}" if text else what
    return f"{who} > {whom}: {said}" if whom else f"{who}: {said}"


class Talk:
    """The arcs that are to be seen now."""

    def __init__(self, rec: rr.RecordingStream, layout: Layout) -> None:
        self.rec, self.index = rec, layout.index
        self._lines: list[tuple[int, int, int, palette.Colour]] = []  # until tick, from body, to body, colour
        self._drawn = False

    def hear(self, tick: int, events: Sequence[tuple[str, str, str, str]]) -> None:
        for what, who, whom, _ in events:
            colour = palette.TALK.get(what.lower())
            if colour and what.lower() not in palette.QUIET and who in self.index and whom in self.index:
                self._lines.append((tick + SHOWN_TICKS, self.index[who], self.index[whom], colour))

    def show(self, tick: int, poses: np.ndarray, fresh: bool) -> None:
        """Draw the arcs anew when there is a `fresh` one, and every half second while there are any."""
        if not fresh and tick % RENEWED_TICKS:
            return
        self._lines = [line for line in self._lines if line[0] > tick]
        if self._lines or self._drawn:
            arcs = [_arc(poses[a], poses[b]) for _, a, b, _ in self._lines]
            colours = [colour for *_, colour in self._lines]
            self.rec.log("talk", rr.LineStrips3D(arcs, colors=colours, radii=[0.12]))
            self._drawn = bool(self._lines)


def _arc(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(BEADS, 3): from above one body to above the other, higher the further they are apart."""
    along = np.linspace(0.0, 1.0, BEADS)[:, None]
    flat = start[:2] + along * (end[:2] - start[:2])
    rise = 0.12 * float(np.hypot(*(end[:2] - start[:2]))) + 1.0
    return np.concatenate([flat, 1.6 + 4 * rise * along * (1 - along)], axis=1).astype(np.float32)
