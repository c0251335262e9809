"""A host runs any number of agents over one session.

It receives what they observe, and sends their velocities. processes/agents.py makes it. mailbox.py
has the rules of mail, which the code cites by their numbers.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import NoReturn

from orchard.behaviour.catalogue import guarded
from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.mail import LocalMail, digest_of
from orchard.contract.messages import MAX_PAYLOAD, pack
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.net.bin_states import StateBoard
from orchard.net.bus import Alive, Bus, Final, Item, Query, Replied, Sample, Signal
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.mailbox import LOST_SECONDS, MAILBOXES, LatestObservations, SentRequest
from orchard.net.refusals import NO_TOKEN, TAKEN, M, Refusals, Refused, read_message
from orchard.net.requests import (
    AGAIN_SECONDS,
    ANSWER_SECONDS,
    REFUSED_TRIES,
    ErrorReply,
    ask,
    fetch_layout,
    publish_refusals,
)
from orchard.net.runner import AgentRunner
from orchard.wire.codec import report_of
from orchard.wire.keys import Keys
from orchard.wire.messages import (
    RESET,
    Departure,
    End,
    Join,
    Joined,
    Letter,
    Lost,
    Recall,
    Recalled,
    Report,
    Velocities,
)

log = logging.getLogger("orchard")
# s that a host waits for physics that is gone: physics or its router may be started again.
GONE_SECONDS = 20.0
# s after which a host says that physics is gone. At the end of a run its `end` arrives sooner.
WARN_SECONDS = 1.0
# Tries, AGAIN_SECONDS apart, so 5 s in all: the network may learn of a token later than of a join.
JOIN_TRIES = 50
# So 3 s in all: a process before this one that was cut off counts as alive for LEASE_MS, 2 s
# (zenoh_bus.py).
TAKEN_TRIES = 30
# s. Physics sends a tick again if it has no answer. If the tick comes again so long after the
# answer was sent, the two have not crossed: the answer is lost, and is sent again.
ANSWER_AGAIN_SECONDS = 0.25
# If so many messages in turn are of past ticks, what was taken for the newest tick was false: its
# number had changed on its way.
MOST_PAST = 3


def _most_tries(reasons: Collection[str]) -> int:
    """Return how often a join is tried that is refused for these reasons."""
    if not reasons:
        return 1
    if NO_TOKEN in reasons:
        return JOIN_TRIES
    if any(reason.startswith(TAKEN) for reason in reasons):
        return TAKEN_TRIES
    return REFUSED_TRIES


class HostEnded(Exception):
    """Raised when the run is over for this host. `code`: the exit code of its process.

    Its text says why: RESET if the run begins again.
    """

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


def end_if_asked(item: Item) -> None:
    """Raise HostEnded for a signal to stop: for a process that has not begun."""
    if isinstance(item, Signal):
        raise HostEnded(0, "asked to stop")


class _JoinAgain(Exception):
    """Raised when physics no longer waits for this host, or has come back."""


@dataclass
class SentAnswer:
    """What a host has sent for a tick."""

    # -1: it has answered no tick.
    tick: int = -1
    # Packed `Velocities`.
    messages: list[bytes] = field(default_factory=list)
    # s, on the clock of the bus: when they were sent; infinity while that goes on.
    at: float = math.inf


class Host:
    """A session that hosts agents, until the end of the run.

    `patience`: how long it waits for physics that is gone, s.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        *,
        run: str,
        mode: str,
        layout: Layout,
        agents: Mapping[str, Agent],
        patience: float = GONE_SECONDS,
    ) -> None:
        self.bus = bus
        self.keys = keys
        self.run_id = run
        self._patience = patience
        self._scenario = layout.scenario
        self.runners: dict[str, AgentRunner] = {}
        for name, agent in sorted(agents.items()):
            self.runners[name] = AgentRunner(name, guarded(layout, name, agent))
        self.bodies = [name for name in self.runners if name in layout.index]
        self.bins = [name for name in self.bodies if kind_of(name) == "bin"]
        self.latest = LatestObservations(run, self.runners, self.bodies)
        self.mailbox = MAILBOXES[mode](run, layout.agents)
        self.states = StateBoard(bus, keys, run)
        self.refusals = Refusals()
        # The agent that is ticked now; '' between ticks.
        self.thinking = ""
        self._answer = SentAnswer()
        self._ending = Ending(bus.clock)
        # Whether a token of physics has come or gone yet.
        self._has_begun = False
        # Whether a warning was logged that physics is gone.
        self._has_warned = False

    # -- joining

    def listen(self) -> None:
        """Declare subscribers, queryables and then the liveliness tokens (rule 10 of mail)."""
        self.bus.subscribe(self.keys.of("lost"))
        self.bus.subscribe(self.keys.of("end"))
        self.bus.watch(self.keys.of("physics", self.run_id))
        self.bus.subscribe(self.keys.of("seen", session=self.bus.id))
        for name in self.bins:
            self.bus.answer(self.keys.of("state", name))
        for name in self.runners:
            self.bus.answer(self.keys.of("mail", name))
        for name in self.runners:
            self.bus.declare_alive(self.keys.of("alive", name, self.bus.id))

    def join(self) -> None:
        """Join the run: physics waits for the agents from the present tick on.

        Raises HostEnded if physics refuses them, or was reset.
        """
        _, layout = fetch_layout(self.bus, self.keys, self.handle)
        if layout.scenario != self._scenario:
            # Physics has died before it could keep a reset.
            raise HostEnded(0, RESET)
        joined = self._joined()
        if joined.refused:
            reasons = [f"{name}: {reason}" for name, reason in sorted(joined.refused.items())]
            raise HostEnded(2, "; ".join(reasons))
        self.mailbox.join(joined.tick)
        self.latest.forget()
        self._answer = SentAnswer()
        for name, runner in self.runners.items():
            runner.resume(joined.memories.get(name))

    def _joined(self) -> Joined:
        """Ask physics for the agents, and return its reply.

        Ask again while physics refuses for a reason that may pass, or because bytes of the request
        may have changed on their way. Raises ErrorReply if physics answers with errors only.
        """
        request = pack(Join(self.run_id, self.bus.id, list(self.runners)))
        # The most tries of a kind of refusal -> its tries so far. Each kind has its own: a join
        # that waits for its token may be refused for another reason in between.
        tries: Counter[int] = Counter()
        errors = 0
        while True:
            try:
                joined = self._query("join", request, Joined)
                most = _most_tries(joined.refused.values())
                tries[most] += 1
                if tries[most] >= most:
                    return joined
            except ErrorReply:
                errors += 1
                # While physics is gone, the error is from another client, and does not count.
                if self._ending.gone_at < math.inf:
                    tries.clear()
                    errors = 0
                elif errors >= REFUSED_TRIES:
                    raise
            self.bus.sleep(AGAIN_SECONDS)

    def _query(self, kind: str, request: bytes, type_: type[M]) -> M:
        """Return the reply of physics to a query, a message of a type. Raises BusError."""

        def read_reply(payload: bytes) -> M:
            """Return the message of this run in a payload. Raises ValueError."""
            return read_message(payload, type_, self.run_id)

        return ask(
            self.bus,
            self.keys.of(kind, session=self.bus.id),
            request,
            read_reply,
            seconds=ANSWER_SECONDS,
            handle=self.handle,
            refusals=self.refusals,
            meanwhile=self._check_gone,
        )

    # -- one tick

    def run(self) -> NoReturn:
        """Tick until the run ends. Raises HostEnded at the end."""
        while True:
            try:
                self.join()
                while True:
                    self.tick()
            except _JoinAgain:
                log.warning("joining again after tick %d", self.mailbox.last)

    def tick(self) -> None:
        """Wait for the next tick and its mail, ask the agents, and send what they answer."""
        self._wait(lambda: self.latest.tick > self.mailbox.last)
        tick = self.latest.tick

        def has_mail() -> bool:
            """Whether all mail of the tick is here."""
            return self.mailbox.is_settled(tick, self.latest.asked)

        if not has_mail():
            self._wait(has_mail, LOST_SECONDS)
        mail = self._mail(tick)
        seen = self.latest.observations
        # The digests are made before the agents can change their mail.
        digests = {name: digest_of(heard) for name, heard in mail.items()}
        actions = {}
        for name, observed in seen.items():
            actions[name] = self._act(name, observed, mail.get(name) or Mail())
        self.thinking = ""
        reports = {}
        for name, action in actions.items():
            memory = self.runners[name].news()
            reports[name] = report_of(action, digests.get(name, b""), memory)
        self._answer = SentAnswer(tick, self._packed(tick, reports))
        self._send_answer()
        self._send_rest(seen, actions)
        # A repetition of the tick that waits in the inbox now was sent before the answer came. So
        # the time counts from here, and it gets no second answer.
        self._answer.at = self.bus.clock()

    def _send_answer(self) -> None:
        """Send the actions of the tick."""
        for message in self._answer.messages:
            self.bus.publish(self.keys.of("velocities", session=self.bus.id), message)

    def _take_seen(self, payload: bytes) -> None:
        """Take what the agents observe. Raises Refused.

        If the newest tick comes again, send its answer again: the first may be lost, or have
        changed on its way. If only past ticks come, join again: the newest one was false, and
        physics would wait in vain.
        """
        try:
            self.latest.seen(payload)
        except Refused:
            if self.latest.past >= MOST_PAST:
                raise _JoinAgain from None
            raise
        answer = self._answer
        now = self.bus.clock()
        if answer.tick == self.latest.tick and now >= answer.at + ANSWER_AGAIN_SECONDS:
            answer.at = now
            self._send_answer()

    def _send_rest(self, seen: dict[str, Observation], actions: dict[str, Action]) -> None:
        """Send the requests and answers of the agents, and what others may want to know."""
        for name, action in actions.items():
            for asked in self.mailbox.write(name, action):
                letter = Letter(self.run_id, asked.tick, asked.sender, asked.number, asked.request)
                self.bus.ask(self.keys.of("mail", asked.to), pack(letter), asked)
        self.mailbox.close()
        for name in self.bins:
            if name in seen:
                self.states.update(seen[name])
        publish_refusals(self.bus, self.keys, self.run_id, self.refusals)

    def _act(self, name: str, seen: Observation, mail: Mail) -> Action:
        """Return what an agent does. Note that it thinks meanwhile."""
        self.thinking = name
        return self.runners[name].act(seen, mail)

    def _mail(self, tick: int) -> dict[str, Mail]:
        """Return the mail of a tick, by name (rules 3 and 8)."""
        may_lack_mail = self.mailbox.may_lack_mail(tick, self.latest.asked)
        mail = self.mailbox.deliver(tick)
        if not may_lack_mail:
            return mail
        # Physics has copies of all letters. The mailbox notes the recall before the query, because
        # requests of this tick may come while the query waits.
        self.mailbox.recall(tick)
        request = pack(Recall(self.run_id, tick))
        try:
            recalled = self._query("recall", request, Recalled)
        except BusError as error:
            # Physics may have resumed at an earlier tick.
            raise _JoinAgain from error
        if recalled.tick != tick:
            raise _JoinAgain
        return LocalMail(dict(recalled.letters)).deliver(tick)

    def _packed(self, tick: int, reports: dict[str, Report]) -> list[bytes]:
        """Return the messages with the actions of a tick: one, or more if it would be too large."""
        packed = pack(Velocities(self.run_id, tick, self.bus.id, reports))
        if len(packed) <= MAX_PAYLOAD or len(reports) == 1:
            return [packed]
        in_order = list(reports.items())
        middle = len(in_order) // 2
        first = dict(in_order[:middle])
        rest = dict(in_order[middle:])
        return self._packed(tick, first) + self._packed(tick, rest)

    # -- what arrives

    def _wait(self, ready: Callable[[], bool], seconds: float = math.inf) -> None:
        """Handle all present items, then more until `ready()` is True or the time is over.

        All present items come first, so that no old tick is taken for the newest.
        """
        for _ in range(len(self.bus.inbox)):
            self._handle_next(0.0)
        deadline = self.bus.clock() + seconds
        while not ready():
            remaining = deadline - self.bus.clock()
            if remaining <= 0.0:
                return
            # `_check_gone` is due when a warning is, and after it when the patience is over.
            patience = self._patience
            if not self._has_warned:
                patience = min(patience, WARN_SECONDS)
            check_at = self._ending.gone_at + patience
            self._handle_next(min(remaining, check_at - self.bus.clock()))

    def _handle_next(self, seconds: float) -> None:
        """Handle an item that comes in `seconds`; without one look whether physics is gone."""
        item = self.bus.inbox.take(seconds)
        if item is not None:
            self.handle(item)
        else:
            self._check_gone()

    def _check_gone(self) -> None:
        """Warn if physics is gone. Raises HostEnded if it has been gone for `patience` seconds."""
        now = self.bus.clock()
        gone_at = self._ending.gone_at
        if now >= gone_at + WARN_SECONDS and not self._has_warned:
            self._has_warned = True
            log.warning("physics is gone; waiting for it")
        if now >= gone_at + self._patience:
            raise HostEnded(1, f"physics is gone; waited for {self._patience:g} s")

    def handle(self, item: Item) -> None:
        """Handle an item; count it if it is refused. Raises HostEnded at the end of the run."""
        try:
            self._handle(item)
        except Refused as refusal:
            self.refusals.note(getattr(item, "key", "a reply"), refusal)

    def _handle(self, item: Item) -> None:
        """Handle an item. Raises Refused if it does not count."""
        match item:
            case Sample():
                self._take_sample(item)
            case Query():
                self._take_query(item)
            case Replied(SentRequest() as asked, payload, ""):
                self.mailbox.replied(asked, payload)
            case Final(SentRequest() as asked):
                asked.final = True
            case Signal():
                self._leave("asked to stop")
            case Alive(token, up):
                self._track_physics(token, up)

    def _track_physics(self, token: str, up: bool) -> None:
        """Record that physics has come or gone. Raises _JoinAgain if it has come back.

        The first token is not a return: it is there when the host begins to listen.
        """
        had_begun = self._has_begun
        self._has_begun = True
        self._has_warned = False
        self._ending.track(token, up)
        self._leave_if_over()
        if up and had_begun:
            raise _JoinAgain

    def _leave_if_over(self) -> None:
        """Raise HostEnded if the run is over."""
        end = self._ending.end
        if end is not None:
            self._leave(end.why)

    def _leave(self, why: str) -> NoReturn:
        """Tell physics that this session leaves. Raises HostEnded.

        If physics were not told, it would wait for this session at the end: it might only be cut
        off.
        """
        self.bus.publish(self.keys.of("left", session=self.bus.id), pack(Departure(self.run_id)))
        raise HostEnded(0, why)

    def _take_sample(self, sample: Sample) -> None:
        """Take what is published. Raises Refused, or _JoinAgain if agents are lost."""
        match self.keys.parts(sample.key):
            case ["hosts", _, "seen"]:
                self._take_seen(sample.payload)
            case ["end"]:
                self._ending.hear(read_message(sample.payload, End, self.run_id))
                self._leave_if_over()
            case ["lost"]:
                if read_message(sample.payload, Lost, self.run_id).owner == self.bus.id:
                    raise _JoinAgain
            case _:
                raise Refused("no such key")

    def _take_query(self, question: Query) -> None:
        """Reply to a query for a bin's state, or hold a request. Raises Refused."""
        match self.keys.parts(question.key):
            case [name, "state"]:
                self.states.tell(name, question)
            case [name, "mail"] if "*" not in name:
                self.mailbox.hear(name, question)
            case _:
                question.refuse("no such key")
                raise Refused("no such key")
