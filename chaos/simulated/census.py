"""What occurs in a schedule: kinds of messages, deeds, requests, answers and events.

From it follows in how many schedules each of them occurs, so a kind that never does is found.
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


def _names_of_messages() -> tuple[str, ...]:
    """Return the names of all messages that are published, asked or replied on some key, sorted."""
    names = set()
    for key in TABLE.values():
        for kind in (key.message, *key.replies):
            if kind is not None:
                names.add(kind.__name__)
    return tuple(sorted(names))


MESSAGES = _names_of_messages()
# The events with which a harvest goes on.
OF_HARVEST = tuple(
    what for what in EVENTS if what not in ("deed refused", "collision", "stopped", "reset")
)


@lru_cache(maxsize=10_000)
def key_of(key: str) -> str:
    """Return of which kind a key is, a name in `wire.keys.TABLE`; '' if it is of none."""
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
        """Note a message that is published, or a query. A malformed one does not count."""
        what = key_of(key)
        if not what:
            return
        kind = TABLE[what].message
        if kind is None:
            return
        self._note(kind, payload)
        # Most actions have no deed, and leave the field out.
        if b"deeds" in payload:
            self._look_for_deeds(what, payload)

    def _look_for_deeds(self, what: str, payload: bytes) -> None:
        """Note the deeds in a message. `what`: the kind of its key."""
        with suppress(ValueError):
            if what == "velocities":
                reports, _ = velocities_of(payload)
                for report in reports.velocities.values():
                    self.deeds.update(type_of(deed) for deed in report.deeds)
            elif what == "velocity":
                self.deeds.update(type_of(deed) for deed in read(payload, Velocity).deeds)

    def reply(self, key: str, payload: bytes) -> None:
        """Note a reply to a query of a key."""
        what = key_of(key)
        if what:
            for kind in TABLE[what].replies:
                self._note(kind, payload)

    def _note(self, kind: type, payload: bytes) -> None:
        """Note a kind of message, if the payload is one."""
        if kind.__name__ not in self.messages:
            with suppress(ValueError):
                read(payload, kind)
                self.messages.add(kind.__name__)

    def step(self, events: Iterable[Event], letters: Mapping[str, Written]) -> None:
        """Note what has happened in a step, and what agents wrote. `letters`: sender -> its own."""
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
    """Return in how many schedules each kind has occurred, 0 included: "deeds" -> "couple" -> 12.

    `occurred`: for each schedule "deeds" -> the kinds that occurred in it, and so on.
    """
    counts: dict[str, dict[str, int]] = {}
    for what, names in KINDS.items():
        counts[what] = dict.fromkeys(names, 0)
    for of_schedule in occurred:
        for what, occurred_names in of_schedule.items():
            of_what = counts.setdefault(what, {})
            for name in occurred_names:
                of_what[name] = of_what.get(name, 0) + 1
    return {what: dict(sorted(of_what.items())) for what, of_what in counts.items()}
