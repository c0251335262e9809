"""The observations and the mail of a host's agents. In lockstep the mail is repeatable.

The rules are numbered in CONTRIBUTING.md. A request of tick k is a query; it is heard at k + 1, and its answer at k + 2, in an order
that does not depend on the network. A host that may have missed mail recalls all mail of the tick from physics.
"""

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from orchard.contract.agent import MOST_HOLD, Action, Heard, Mail, Observation, Reply
from orchard.contract.mail import in_hearing_order
from orchard.contract.messages import Answer, Request, pack
from orchard.net.bus import Query
from orchard.net.refusals import Refused, read_message, refused_for
from orchard.wire.codec import observations_of
from orchard.wire.messages import Answered, AskedOf, Letter, Received, Seen

DOUBT_SECONDS = 1.0  # after which a request without news counts as lost; physics has a copy
MOST_WAITING = 10_000  # requests that wait for their tick
STALE_TICKS = 50  # realtime: the most ticks between two hosts whose agents exchange mail


class LatestObservations:
    """The observations of a host's agents at the newest tick."""

    def __init__(self, run: str, names: Iterable[str], bodies: Iterable[str]) -> None:
        self._run = run
        self._names, self._bodies = frozenset(names), frozenset(bodies)
        self.forget()

    def forget(self) -> None:
        """Drop the observations. The next tick that arrives is the newest."""
        self.tick = -1  # -1: no tick has arrived
        # The number of messages in turn that were refused as older than the newest tick.
        self.past = 0
        self.due: list[str] = []  # the agents that are asked at this tick
        self.asked: list[AskedOf] = []  # the requests that they hear
        self.observations: dict[
            str, Observation
        ] = {}  # of these agents; one without a body gets only the tick

    def seen(self, payload: bytes) -> None:
        """Take a `Seen` message, unless it repeats the newest tick. Raises Refused."""
        message = read_message(payload, Seen, self._run)
        if message.tick < self.tick:
            self.past += 1
            raise Refused("past tick", f"{message.tick}; {self.tick} has begun")
        self.past = 0
        if message.tick == self.tick:
            return
        if not self._names.issuperset(message.due):
            raise Refused("not owned", "an agent of another session")
        if not self._bodies.intersection(message.due).issubset(message.names):
            raise Refused("not all", "bodies are missing")
        with refused_for("malformed"):
            self.observations = observations_of(message)
        self.tick, self.due, self.asked = message.tick, message.due, message.asked


@dataclass(eq=False)
class SentRequest:
    """A request of an agent of this host, sent as one get, and the state of that get."""

    sender: str
    tick: int
    number: int
    to: str
    request: Request
    received: bool = False  # the first reply has come: the request will be heard
    final: bool = False  # the get has ended
    answered: bool = False  # the second reply has come, with this answer:
    answer: Answer | None = None


@dataclass
class _ReceivedRequest:
    """A request that has arrived, and the query that waits for its answer."""

    heard: Heard
    question: Query
    is_heard: bool = False  # its tick has begun or is over: it is answered in this tick or never
    body: Answer | None = None


