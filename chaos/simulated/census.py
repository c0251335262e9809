"""What occurs in a schedule: kinds of messages, deeds, requests, answers and events.

A count of schedules follows from it.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import get_args

from orchard.contract import messages as contract
from orchard.contract.events import Event, What
from orchard.contract.messages import Written, type_of
from orchard.wire.codec import velocities_of
from orchard.wire.keys import TABLE, Keys
from orchard.wire.messages import Reason, Velocity, read

KEYS = Keys()
DEEDS = tuple(type_of(deed) for deed in get_args(contract.Deed))
REQUESTS = tuple(type_of(request) for request in get_args(contract.Request))
ANSWERS = tuple(type_of(answer) for answer in get_args(contract.Answer))
EVENTS: tuple[str, ...] = get_args(What)
REASONS: tuple[str, ...] = get_args(Reason)
MESSAGES = tuple(
    sorted(
        {
            kind.__name__
            for key in TABLE.values()
            for kind in (key.message, *key.replies)
            if kind is not None
        }
    )
)
# the events with which a harvest goes on
OF_HARVEST = tuple(
    what for what in EVENTS if what not in ("deed refused", "collision", "stopped", "reset")
)


@lru_cache(maxsize=10_000)
def key_of(key: str) -> str:
    """Return which key of `wire.keys.TABLE` a key is; empty if it is none."""
    match KEYS.parts(key):
        case [what] if what in TABLE:
            return what
        case ["hosts", _, what] if what in TABLE:
            return what
        case [_, what] if what in TABLE:
            return what
    return ""


class Census:
    """What has occurred so far."""

    def __init__(self) -> None:
        self.messages: set[str] = set()
        self.deeds: set[str] = set()
        self.requests: set[str] = set()
        self.answers: set[str] = set()
        self.events: set[str] = set()

    def send(self, key: str, payload: bytes) -> None:
        """Know that a message is published or a query is sent. What is malformed does not count."""
        if (what := key_of(key)) and (kind := TABLE[what].message) is not None:
            self._know(kind, payload)
            # Most actions have no deed, and leave the field out.
            if b"deeds" in payload:
                self._look_for_deeds(what, payload)

    def _look_for_deeds(self, what: str, payload: bytes) -> None:
        with suppress(ValueError):
            if what == "velocities":
                reports, _ = velocities_of(payload)
                for report in reports.velocities.values():
                    self.deeds.update(type_of(deed) for deed in report.deeds)
            elif what == "velocity":
                self.deeds.update(type_of(deed) for deed in read(payload, Velocity).deeds)

    def reply(self, key: str, payload: bytes) -> None:
        """Know that a query is replied to."""
        if what := key_of(key):
            for kind in TABLE[what].replies:
                self._know(kind, payload)

    def _know(self, kind: type, payload: bytes) -> None:
        if kind.__name__ not in self.messages:
            with suppress(ValueError):
                read(payload, kind)
                self.messages.add(kind.__name__)

    def step(self, events: Iterable[Event], letters: Mapping[str, Written]) -> None:
        """Know what has happened in a step, and what was said."""
        self.events.update(event.what for event in events)
        for written in letters.values():
            self.requests.update(type_of(body) for _, body in written.requests)
            self.answers.update(type_of(given.body) for given in written.answers)


KINDS: dict[str, tuple[str, ...]] = {
    "messages": MESSAGES,
    "deeds": DEEDS,
    "requests": REQUESTS,
    "answers": ANSWERS,
    "events": EVENTS,
    "refusals": REASONS,
}


def summed_up(occurred: Iterable[Mapping[str, Sequence[str]]]) -> dict[str, dict[str, int]]:
    """Return in how many schedules each kind has occurred.

    `occurred`: of each schedule, what has occurred of what.
    """
    counts: dict[str, dict[str, int]] = {
        what: dict.fromkeys(ones, 0) for what, ones in KINDS.items()
    }
    for one in occurred:
        for what, kinds in one.items():
            of_what = counts.setdefault(what, {})
            for kind in kinds:
                of_what[kind] = of_what.get(kind, 0) + 1
    return {what: dict(sorted(ones.items())) for what, ones in counts.items()}
