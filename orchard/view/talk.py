"""Messages between bodies: an arc from the sender to the recipient for a few seconds, and the lines
of the event log.
"""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
from msgspec.structs import replace

from orchard.contract.events import Event
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.columns import Columns

MOST_LINES = (
    40  # arcs at once; arcs to carriers that are sent count more than to those that are asked
)
RENEWED_TICKS = 5  # interval at which the arcs follow the robots
REPEAT_TICKS = 300  # within it, a repeated message is not news
MOST_NAMES = 3  # in one line of the log
MOST_SAID = 10_000  # messages that are remembered, to find repeats
ARC_POINTS = 9  # of the line that draws an arc
WARNINGS, ERRORS = (
    ("collision", "refused", "stopped", "nothing recorded", "left out"),
    ("lost", "jam"),
)
ALARMS = dict.fromkeys(map(palette.plain, WARNINGS), "WARN") | dict.fromkeys(
    map(palette.plain, ERRORS), "ERROR"
)


def level_of(what: str) -> str:
    """Return the log level of an event word: DEBUG for frequent messages, WARN and ERROR for
    faults, INFO for the rest.
    """
    word = palette.plain(what)
    return "DEBUG" if word in palette.QUIET else ALARMS.get(word, "INFO")


def line_of(event: Event) -> str:
    """Return an event as one line, such as 'bin_01 > carrier_02: call, is a carrier free? row 3,
    east end'.
    """
    what, text = event.what, event.detail
    said = (
        text
        if not what or text.lower().startswith(what.lower())
        else f"{what}, {text}"
        if text
        else what
    )
    return f"{event.who} > {event.whom}: {said}" if event.whom else f"{event.who}: {said}"


def gathered(events: Sequence[Event]) -> list[Event]:
    """Return the events; each request to many, and replies from many, are merged into one ('14
    carriers').
    """
    said = [
        replace(alike[0], whom=_together([e.whom for e in alike]), detail=_text(alike))
        for alike in _alike(events, "who")
    ]
    return [
        replace(alike[0], who=_together([e.who for e in alike]), detail=_text(alike))
        for alike in _alike(said, "whom")
    ]


def _alike(events: Sequence[Event], end: str) -> list[list[Event]]:
    groups: dict[Hashable, list[Event]] = {}
    for event in events:
        is_said = palette.plain(event.what) in palette.TALK and event.whom
        groups.setdefault((event.what, getattr(event, end)) if is_said else event, []).append(event)
    return list(groups.values())


def _together(names: Sequence[str]) -> str:
    kinds = {name.rpartition("_")[0] for name in names}
    many = f"{len(names)} {kinds.pop() if len(kinds) == 1 else 'robot'}s"
    return many if len(names) > MOST_NAMES else ", ".join(names)


def _text(alike: Sequence[Event]) -> str:
    texts = dict.fromkeys(event.detail for event in alike)
    return "; ".join(texts) if len(texts) == 1 or len(alike) <= MOST_NAMES else ""


class Drawn(NamedTuple):
    """An arc that is shown now."""

    until: int  # tick
    start: int  # body
    end: int  # body
    look: palette.Arc


class Talk:
    """The arcs that are shown now."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        self.columns, self.index = columns, layout.index
        self._lines: list[Drawn] = []
        self._there = False
        self._renewed = -1  # the half second in which the arcs were last drawn
        self._said: dict[
            tuple[str, str, str, str], int
        ] = {}  # message -> tick in which it was last sent

    def is_news(self, tick: int, event: Event) -> bool:
        """Return whether the same event did not occur in the last 30 s.

        Agents repeat a request until it is answered.
        """
        if len(self._said) >= MOST_SAID:
            self._said = {}
        said = event.what, event.who, event.whom, event.detail
        last, self._said[said] = self._said.get(said), tick
        return last is None or tick - last > REPEAT_TICKS

    def forget(self) -> None:
        """Drop all arcs, after a gap.

        Those that are still shown are removed when arcs are next drawn.
        """
        self._there, self._lines = True, []

    def show(self, tick: int, poses: np.ndarray, news: Sequence[Event]) -> None:
        """Draw the arcs again if there is a new one, and every half second while there are any.

        `poses`: (n, 3).
        """
        fresh = [drawn for event in news if (drawn := self._drawn(tick, event))]
        if not fresh and tick // RENEWED_TICKS == self._renewed:
            return
        self._renewed = tick // RENEWED_TICKS
        self._lines = [line for line in self._lines + fresh if line.until > tick]
        seen = sorted(self._lines, key=lambda line: (-line.look.rank, -line.until))[:MOST_LINES]
        if seen or self._there:
            arcs = [_arc(poses[line.start], poses[line.end]) for line in seen]
            looks = [line.look for line in seen]
            self.columns.add(
                "talk",
                rr.LineStrips3D,
                strips=arcs,
                colors=[of.colour for of in looks],
                radii=[-of.radius for of in looks],
            )
            self._there = bool(seen)

    def _drawn(self, tick: int, event: Event) -> Drawn | None:
        look, start, end = (
            palette.TALK.get(palette.plain(event.what)),
            self.index.get(event.who),
            self.index.get(event.whom),
        )
        return (
            None
            if look is None or start is None or end is None
            else Drawn(tick + round(look.seconds / TIME_STEP), start, end, look)
        )


def _arc(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = np.linspace(0.0, 1.0, ARC_POINTS)[:, None]
    flat = start[:2] + along * (end[:2] - start[:2])
    rise = 0.05 * float(np.hypot(*(end[:2] - start[:2]))) + 1.0
    return np.concatenate([flat, 1.6 + 4 * rise * along * (1 - along)], axis=1).astype(np.float32)