class Mailbox:
    """The mail of one host's agents in lockstep. The counterpart for realtime is `RealtimeMailbox`."""

    def __init__(self, run: str, names: Collection[str] = ()) -> None:
        """`names`: the agents that may send requests; empty: any agent."""
        self._run, self._names = run, frozenset(names)
        self.last = -1  # the last tick that was delivered
        self._joined = 0
        self._recalled: deque[int] = deque(
            maxlen=2
        )  # ticks whose requests were heard from the copies of physics
        self._waiting: dict[
            tuple[str, str, int, int], _ReceivedRequest
        ] = {}  # (recipient, sender, tick, number) ->
        self._asked: dict[
            int, list[SentRequest]
        ] = {}  # tick -> the requests of that tick, in their order

    def join(self, tick: int) -> None:
        """Continue at a tick that is not the next, and forget all mail (rule 1)."""
        for waiting in self._waiting.values():
            waiting.question.drop()
        self._waiting, self._asked, self.last, self._joined = {}, {}, tick - 1, tick

    # what arrives

    def hear(self, recipient: str, question: Query) -> None:
        """Hold a request for the next tick, and reply `received` (rules 5 and 7). Raises Refused if it does not count."""
        try:
            letter = self._checked(question.payload)
        except Refused as refusal:
            question.refuse(str(refusal))
            raise
        if letter.tick in self._recalled and not self._is_timely(letter.tick):
            question.drop()
            return
        key = (recipient, letter.sender, letter.tick, letter.number)
        if key not in self._waiting and len(self._waiting) >= MOST_WAITING:
            question.refuse("too many requests wait")
            raise Refused("too many", f"{MOST_WAITING} requests wait")
        if key in self._waiting:  # a repeated request
            self._waiting[key].question.drop()
        self._waiting[key] = _ReceivedRequest(
            Heard(letter.sender, letter.tick, letter.number, letter.body), question
        )
        question.reply(pack(Received(self._run, letter.tick)))

    def recall(self, tick: int) -> None:
        """Record that the mail of a tick is heard from the copies of physics: its requests may still come."""
        self._recalled.append(tick - 1)

    def _checked(self, payload: bytes) -> Letter:
        letter = read_message(payload, Letter, self._run)
        if self._names and letter.sender not in self._names:
            raise Refused("no such agent", letter.sender)
        if not self._is_timely(letter.tick) and letter.tick not in self._recalled:
            raise Refused(
                "past tick" if letter.tick < self.last else "future tick",
                f"a request of {letter.tick} at tick {self.last}",
            )
        return letter

    def replied(self, asked: SentRequest, payload: bytes) -> None:
        """Take a reply to a request. Raises Refused if it does not count."""
        message: Received | Answered = read_message(payload, Received | Answered, self._run)  # type: ignore[arg-type]
        if isinstance(message, Received) and message.tick == asked.tick:
            asked.received = True
        elif (
            isinstance(message, Answered)
            and asked.received
            and self._answers_in_time(message.tick, asked.tick)
        ):
            asked.answered, asked.answer = True, message.body
        else:
            raise Refused("past tick", f"an answer of {message.tick} to a request of {asked.tick}")

    def _is_timely(self, tick: int) -> bool:
        """Rule 7: whether a request is of the last tick of this host or a later one: its agents may hold."""
        return self.last <= tick <= self.last + MOST_HOLD

    def _answers_in_time(self, tick: int, asked: int) -> bool:
        return tick == asked + 1

    # one tick

    def is_settled(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Rule 2: all gets of two ticks ago are final, all requests of the last tick are here. A host that has just joined recalls."""
        return self._is_new(tick) or (
            self._has(tick, asked_of)
            and all(asked.final for asked in self._asked.get(tick - 2, ()))
        )

    def doubts(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether mail may be missing: the host has just joined, a request has not come, or a get ended unanswered."""
        return self._is_new(tick) or not (
            self._has(tick, asked_of)
            and all(asked.answered for asked in self._asked.get(tick - 2, ()))
        )

    def _is_new(self, tick: int) -> bool:
        return tick <= self._joined + 1

    def _has(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        return all(
            (to, sender, tick - 1, number) in self._waiting for to, sender, number in asked_of
        )

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Return name -> the requests of the last tick and the answers given in it (rule 3), of agents with mail."""
        mail: dict[str, Mail] = {}
        for (recipient, *_), waiting in self._waiting.items():
            waiting.is_heard = self._is_done(waiting.heard.tick, tick)
            if self._is_heard(waiting.heard.tick, tick):
                mail.setdefault(recipient, Mail()).requests.append(waiting.heard)
        for heard in mail.values():
            heard.requests = in_hearing_order(heard.requests)
        for asked in self._take_settled(tick):
            mail.setdefault(asked.sender, Mail()).replies.append(
                Reply(asked.to, asked.number, asked.request, asked.answer)
            )
        self.last = tick
        return mail

    def _is_heard(self, asked: int, tick: int) -> bool:
        return asked == tick - 1

    def _is_done(self, asked: int, tick: int) -> bool:
        return asked < tick

    def _take_settled(self, tick: int) -> list[SentRequest]:
        settled = self._asked.pop(tick - 2, [])
        self._asked = {at: asked for at, asked in self._asked.items() if at > tick - 2}
        return settled

    def write(self, name: str, action: Action) -> list[SentRequest]:
        """Take the answers of an agent, which `close` sends. Return its requests, which the caller must send."""
        for heard, body in action.answers:
            waiting = self._waiting.get((name, heard.sender, heard.tick, heard.number))
            if waiting is not None and waiting.is_heard:
                waiting.body = body
        if not action.requests:
            return []
        asked = [
            SentRequest(name, self.last, number, to, request)
            for number, (to, request) in enumerate(action.requests)
        ]
        self._asked.setdefault(self.last, []).extend(asked)
        return asked

    def close(self) -> None:
        """Reply to all queries that were heard up to this tick, and drop them (rule 3). Without an answer it is nil."""
        for key in [key for key, waiting in self._waiting.items() if waiting.is_heard]:
            waiting = self._waiting.pop(key)
            waiting.question.reply(pack(Answered(self._run, self.last, waiting.body)))
            waiting.question.drop()


class RealtimeMailbox(Mailbox):
    """The mail of one host's agents in realtime: no tick waits for mail, and each delivers what has come."""

    def _is_timely(self, tick: int) -> bool:
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

    def _take_settled(self, tick: int) -> list[SentRequest]:
        known = [
            a
            for asked in self._asked.values()
            for a in asked
            if a.final or tick - a.tick > STALE_TICKS
        ]
        self._asked = {
            t: left
            for t, asked in self._asked.items()
            if (left := [a for a in asked if a not in known])
        }
        return known


MAILBOXES = {"lockstep": Mailbox, "realtime": RealtimeMailbox}
