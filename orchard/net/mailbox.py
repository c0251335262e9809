"""The agents' side of the bus, without a network: what is seen of a tick, and mail that in lockstep is repeatable although it travels.

The rules by number are design.md's. A request of tick k is a query; it is heard at k + 1, its answer at k + 2, in an order
that no network decides. Whatever happens to a query, a copy of each letter is with physics: a host that may have missed some
(it has just joined, or an answer did not come) does not guess, but recalls all mail of the tick from there.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Protocol

from orchard.contract.agent import Action, Heard, Mail, Observation, Reply, without_body
from orchard.contract.mail import in_hearing_order
from orchard.contract.messages import Answer, Request, pack
from orchard.net.refusals import Refused, read_message
from orchard.wire.codec import observations_of
from orchard.wire.messages import Answered, AskedOf, Letter, Received, Seen

DOUBT_SECONDS = 1.0  # after which a request of which nothing is heard counts as lost: physics has a copy


class LatestObservations:
    """What the agents of a host see at the newest tick."""

    def __init__(self, run: str, names: Iterable[str], bodies: Iterable[str]) -> None:
        self._run = run
        self._names, self._bodies = tuple(names), frozenset(bodies)
        self.forget()

    def forget(self) -> None:
        self.tick = -1  # -1: nothing is seen yet
        self.asked: list[AskedOf] = []  # what these agents hear at it
        self._seen: dict[str, Observation] = {}

    def seen(self, payload: bytes) -> bool:
        """Take what has come; False if it is a repetition of what is known."""
        message = read_message(payload, Seen, self._run)
        if message.tick < self.tick:
            raise Refused("past tick", f"{message.tick}; {self.tick} has begun")
        if message.tick == self.tick:
            return False
        if not self._bodies.issubset(message.names):
            raise Refused("not all", "bodies are missing in it")
        try:
            self._seen = observations_of(message)
        except ValueError as error:
            raise Refused("malformed", str(error)) from error
        self.tick, self.asked = message.tick, message.asked
        return True

    def observations(self) -> dict[str, Observation]:
        """What each agent sees at that tick."""
        return {name: self._seen[name] if name in self._bodies else without_body(name, self.tick) for name in self._names}


@dataclass(eq=False)
class SentRequest:
    """One get: a request that this host's agent made, and what is known of it."""

    sender: str
    tick: int
    number: int
    to: str
    request: Request
    received: bool = False  # it will be heard
    final: bool = False  # nothing more will be known
    answered: bool = False  # it was heard, and this is what became of it:
    answer: Answer | None = None


STALE_TICKS = 50  # realtime: how far apart the ticks of two hosts may be whose agents talk


class PendingQuery(Protocol):
    """A query that waits; see bus.Question."""

    payload: bytes

    def reply(self, payload: bytes) -> None: ...
    def refuse(self, reason: str) -> None: ...
    def drop(self) -> None: ...


@dataclass
class _ReceivedRequest:
    """A request that arrived, and the query that waits for its answer."""

    heard: Heard
    question: PendingQuery
    is_heard: bool = False  # its tick has come, or is over: it is answered in this tick or never
    body: Answer | None = None


