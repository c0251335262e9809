"""The observations and the mail of a host's agents. In lockstep the mail is repeatable.

Theory of operation. A request of tick k is a query; it is heard at k + 1, and its answer at k + 2,
in an order that does not depend on the network. Here a get is a query as its sender sees it; it is
final when all its replies have come, or its time is over. The code cites these rules by number:

1. Join. A host that joins forgets all mail. Its first tick is that of the reply, for which physics
   waits: an answer from before the join does not count. A link that breaks loses what was sent.
   Then the token of physics goes and comes, and the host asks for the scenario and joins again.
2. Wait. A host begins tick k when every get of k - 2 is final, and every request of k - 1 to its
   agents has come; `asked` in `seen` lists them. After 1 s it asks physics for the mail (`recall`).
   Realtime does not wait.
3. Deliver and close. The mail of tick k is the requests and answers stamped k - 1. Then the host
   answers the queries that wait, and drops older ones.
4. Ask. A request is one get per recipient, numbered from 0 per sender and tick: target ALL,
   consolidation NONE, BLOCK, a time-out of 10 s.
5. Receive. The recipient's host keeps the query for the next tick, and replies `received` as soon
   as it reads it.
6. Copy. A host sends velocities, with copies of all letters, before it sends the gets. From the
   copies physics makes the `asked` of the next tick.
7. Stamps. Requests before the host's last tick, or more than 1,000 ticks after it, are refused; in
   realtime, those more than 50 ticks apart.
8. Lost mail. A get without an answer may have lost it. In lockstep the host recalls the mail, so a
   lost reply changes nothing.
9. Threads. Zenoh's handlers store and signal only. All messages are handled in the thread that
   reads the inbox.
10. Tokens. A process declares its liveliness token last. The token's key holds a session id,
    because two equal keys hide a restart.
11. Copies for observers. Physics publishes the copies on `letters`, because subscribers receive no
    queries.

These are the states of a request at the sender's host, a `SentRequest`:

    state     | what happens                              | next state
    ----------+-------------------------------------------+----------------------------------------
    sent      | the reply `received` comes                | received
    received  | the reply with the answer comes           | answered
    any       | the get ends: all replies came, or 10 s   | final; it is settled at k + 2
              | are over                                  |
    final     | k + 2 begins                              | delivered with its answer; if it is not
              |                                           | answered, all mail of k + 2 is recalled
"""

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

from orchard.contract.agent import MOST_HOLD, Action, Heard, Mail, Observation, Reply
from orchard.contract.mail import in_hearing_order
from orchard.contract.messages import Answer, Request, pack
from orchard.net.bus import Query
from orchard.net.refusals import Refused, read_message, refused_for
from orchard.wire.codec import observations_of
from orchard.wire.messages import Answered, AskedOf, Letter, Received, Seen

# s after which a request without news counts as lost. Physics has a copy.
LOST_SECONDS = 1.0
# Requests that wait for their tick.
MOST_WAITING = 10_000
# Realtime: the most ticks between two hosts that exchange mail.
STALE_TICKS = 50


class LatestObservations:
    """The observations of a host's agents at the newest tick."""

    def __init__(self, run: str, names: Iterable[str], bodies: Iterable[str]) -> None:
        self._run = run
        self._names = frozenset(names)
        self._bodies = frozenset(bodies)
        self.forget()

    def forget(self) -> None:
        """Drop the observations. The next tick that arrives is the newest."""
        # -1: no tick has arrived.
        self.tick = -1
        # The number of messages in turn that were refused as older than the newest tick.
        self.past = 0
        # The agents that are asked at this tick.
        self.due: list[str] = []
        # The requests that they hear at it.
        self.asked: list[AskedOf] = []
        # Those of these agents. An agent without a body gets only the tick.
        self.observations: dict[str, Observation] = {}

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
        self.tick = message.tick
        self.due = message.due
        self.asked = message.asked


@dataclass(eq=False)
class SentRequest:
    """A request of an agent of this host, sent as one get, and the state of that get."""

    sender: str
    tick: int
    number: int
    to: str
    request: Request
    # Whether the first reply has come: the request will be heard.
    received: bool = False
    # Whether the get has ended.
    final: bool = False
    # Whether the second reply has come, with the answer; None: the recipient gives none.
    answered: bool = False
    answer: Answer | None = None


@dataclass
class _ReceivedRequest:
    """A request that has arrived, and the query that waits for its answer."""

    heard: Heard
    question: Query
    # Whether the tick at which it is heard has begun, or is over: then `close` answers it.
    is_closed: bool = False
    # The answer that the agent gives; None: none.
    body: Answer | None = None


