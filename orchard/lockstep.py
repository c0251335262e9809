"""The physics side of lockstep, without a network: who holds which agent, and which answers a tick still waits for.

Physics publishes tick k, waits until every agent that is held has answered it, applies the answers in the layout's order,
and goes on to k + 1. A name that nobody holds is not waited for: it stands, unless somebody drives it.
"""

import logging
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

from orchard.agent import Action
from orchard.messages import Written
from orchard.wire.course import Mode, Reason
from orchard.wire.driving import Velocity
from orchard.wire.letters import AskedOf
from orchard.wire.translate import action_of
from orchard.wire.vocabulary import OfRun, read

M = TypeVar("M", bound=OfRun)
Letters = Iterable[tuple[int, dict[str, Written]]]  # (tick, sender -> what it wrote)

log = logging.getLogger("orchard")

PATIENCE = 15.0  # s of wall time for which an agent may be silent
MOST_TOLD = 1000  # keys and reasons that are logged
MOST_TOKENS = 10_000  # that are remembered
AGAIN_SECONDS = 0.5  # after which who is silent is shown a tick again
WATCHDOG = 0.5  # s: for how long one velocity drives a robot that nobody holds; of the clock that is slower, simulated or wall
WATCHDOG_TICKS = 5
NO_TOKEN = "its liveliness token is missing"
TAKEN = "it is taken"
WHOSE = {"not the holder": "someone else holds this agent", "not held": "join before you answer as a holder"}


def shown(words: str, most: int = 200) -> str:
    """A stranger's words, as a short line that does nothing to a terminal or a log."""
    short = words if len(words) <= most else words[: most - 3] + "..."
    return short if short.isprintable() else "".join(c if c.isprintable() else "?" for c in short)


class Refused(Exception):
    """A message that is not applied; the reason is one of a few, so that they can be counted."""

    def __init__(self, reason: Reason, detail: str = "") -> None:
        super().__init__(f"{reason}: {shown(detail)}" if detail else reason)
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
        key = shown(key)
        if (key, refusal.reason) not in self._told and len(self._told) < MOST_TOLD:
            self._told.add((key, refusal.reason))
            log.warning("refused on %s: %s", key, refusal)


def understood(payload: bytes, type_: type[M], run: str) -> M:
    """The message in a payload, if it is one of this run; else Refused."""
    try:
        message = read(payload, type_)
    except ValueError as error:
        raise Refused("malformed", str(error)) from error
    if message.run != run:
        raise Refused("other run", f"{message.run!r} is not {run!r}")
    return message


