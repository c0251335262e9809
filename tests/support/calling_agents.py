"""Agents for tests of the transport: they call each other often, and drive by what they heard.

So a letter that is lost, doubled or late changes the hash of the run. Some agents are slow, and
some fail. `cast`, `slow`, `broken` and `steady` make the agents of a host:
`python -m orchard.processes.agents --agents calling_agents:cast`.
"""

import hashlib
import random
import time

import msgspec

from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.messages import BinState, StateRequest
from orchard.field.geometry import Twist
from orchard.field.layout import Layout
from orchard.net import zenoh_bus


class Counted(msgspec.Struct):
    """The memory of a caller: how many requests it heard, and how many of its own were answered."""

    heard: int = 0
    replies: int = 0
    unanswered: int = 0


class Caller:
    """Asks two agents at every tick, answers two of three requests, and drives by what it heard."""

    Memory = Counted

    def __init__(self, name: str, names: list[str]) -> None:
        self.name = name
        self.names = names

    def tick(self, seen: Observation, mail: Mail, memory: Counted | None) -> Action:
        memory = memory or Counted()
        memory.heard += len(mail.requests)
        memory.replies += sum(reply.body is not None for reply in mail.replies)
        memory.unanswered += sum(reply.body is None for reply in mail.replies)
        # Any message would do as an answer. One of three requests gets none.
        state = BinState(True, float(memory.heard), self.name)
        answers = [
            (heard, state) for heard in mail.requests if self._draw(heard.sender, seen.tick) % 3
        ]
        # Each count sets a part of the velocity. It is small, so the bodies stay in the orchard.
        friends = [self.names[self._draw(f"to {i}", seen.tick) % len(self.names)] for i in range(2)]
        requests = [(name, StateRequest()) for name in friends]
        twist = Twist(
            0.01 * (memory.heard % 5),
            0.0,
            0.001 * (memory.replies % 7) - 0.001 * (memory.unanswered % 3),
        )
        return Action(
            twist,
            requests=requests,
            answers=answers,
            memory=memory,
            doing="calling",
            steps_done=seen.tick,
        )

    def _draw(self, what: str, tick: int) -> int:
        """Return a number from 0 to 2**32 - 1 that follows from the agent, a word and the tick."""
        return int.from_bytes(
            hashlib.blake2b(f"{self.name} {what} {tick}".encode(), digest_size=4).digest()
        )


def cast(layout: Layout, names: object = None) -> dict[str, Caller]:
    """Make a caller for each agent of a layout, or for these names."""
    everybody = sorted(layout.agents)
    return {name: Caller(name, everybody) for name in everybody}


class Slow:
    """An agent that thinks for up to so many seconds of wall time before it acts as another one."""

    def __init__(self, agent, seconds: float) -> None:
        self._agent = agent
        self._seconds = seconds
        self.Memory = agent.Memory

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        time.sleep(random.random() * self._seconds)
        return self._agent.tick(seen, mail, memory)


def slow(layout: Layout, names: object = None) -> dict[str, Slow]:
    """Return callers that are slow at random, in a process with handlers that are slow too."""
    for handler in ("_sample", "_alive", "_replied", "ZenohQuery"):
        setattr(zenoh_bus, handler, _slowly(getattr(zenoh_bus, handler)))
    return {name: Slow(agent, 1e-3) for name, agent in cast(layout).items()}


def _slowly(function):
    """Return a function that pauses in three of ten calls, for up to 1 ms, and does the same."""

    def slow_function(*arguments):
        if random.random() < 0.3:
            time.sleep(random.random() * 1e-3)
        return function(*arguments)

    return slow_function


class Broken:
    """An agent that raises an error at each tick."""

    Memory = dict

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        raise LookupError("no such row")


def broken(layout: Layout, names: object = None) -> dict[str, object]:
    """Return callers, and one picker that raises an error."""
    return cast(layout) | {"picker_01": Broken()}


class Steady:
    """Drives on at 0.5 m/s."""

    Memory = dict

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        return Action(Twist(0.5), memory=memory, doing="walking")


def steady(layout: Layout, names: object = None) -> dict[str, Steady]:
    return {name: Steady() for name in layout.names}
