"""Messages that are refused: why, how often, and the total of all processes of a run."""

import logging
from collections import Counter
from collections.abc import Mapping
from typing import TypeVar

from orchard.wire.messages import Reason
from orchard.wire.types import RunMessage, read

M = TypeVar("M", bound=RunMessage)

log = logging.getLogger("orchard")
MOST_TOLD = 1000  # keys and reasons that are logged
WHOSE = {"not the holder": "someone else holds this agent", "not held": "join before you answer as a holder"}


def printable(words: str, most: int = 200) -> str:
    """A stranger's words, as a short line that does nothing to a terminal or a log."""
    short = words if len(words) <= most else words[: most - 3] + "..."
    return short if short.isprintable() else "".join(c if c.isprintable() else "?" for c in short)


class Refused(Exception):
    """A message that is not applied; the reason is one of a few, so that they can be counted."""

    def __init__(self, reason: Reason, detail: str = "") -> None:
        super().__init__(f"{reason}: {printable(detail)}" if detail else reason)
        self.reason: Reason = reason


class Refusals:
    """Messages that were not applied: counted by reason, logged once for each key and reason."""

    def __init__(self) -> None:
        self.counts: Counter[Reason] = Counter()
        self._told: set[tuple[str, str]] = set()
        self._news = False

    def is_news(self) -> bool:
        """Whether there are more than when this was last asked."""
        news, self._news = self._news, False
        return news

    def note(self, key: str, refusal: Refused) -> None:
        self.counts[refusal.reason] += 1
        self._news = True
        key = printable(key)
        if (key, refusal.reason) not in self._told and len(self._told) < MOST_TOLD:
            self._told.add((key, refusal.reason))
            log.warning("refused on %s: %s", key, refusal)


def read_message(payload: bytes, type_: type[M], run: str) -> M:
    """The message in a payload, if it is one of this run; else Refused."""
    try:
        message = read(payload, type_)
    except ValueError as error:
        raise Refused("malformed", str(error)) from error
    if message.run != run:
        raise Refused("other run", f"{message.run!r} is not {run!r}")
    return message


def refuse_other_tick(tick: int, first: int, last: int) -> None:
    if tick < first:
        raise Refused("past tick", f"{tick}; it is {last} now")
    if tick > last:
        raise Refused("future tick", f"{tick}; it is {last} now")


MOST_SESSIONS = 1000  # whose refusals are added up


class RefusalTotals:
    """What physics refuses, and what each session says that it has refused."""

    def __init__(self) -> None:
        self.own = Refusals()
        self.there: dict[str, Mapping[Reason, int]] = {}  # session -> what it has refused so far

    def hear(self, session: str, counts: Mapping[Reason, int]) -> None:
        """A session's counts, in the place of its last ones. Raises Refused where there are too many sessions."""
        if len(self.there) >= MOST_SESSIONS and session not in self.there:
            raise Refused("too many", f"{MOST_SESSIONS} sessions have refused something")
        self.there[session] = counts

    def total(self) -> dict[str, int]:
        """By reason."""
        total: Counter[str] = Counter(self.own.counts)
        for counts in self.there.values():
            total.update(counts)
        return dict(sorted(total.items()))