class Roster:
    """Who holds which agent. A holder is known by the session id in its liveliness tokens."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.holders: dict[str, str] = {}  # name -> session id
        self._by_holder: dict[str, list[str]] = {}  # made when it is asked for
        self._alive: set[tuple[str, str]] = set()

    def token(self, name: str, holder: str, up: bool) -> None:
        """A liveliness token came or went. Who is gone keeps its agents until someone takes them over, or they are released."""
        if up and len(self._alive) >= MOST_TOKENS:
            raise Refused("too many", f"{MOST_TOKENS} liveliness tokens stand")
        (self._alive.add if up else self._alive.discard)((name, holder))

    def may_join(self, name: str, holder: str) -> str:
        """Why a session cannot hold an agent; '' if it can."""
        if name not in self.names:
            return "there is no such agent"
        if (name, holder) not in self._alive:
            return NO_TOKEN
        if self.is_alive(name) and self.holders[name] != holder:
            return f"{TAKEN}, by session {self.holders[name]}"
        return ""

    def join(self, name: str, holder: str) -> None:
        self.holders[name], self._by_holder = holder, {}

    def is_alive(self, name: str) -> bool:
        return (name, self.holders.get(name, "")) in self._alive

    def is_there(self, name: str) -> bool:
        """Whether anybody's token of that name stands."""
        return any(there == name for there, _ in self._alive)

    def by_holder(self) -> dict[str, list[str]]:
        """Session id -> the names that it holds."""
        if not self._by_holder:
            for name in self.names:
                if name in self.holders:
                    self._by_holder.setdefault(self.holders[name], []).append(name)
        return self._by_holder

    def release(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Wait for these no longer; session id -> its names among them."""
        released: dict[str, list[str]] = {}
        self._by_holder = {}
        for name in sorted(names):
            released.setdefault(self.holders.pop(name), []).append(name)
        return released

    def anybody(self) -> bool:
        """Whether any token stands."""
        return bool(self._alive)


class Answers:
    """The velocities that are in for one tick: in lockstep physics waits until none is missing. `realtime.Live` is its counterpart."""

    mode: Mode = "lockstep"
    newest_wins = False  # every tick must reach every agent
    releases_at_once = False  # who is gone may come back, or another in its place, while its patience lasts

    def __init__(self, roster: Roster, patience: float = PATIENCE, clock: Callable[[], float] = time.monotonic) -> None:
        self._roster, self._patience, self._clock = roster, patience, clock
        self.tick = -1
        self.deadline = math.inf  # on the clock: until then the missing are waited for
        self.missing: set[str] = set()
        self._back: set[str] = set()  # who has joined since the tick began
        self.velocities: dict[str, Velocity] = {}
        self._actions: dict[str, Action] = {}  # that they mean
        self._before: dict[str, Velocity] = {}  # those of the last tick

    def open(self, tick: int, lag: float = 0.0) -> None:
        """Wait for everyone who is held, at a new tick, which begins so many seconds after it was due."""
        self.tick, self.missing, self.velocities, self._before = tick, set(self._roster.holders), {}, self.velocities
        self._actions = {}
        self._back.clear()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """Somebody new holds an agent: what its predecessor answered to this tick does not count.

        Many are slow to start, so each that comes gives all some time; but who comes again and again does so once in a tick.
        """
        self.velocities.pop(name, None)
        self._actions.pop(name, None)
        self.missing.add(name)
        if name not in self._back:
            self._back.add(name)
            self.deadline = self._clock() + self._patience

    def give_up(self) -> set[str]:
        """The deadline is over: go on without the missing. Those who lose their agents by it."""
        lost, self.missing = self.missing, set()
        return lost

    def release(self, name: str) -> None:
        """Nobody holds this agent any more."""
        self.missing.discard(name)

    def take(self, name: str, velocity: Velocity) -> None:
        if velocity.holder != self._roster.holders[name]:
            raise Refused("not the holder", WHOSE["not the holder"])
        if velocity.tick != self.tick or name not in self.missing:
            self._refuse_unless_repeated(name, velocity)
            return
        self.velocities[name], self._actions[name] = velocity, action_of(velocity)
        self.missing.discard(name)

    def _refuse_unless_repeated(self, name: str, velocity: Velocity) -> None:
        """One that is not waited for: sent again, in case it was lost, or a mistake."""
        if velocity in (self.velocities.get(name), self._before.get(name)):
            return
        refuse_other_tick(velocity.tick, self.tick, self.tick)
        raise Refused("answered already", f"tick {velocity.tick}")

    def actions(self) -> dict[str, Action]:
        """What to apply, in the order of names: never in that of arrival."""
        return {name: self._actions[name] for name in sorted(self._actions)}

    def digests(self) -> dict[str, bytes]:
        return {name: velocity.report.mail for name, velocity in self.velocities.items() if velocity.report is not None}

    def figures(self) -> dict[str, Any]:
        """What the summary holds of it."""
        return {}


def refuse_other_tick(tick: int, first: int, last: int) -> None:
    if tick < first:
        raise Refused("past tick", f"{tick}; it is {last} now")
    if tick > last:
        raise Refused("future tick", f"{tick}; it is {last} now")


class Recent:
    """The ticks of the last half second, and of the last five: how old a velocity may be that still drives a robot."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self._begun: deque[tuple[int, float]] = deque([(0, clock())])  # (tick, when it was published)

    def begin(self, tick: int) -> None:
        """A new tick is published."""
        self._begun.append((tick, self.clock()))
        while self.is_over(*self._begun[0], tick):
            self._begun.popleft()

    @property
    def oldest(self) -> int:
        return self._begun[0][0]

    @property
    def newest(self) -> int:
        return self._begun[-1][0]

    def is_over(self, tick: int, at: float, now: int) -> bool:
        """Whether a velocity for a tick, which came at some time, drives no longer at the tick `now`."""
        return now - tick >= WATCHDOG_TICKS and self.clock() - at >= WATCHDOG


class Put(NamedTuple):
    """A velocity, and when it came."""

    velocity: Velocity
    at: float  # s, monotonic


class Loose:
    """Robots that no agent holds: the newest velocity drives them, for half a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._recent = Recent(clock)
        self._puts: dict[str, Put] = {}

    def begin(self, tick: int) -> None:
        """A new tick is published."""
        self._recent.begin(tick)

    def take(self, name: str, velocity: Velocity) -> None:
        if velocity.holder:
            raise Refused("not held", WHOSE["not held"])
        newest_put = self._puts[name].velocity.tick if name in self._puts else 0
        refuse_other_tick(velocity.tick, max(self._recent.oldest, newest_put), self._recent.newest)
        self._puts[name] = Put(velocity, self._recent.clock())

    def drives(self, name: str) -> bool:
        """Whether somebody has driven it lately."""
        return name in self._puts

    def actions(self, tick: int) -> dict[str, Action]:
        is_over = self._recent.is_over
        self._puts = {name: put for name, put in self._puts.items() if not is_over(put.velocity.tick, put.at, tick)}
        return {name: Action(action_of(put.velocity).twist) for name, put in self._puts.items()}


class Ledger:
    """What a newcomer must know, unread: of each agent the newest memory that it sent, and the letters of the last two ticks."""

    def __init__(self, memories: Mapping[str, bytes | None] | None = None, letters: Letters = ()) -> None:
        self.memories = dict(memories or {})
        self.letters: dict[int, dict[str, Written]] = dict(letters)  # tick -> sender -> what it wrote

    def keep(self, tick: int, velocities: Mapping[str, Velocity]) -> None:
        """Take what came with the velocities of a tick, the last one that was stepped."""
        written = {}
        for name, velocity in velocities.items():
            if velocity.report is None:
                continue
            if velocity.report.memory is not None:
                self.memories[name] = velocity.report.memory
            if velocity.report.letters is not None:
                written[name] = velocity.report.letters
        self.letters = {at: letters for at, letters in self.letters.items() if at >= tick - 1}
        if written:
            self.letters[tick] = written

    def asked(self, tick: int) -> list[AskedOf]:
        """All requests of a tick."""
        written = self.letters.get(tick, {}).items()
        return [AskedOf(to, sender, number) for sender, letters in written for number, (to, _) in enumerate(letters.requests)]


class Pacer:
    """Spreads ticks over wall time: `speed` simulated seconds to a second; infinity does not wait."""

    CATCH_UP = 0.25  # s of lost time that are made good

    def __init__(self, speed: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._step = 0.1 / speed
        self._clock = clock
        self._due = -math.inf

    def wait(self) -> float:
        """Seconds until the next tick may begin."""
        return max(0.0, self._due - self._clock())

    def begin(self) -> float:
        """A tick begins; so many seconds after it was due."""
        now = self._clock()
        due = now if self._due == -math.inf else self._due
        self._due = max(due, now - self.CATCH_UP) + self._step
        return max(0.0, now - due)
