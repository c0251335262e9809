"""Refused messages: the reasons, the counts, and the totals of all processes of a run.

Physics, hosts and the logger refuse messages that do not count, such as those of another run, and
go on. Each counts them; hosts and the logger send their counts to physics, which adds them up.
"""

import logging
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import msgspec

from orchard.field.problems import ScenarioError, printable
from orchard.sim.snapshot import SnapshotError
from orchard.wire.messages import Counts, Reason, RunMessage, Session, read

M = TypeVar("M", bound=RunMessage)

log = logging.getLogger("orchard")
# Pairs of key and reason that are logged.
MOST_LOGGED = 1000
# Sessions that have a count of refusals.
MOST_SESSIONS = 1000
# Why physics refuses that a session owns an agent. A host tells by them how often to try again.
NO_TOKEN = "its liveliness token is missing"
TAKEN = "it is taken"


class Refused(Exception):
    """Raised for a message that is not applied.

    `reason` is one of a few, so that refusals can be counted.
    """

    def __init__(self, reason: Reason, detail: str = "") -> None:
        self.reason: Reason = reason
        self.detail = printable(detail)
        # The session that sent it, if it says so.
        self.session = ""
        words: str = reason
        if detail:
            words = f"{reason}: {self.detail}"
        super().__init__(words)


@contextmanager
def refused_for(reason: Reason, about: str = "") -> Iterator[None]:
    """Turn a ValueError or ScenarioError in this context into Refused.

    Its text is the detail, after `about`.
    """
    try:
        yield
    except (ValueError, ScenarioError) as error:
        raise Refused(reason, f"{about}{error}") from error


class Refusals:
    """Messages that were not applied.

    They are counted by reason, and logged once for each key and reason.

    >>> refusals = Refusals()
    >>> refusals.note("orchard/stop", Refused("no such robot", "picker_77"))
    >>> dict(refusals.counts)
    {'no such robot': 1}
    """

    def __init__(self) -> None:
        self.counts: Counter[Reason] = Counter()
        self._logged: set[tuple[str, str]] = set()
        self._changed = False

    def is_news(self) -> bool:
        """Whether the counts have changed since the last call."""
        has_changed = self._changed
        self._changed = False
        return has_changed

    def note(self, key: str, refusal: Refused) -> None:
        """Count a refusal, and log it if it is the first of its key and reason."""
        self.counts[refusal.reason] += 1
        self._changed = True
        key = printable(key)
        if (key, refusal.reason) not in self._logged and len(self._logged) < MOST_LOGGED:
            self._logged.add((key, refusal.reason))
            log.warning("refused on %s: %s", key, refusal)


def read_message(payload: bytes, type_: type[M], run: str) -> M:
    """Return the message in a payload. Raises Refused if it is malformed or of another run."""
    with refused_for("malformed"):
        message = read(payload, type_)
    refuse_other_run(message, run)
    return message


def refuse_other_run(message: RunMessage, run: str) -> None:
    """Raise Refused for a message of another run."""
    if message.run != run:
        raise Refused("other run", f"{message.run!r} is not {run!r}")


def refuse_other_tick(tick: int, first: int, last: int) -> None:
    """Raise Refused for a tick before the first or after the last one that counts."""
    if tick < first:
        raise Refused("past tick", f"{tick}; it is {last} now")
    if tick > last:
        raise Refused("future tick", f"{tick}; it is {last} now")


class KnownRefusals(msgspec.Struct, forbid_unknown_fields=True):
    """The refusals of a run so far, for its snapshots."""

    # The counts of physics.
    counts: Counts = {}
    # Session -> its counts.
    there: dict[Session, Counts] = {}


class RefusalTotals(Refusals):
    """The refusals of physics, and those that each session reports."""

    def __init__(self, before: Any = None) -> None:
        """`before`: what `as_data` returned, for a run that is resumed.

        Raises SnapshotError if it is malformed.
        """
        super().__init__()
        try:
            known = msgspec.convert(before or {}, KnownRefusals)
        except ValueError as error:
            fault = "the counts of refused messages in the snapshot are malformed"
            raise SnapshotError(f"{fault}: {error}") from error
        self.counts.update(known.counts)
        # Session -> its counts so far.
        self.there: dict[str, Mapping[Reason, int]] = dict(known.there)

    def as_data(self) -> dict[str, Any]:
        """Return the counts as plain data, for a snapshot."""
        there = {session: dict(counts) for session, counts in self.there.items()}
        return {"counts": dict(self.counts), "there": there}

    def hear(self, session: str, counts: Mapping[Reason, int]) -> None:
        """Replace the counts of a session. Raises Refused if there are too many sessions."""
        if len(self.there) >= MOST_SESSIONS and session not in self.there:
            raise Refused("too many", f"{MOST_SESSIONS} sessions have refused something")
        self.there[session] = counts

    def total(self) -> dict[str, int]:
        """Return the counts of all sessions together, by reason."""
        total: Counter[str] = Counter(self.counts)
        for counts in self.there.values():
            total.update(counts)
        return dict(sorted(total.items()))
