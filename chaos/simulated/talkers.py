"""Agents of the scenes: two exchange messages of a type of their own, and one does nothing."""

from typing import Any

from orchard.contract.agent import Action, Hold, Mail, Observation
from orchard.contract.messages import AgentMessage
from orchard.field.layout import Layout

ASKS_EVERY = 20  # ticks


class Weather(AgentMessage, frozen=True):
    """How many days it has not rained. As a request it has the last number that the asker knows."""

    dry_days: int


class Asker:
    """Asks for the weather, and remembers it."""

    Memory = dict[str, int]
    Messages = (Weather,)
    holds = True

    def __init__(self, layout: Layout, name: str) -> None: ...

    def tick(self, seen: Observation, mail: Mail, memory: dict[str, int] | None) -> Action:
        """Ask every ASKS_EVERY ticks."""
        memory = dict(memory or {"dry days": 0})
        for reply in mail.replies:
            if isinstance(reply.body, Weather):
                memory["dry days"] = reply.body.dry_days
        if seen.tick % ASKS_EVERY == 0:
            question: Any = Weather(memory["dry days"])
            return Action(requests=[("station", question)], memory=memory)
        next_question = seen.tick + ASKS_EVERY - seen.tick % ASKS_EVERY
        return Action(memory=memory, hold=Hold(next_question))


class Station:
    """Answers with one day more than the asker knows."""

    Memory = dict[str, int]
    Messages = (Weather,)

    def __init__(self, layout: Layout, name: str) -> None: ...

    def tick(self, seen: Observation, mail: Mail, memory: dict[str, int] | None) -> Action:
        """Answer at once."""
        answers: list[Any] = [
            (heard, Weather(heard.body.dry_days + 1))
            for heard in mail.requests
            if isinstance(heard.body, Weather)
        ]
        return Action(answers=answers, memory=memory or {})


class Idler:
    """Does nothing. So the bare client can own it in place of a host, and changes no run."""

    Memory = dict[str, int]

    def __init__(self, layout: Layout, name: str) -> None: ...

    def tick(self, seen: Observation, mail: Mail, memory: dict[str, int] | None) -> Action:
        """Remember nothing."""
        return Action()