class Mailbox:
    """The mail of one host's agents in lockstep.

    The counterpart for realtime is `RealtimeMailbox`.
    """

    def __init__(self, run: str, names: Collection[str] = ()) -> None:
        """Begin without mail. `names`: the agents that may send requests; empty: any agent."""
        self._run = run
        self._names = frozenset(names)
        # The last tick whose mail was delivered; -1: none was.
        self.last = -1
        # The tick at which the host has joined last.
        self._joined = 0
        # The last two ticks whose requests were heard from the copies of physics.
        self._recalled: deque[int] = deque(maxlen=2)
        # (recipient, sender, tick, number) -> the request.
        self._waiting: dict[tuple[str, str, int, int], _ReceivedRequest] = {}
        # Tick -> the requests of that tick, in their order.
        self._asked: dict[int, list[SentRequest]] = {}

    def join(self, tick: int) -> None:
        """Continue at a tick that is not the next, and forget all mail (rule 1)."""
        for waiting in self._waiting.values():
            waiting.question.drop()
        self._waiting = {}
        self._asked = {}
        self.last = tick - 1
        self._joined = tick

    # -- what arrives

    def hear(self, recipient: str, question: Query) -> None:
        """Hold a request for the next tick, and reply `received` (rules 5 and 7).

        Raises Refused if it does not count.
        """
        try:
            letter = self._checked(question.payload)
        except Refused as refusal:
            question.refuse(str(refusal))
            raise
        if letter.tick in self._recalled and not self._is_timely(letter.tick):
            # Its agent has heard it already, from the copies. Its answer is recalled, too.
            question.drop()
            return
        key = (recipient, letter.sender, letter.tick, letter.number)
        if key not in self._waiting and len(self._waiting) >= MOST_WAITING:
            question.refuse("too many requests wait")
            raise Refused("too many", f"{MOST_WAITING} requests wait")
        if key in self._waiting:
            # The request is repeated, so the query before it is over.
            self._waiting[key].question.drop()
        heard = Heard(letter.sender, letter.tick, letter.number, letter.body)
        self._waiting[key] = _ReceivedRequest(heard, question)
        question.reply(pack(Received(self._run, letter.tick)))

    def recall(self, tick: int) -> None:
        """Record that the mail of a tick is heard from the copies of physics.

        Its requests may still come; then they are no fault.
        """
        self._recalled.append(tick - 1)

    def _checked(self, payload: bytes) -> Letter:
        """Return the request in a payload. Raises Refused if it does not count."""
        letter = read_message(payload, Letter, self._run)
        if self._names and letter.sender not in self._names:
            raise Refused("no such agent", letter.sender)
        if not self._is_timely(letter.tick) and letter.tick not in self._recalled:
            detail = f"a request of {letter.tick} at tick {self.last}"
            if letter.tick < self.last:
                raise Refused("past tick", detail)
            raise Refused("future tick", detail)
        return letter

    def replied(self, asked: SentRequest, payload: bytes) -> None:
        """Take a reply to a request. Raises Refused if it does not count."""
        kinds: Any = Received | Answered
        message: Received | Answered = read_message(payload, kinds, self._run)
        if isinstance(message, Received) and message.tick == asked.tick:
            asked.received = True
            return
        is_in_time = asked.received and self._answers_in_time(message.tick, asked.tick)
        if not isinstance(message, Answered) or not is_in_time:
            raise Refused("past tick", f"an answer of {message.tick} to a request of {asked.tick}")
        asked.answered = True
        asked.answer = message.body

    def _is_timely(self, tick: int) -> bool:
        """Whether a request is of the last tick of this host or a later one (rule 7).

        If all agents of this host hold, it is not asked at each tick, and other hosts are ahead.
        """
        return self.last <= tick <= self.last + MOST_HOLD

    def _answers_in_time(self, answer_tick: int, request_tick: int) -> bool:
        """Whether the answer of one tick counts for the request of another."""
        return answer_tick == request_tick + 1

    # -- one tick

    def is_settled(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether a tick can begin (rule 2).

        Then all gets of two ticks ago are final, and all requests of the last tick are here. A host
        that has just joined need not wait: it recalls its mail. `asked_of`: the requests of the
        last tick that physics knows of.
        """
        if self._is_new(tick):
            return True
        is_final = all(asked.final for asked in self._asked.get(tick - 2, ()))
        return is_final and self._has(tick, asked_of)

    def may_lack_mail(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether mail may be missing, so that it must be recalled (rule 8).

        The host has just joined, a request has not come, or a get ended unanswered.
        """
        if self._is_new(tick):
            return True
        is_answered = all(asked.answered for asked in self._asked.get(tick - 2, ()))
        return not is_answered or not self._has(tick, asked_of)

    def _is_new(self, tick: int) -> bool:
        """Whether the host has joined too late to have all mail of a tick.

        At the tick at which it joined, and at the one after it, replies come to requests that it
        has not sent itself.
        """
        return tick <= self._joined + 1

    def _has(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether these requests of the last tick have come."""
        for to, sender, number in asked_of:
            if (to, sender, tick - 1, number) not in self._waiting:
                return False
        return True

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Return the mail of a tick, by name: requests, and answers (rule 3).

        Both were sent in the last tick. Agents without mail are left out.
        """
        mail: dict[str, Mail] = {}
        for (recipient, *_), waiting in self._waiting.items():
            waiting.is_closed = self._is_closed(waiting.heard.tick, tick)
            if self._is_heard(waiting.heard.tick, tick):
                mail.setdefault(recipient, Mail()).requests.append(waiting.heard)
        for heard in mail.values():
            heard.requests = in_hearing_order(heard.requests)
        for asked in self._take_settled(tick):
            reply = Reply(asked.to, asked.number, asked.request, asked.answer)
            mail.setdefault(asked.sender, Mail()).replies.append(reply)
        self.last = tick
        return mail

    def _is_heard(self, request_tick: int, tick: int) -> bool:
        """Whether a request is heard at a tick."""
        return request_tick == tick - 1

    def _is_closed(self, request_tick: int, tick: int) -> bool:
        """Whether a request is closed at the end of a tick, with an answer or without one."""
        return request_tick < tick

    def _take_settled(self, tick: int) -> list[SentRequest]:
        """Return the requests that have their answers at a tick, and forget them."""
        settled = self._asked.pop(tick - 2, [])
        self._asked = {at: asked for at, asked in self._asked.items() if at > tick - 2}
        return settled

    def write(self, name: str, action: Action) -> list[SentRequest]:
        """Take the answers of an agent, which `close` sends.

        Return its requests, which the caller must send.
        """
        for heard, body in action.answers:
            waiting = self._waiting.get((name, heard.sender, heard.tick, heard.number))
            if waiting is not None and waiting.is_closed:
                waiting.body = body
        if not action.requests:
            return []
        asked = []
        for number, (to, request) in enumerate(action.requests):
            asked.append(SentRequest(name, self.last, number, to, request))
        self._asked.setdefault(self.last, []).extend(asked)
        return asked

    def close(self) -> None:
        """Reply to all requests that were heard up to this tick, and drop their queries (rule 3).

        A request that its agent has not answered gets the answer nil.
        """
        for key, waiting in list(self._waiting.items()):
            if waiting.is_closed:
                del self._waiting[key]
                waiting.question.reply(pack(Answered(self._run, self.last, waiting.body)))
                waiting.question.drop()


class RealtimeMailbox(Mailbox):
    """The mail of one host's agents in realtime.

    No tick waits for mail, and each delivers what has come.
    """

    def _is_timely(self, tick: int) -> bool:
        return abs(tick - self.last) <= STALE_TICKS

    def _answers_in_time(self, answer_tick: int, request_tick: int) -> bool:
        return abs(answer_tick - request_tick) <= STALE_TICKS

    def is_settled(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether a tick can begin: always."""
        return True

    def may_lack_mail(self, tick: int, asked_of: Collection[AskedOf]) -> bool:
        """Whether mail must be recalled: never."""
        return False

    def _is_heard(self, request_tick: int, tick: int) -> bool:
        return True

    def _is_closed(self, request_tick: int, tick: int) -> bool:
        return True

    def _take_settled(self, tick: int) -> list[SentRequest]:
        settled = list[SentRequest]()
        unsettled = dict[int, list[SentRequest]]()
        for sent_at, requests in self._asked.items():
            is_stale = tick - sent_at > STALE_TICKS
            for asked in requests:
                if asked.final or is_stale:
                    settled.append(asked)
                else:
                    unsettled.setdefault(sent_at, []).append(asked)
        self._asked = unsettled
        return settled


MAILBOXES = {"lockstep": Mailbox, "realtime": RealtimeMailbox}