class Mailbox:
    """The mail of one host's agents in lockstep. In realtime it is a `LiveMailbox`."""

    def __init__(self, run: str, names: Collection[str] = ()) -> None:
        """`names`: who may write; none: anybody."""
        self._run, self._names = run, frozenset(names)
        self.last = -1  # the tick that was last ticked
        self._joined = 0
        self._held: dict[tuple[str, str, int, int], _ReceivedRequest] = {}  # (recipient, sender, tick, number) ->
        self._asked: dict[int, list[SentRequest]] = {}  # tick -> in the order of asking

    def join(self, tick: int) -> None:
        """Rule 1: a tick that is not the next: forget all mail."""
        for held in self._held.values():
            held.question.drop()
        self._held, self._asked, self.last, self._joined = {}, {}, tick - 1, tick

    # what arrives

    def hear(self, recipient: str, question: PendingQuery) -> None:
        """Rules 5 and 7: hold a request for the next tick, and say so at once."""
        try:
            letter = self._understood(question.payload)
        except Refused as refusal:
            question.refuse(str(refusal))
            raise
        self._hold(recipient, letter, question)
        question.reply(pack(Received(self._run, letter.tick)))

    def _understood(self, payload: bytes) -> Letter:
        letter = read_message(payload, Letter, self._run)
        if self._names and letter.sender not in self._names:
            raise Refused("no such agent", letter.sender)
        if not self._is_timely(letter.tick):
            raise Refused("past tick" if letter.tick < self.last else "future tick", f"a request of {letter.tick}; {self.last} is done")
        return letter

    def _hold(self, recipient: str, letter: Letter, question: PendingQuery) -> None:
        """A repeat takes the place of the query that it repeats."""
        heard = Heard(letter.sender, letter.tick, letter.number, letter.body)
        key = (recipient, letter.sender, letter.tick, letter.number)
        if key in self._held:
            self._held[key].question.drop()
        self._held[key] = _ReceivedRequest(heard, question)

    def replied(self, asked: SentRequest, payload: bytes) -> None:
        message: Received | Answered = read_message(payload, Received | Answered, self._run)  # type: ignore[arg-type]
        if isinstance(message, Received) and message.tick == asked.tick:
            asked.received = True
        elif isinstance(message, Answered) and asked.received and self._answers_in_time(message.tick, asked.tick):
            asked.answered, asked.answer = True, message.body
        else:
            raise Refused("past tick", f"an answer of {message.tick} to a request of {asked.tick}")

    def _is_timely(self, tick: int) -> bool:
        """Rule 7, of a request: stamped with my last tick or the next."""
        return tick in (self.last, self.last + 1)

    def _answers_in_time(self, tick: int, asked: int) -> bool:
        """Whether an answer has the right stamp."""
        return tick == asked + 1

    # one tick

    def follows(self, tick: int) -> bool:
        """Rule 1: whether a tick can be the next one."""
        return tick == self.last + 1

    def is_settled(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Rule 2: every get of two ticks ago is final, and what was asked of these agents in the last tick has come.

        Who has just joined waits for neither, and recalls all of it.
        """
        asked = self._asked.get(tick - 2)
        return self._is_new(tick) or (self._has(tick, asked_of) and (not asked or all(one.final for one in asked)))

    def doubts(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether mail of a tick may have been missed: it began while nobody was here, it has not come, or of a get nothing is known."""
        asked = self._asked.get(tick - 2)
        return self._is_new(tick) or not (self._has(tick, asked_of) and (not asked or all(one.answered for one in asked)))

    def _is_new(self, tick: int) -> bool:
        return tick <= self._joined + 1

    def _has(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether these requests of the tick before have come."""
        return not asked_of or all((to, sender, tick - 1, number) in self._held for to, sender, number in asked_of)

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Rule 3: what was asked in the last tick, and what was answered in it. Those without any mail are absent."""
        mail: dict[str, Mail] = {}
        for (recipient, *_), held in self._held.items():
            held.is_heard = self._is_done(held.heard.tick, tick)
            if self._is_heard(held.heard.tick, tick):
                mail.setdefault(recipient, Mail()).requests.append(held.heard)
        for heard in mail.values():
            heard.requests = in_hearing_order(heard.requests)
        for asked in self._take_known(tick):
            mail.setdefault(asked.sender, Mail()).replies.append(Reply(asked.to, asked.number, asked.request, asked.answer))
        self.last = tick
        return mail

    def _is_heard(self, asked: int, tick: int) -> bool:
        return asked == tick - 1

    def _take_known(self, tick: int) -> list[SentRequest]:
        """The requests of which is known what became of them."""
        return self._asked.pop(tick - 2, [])

    def write(self, name: str, action: Action) -> list[SentRequest]:
        """Take what an agent answers, for `close` to tell; the requests that must now be asked."""
        for heard, body in action.answers:
            held = self._held.get((name, heard.sender, heard.tick, heard.number))
            if held is not None and held.is_heard:
                held.body = body
        if not action.requests:
            return []
        asked = [SentRequest(name, self.last, number, to, request) for number, (to, request) in enumerate(action.requests)]
        self._asked.setdefault(self.last, []).extend(asked)
        return asked

    def letter(self, asked: SentRequest) -> bytes:
        return pack(Letter(self._run, asked.tick, asked.sender, asked.number, asked.request))

    def close(self) -> None:
        """Rule 3: every query that was heard in this tick or before gets its answer, or none."""
        for key in [key for key, held in self._held.items() if held.is_heard]:
            held = self._held.pop(key)
            held.question.reply(pack(Answered(self._run, self.last, held.body)))
            held.question.drop()

    def _is_done(self, asked: int, tick: int) -> bool:
        return asked < tick


class RealtimeMailbox(Mailbox):
    """The mail of one host's agents while nobody waits: ticks may be left out, and each hears what has come by then."""

    def follows(self, tick: int) -> bool:
        return tick > self.last

    def _is_timely(self, tick: int) -> bool:
        """The sender may be some ticks behind or ahead."""
        return abs(tick - self.last) <= STALE_TICKS

    def _answers_in_time(self, tick: int, asked: int) -> bool:
        return asked - STALE_TICKS <= tick <= asked + STALE_TICKS

    def is_settled(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        return True

    def doubts(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        return False

    def _is_heard(self, asked: int, tick: int) -> bool:
        return True

    def _is_done(self, asked: int, tick: int) -> bool:
        return True

    def _take_known(self, tick: int) -> list[SentRequest]:
        """Those that are final, and those that nobody has answered for long."""
        known = [a for asked in self._asked.values() for a in asked if a.final or tick - a.tick > STALE_TICKS]
        self._asked = {t: left for t, asked in self._asked.items() if (left := [a for a in asked if a not in known])}
        return known


MAILBOXES = {"lockstep": Mailbox, "realtime": RealtimeMailbox}
