"""Messages between bodies: an arc from the sender to the recipient for a few seconds, and the lines
of the event log.
"""

from collections.abc import Hashable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
from msgspec.structs import replace

from orchard.contract.events import Event
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.columns import Columns

# Arcs at once. Those to carriers that are sent count more than those to carriers that are asked.
MOST_ARCS = 40
# Ticks after which the arcs follow the robots.
RENEWED_TICKS = 5
# A message that is repeated within this time is not news.
REPEAT_TICKS = 300
# Names in one line of the log.
MOST_NAMES = 3
# Messages that are remembered, to find repeats. Beyond that all are forgotten.
MOST_REMEMBERED = 10_000
# Points of the line that draws an arc.
ARC_POINTS = 9
# m above the ground at which an arc begins and ends: above pickers, carriers and bins.
ARC_Z = 1.6
# m by which its middle is higher, and by which it is higher for each metre between its ends.
LEAST_RISE = 1.0
RISE_PER_METRE = 0.05
WARNINGS = ("collision", "refused", "stopped", "nothing recorded", "left out")
ERRORS = ("lost", "jam")
LEVELS = {
    **dict.fromkeys(palette.QUIET, "DEBUG"),
    **dict.fromkeys(map(palette.plain, WARNINGS), "WARN"),
    **dict.fromkeys(map(palette.plain, ERRORS), "ERROR"),
}


def level_of(event_word: str) -> str:
    """Return the log level of an event word: DEBUG for frequent messages, WARN and ERROR for
    faults, INFO for the rest.
    """
    return LEVELS.get(palette.plain(event_word), "INFO")


def line_of(event: Event) -> str:
    """Return an event as one line, such as 'bin_01 > carrier_02: call, is a carrier free? row 3,
    east end'.
    """
    ends = event.who
    if event.whom:
        ends += f" > {event.whom}"
    return f"{ends}: {_words_of(event)}"


def _words_of(event: Event) -> str:
    """Return what an event is, and its detail, if that does not begin with the same words."""
    if not event.detail:
        return event.what
    if event.detail.lower().startswith(event.what.lower()):
        return event.detail
    return f"{event.what}, {event.detail}"


def gathered(events: Sequence[Event]) -> list[Event]:
    """Return the events; each request to many, and replies from many, are merged into one ('14
    carriers').
    """
    requests = []
    for alike in _alike(events, "who"):
        recipients = _together([event.whom for event in alike])
        requests.append(replace(alike[0], whom=recipients, detail=_text(alike)))
    merged = []
    for alike in _alike(requests, "whom"):
        senders = _together([event.who for event in alike])
        merged.append(replace(alike[0], who=senders, detail=_text(alike)))
    return merged


def _alike(events: Sequence[Event], end: str) -> list[list[Event]]:
    """Return the events in groups: messages of one kind with the same end, and each other event.

    `end`: "who", the sender, or "whom", the recipient.
    """
    groups: dict[Hashable, list[Event]] = {}
    for event in events:
        group: Hashable = event
        is_message = palette.plain(event.what) in palette.TALK and event.whom
        if is_message:
            group = event.what, getattr(event, end)
        groups.setdefault(group, []).append(event)
    return list(groups.values())


def _together(names: Sequence[str]) -> str:
    """Return some names, or how many there are, if they are too many for a line."""
    if len(names) <= MOST_NAMES:
        return ", ".join(names)
    kinds = {name.rpartition("_")[0] for name in names}
    kind = "robot"
    if len(kinds) == 1:
        (kind,) = kinds
    return f"{len(names)} {kind}s"


def _text(alike: Sequence[Event]) -> str:
    """Return the details of some events; nothing if they are many and differ."""
    texts = dict.fromkeys(event.detail for event in alike)
    if len(texts) > 1 and len(alike) > MOST_NAMES:
        return ""
    return "; ".join(texts)


class Drawn(NamedTuple):
    """An arc that is shown now, until a tick. `start`, `end`: the indices of two bodies."""

    until: int
    start: int
    end: int
    look: palette.Arc


class Talk:
    """The arcs that are shown now."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        """`columns`: for the arcs."""
        self.columns = columns
        self.index = layout.index
        self._arcs: list[Drawn] = []
        # Whether arcs may still be in the picture.
        self._is_drawn = False
        # The half second in which the arcs were last drawn.
        self._renewed = -1
        # Message -> tick in which it was last sent.
        self._sent_at: dict[tuple[str, str, str, str], int] = {}

    def is_news(self, tick: int, event: Event) -> bool:
        """Return whether the same event did not occur in the last 30 s.

        Agents repeat a request until it is answered.
        """
        if len(self._sent_at) >= MOST_REMEMBERED:
            self._sent_at = {}
        message = (event.what, event.who, event.whom, event.detail)
        last = self._sent_at.get(message)
        self._sent_at[message] = tick
        return last is None or tick - last > REPEAT_TICKS

    def _drawn_arcs(self, tick: int, news: Sequence[Event]) -> Iterator[Drawn]:
        """Yield the arcs of events that are messages between bodies."""
        for event in news:
            drawn = self._drawn(tick, event)
            if drawn is not None:
                yield drawn

    def forget(self) -> None:
        """Drop all arcs, after a gap.

        Those that are still shown are removed when arcs are next drawn.
        """
        self._arcs = []
        self._is_drawn = True

    def show(self, tick: int, poses: np.ndarray, news: Sequence[Event]) -> None:
        """Draw the arcs again if there is a new one, and every half second while there are any.

        `poses`: (n, 3).
        """
        fresh = list(self._drawn_arcs(tick, news))
        half_second = tick // RENEWED_TICKS
        if not fresh and half_second == self._renewed:
            return
        self._renewed = half_second
        self._arcs = [arc for arc in self._arcs + fresh if arc.until > tick]
        by_weight = sorted(self._arcs, key=lambda arc: (-arc.look.rank, -arc.until))
        shown = by_weight[:MOST_ARCS]
        if shown or self._is_drawn:
            self.columns.add(
                "talk",
                rr.LineStrips3D,
                strips=[_arc(poses[arc.start], poses[arc.end]) for arc in shown],
                colors=[arc.look.colour for arc in shown],
                radii=[-arc.look.radius for arc in shown],
            )
            self._is_drawn = bool(shown)

    def _drawn(self, tick: int, event: Event) -> Drawn | None:
        """Return the arc of a message between two bodies, None of another event."""
        look = palette.TALK.get(palette.plain(event.what))
        start = self.index.get(event.who)
        end = self.index.get(event.whom)
        if look is None or start is None or end is None:
            return None
        return Drawn(tick + round(look.seconds / TIME_STEP), start, end, look)


def _arc(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the points of an arc between two poses, (ARC_POINTS, 3) m, float32."""
    along = np.linspace(0.0, 1.0, ARC_POINTS)[:, None]
    flat = start[:2] + along * (end[:2] - start[:2])
    rise = RISE_PER_METRE * float(np.hypot(*(end[:2] - start[:2]))) + LEAST_RISE
    # A parabola: 4 * along * (1 - along) is 1 in the middle.
    z = ARC_Z + 4 * rise * along * (1 - along)
    return np.concatenate([flat, z], axis=1).astype(np.float32)
