"""The whole program in one loop: look, think, write, act. Everything else is detail of one of these four."""

from typing import Any

from orchard.agent import Action, Agent, Mail, without_body
from orchard.agents import cast
from orchard.config import Scenario
from orchard.engine import Engine
from orchard.events import Event
from orchard.post import PostOffice, digest_of


class Local:
    """An orchard with all its agents in one process, without a network: `tick()` until `engine.over`."""

    def __init__(self, scenario: Scenario, agents: dict[str, Agent] | None = None) -> None:
        self.engine = Engine(scenario)
        self.agents = agents if agents is not None else cast(self.engine.layout)
        self.memories: dict[str, Any] = {}
        self.actions: dict[str, Action] = {}
        self.post = PostOffice()

    def tick(self) -> list[Event]:
        """One tenth of a second; what happened in it."""
        tick, seen, mail = self.engine.tick, self.engine.observe(), self.post.deliver(self.engine.tick)
        for name, agent in self.agents.items():
            observation = seen.get(name) or without_body(name, tick)
            self.actions[name] = agent.tick(observation, mail.get(name) or Mail(), self.memories.get(name))
            self.memories[name] = self.actions[name].memory
        for name, action in self.actions.items():
            self.post.collect(name, tick, action)
        return self.engine.advance(self.actions, {name: digest_of(heard) for name, heard in mail.items()})
