"""The whole program in one loop: look, think, write, act. Everything else is detail of one of these four."""

from typing import Any

from orchard.agents.catalogue import make_agents
from orchard.contract.agent import Action, Agent, Mail, without_body
from orchard.contract.events import Event
from orchard.contract.mail import LocalMail, digest_of
from orchard.contract.messages import pack, unpack
from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine
from orchard.sim.restore import fitting
from orchard.sim.snapshot import Snapshot


class Local:
    """An orchard with all its agents in one process, without a network: `tick()` until `engine.over`."""

    def __init__(self, scenario: Scenario, agents: dict[str, Agent] | None = None) -> None:
        self.engine = Engine.begin(scenario)
        self.agents = agents if agents is not None else make_agents(self.engine.layout)
        self.memories: dict[str, Any] = {}
        self.actions: dict[str, Action] = {}
        self.post = LocalMail()

    @classmethod
    def resume(cls, snapshot: Snapshot) -> "Local":
        """The run of a snapshot, from its tick on; as often as one likes, to try what would have been. Raises SnapshotError."""
        engine = Engine.resume(snapshot)
        local = cls(engine.layout.scenario)
        local.engine, local.post = engine, LocalMail(dict(snapshot.letters))
        memories = {name: memory for name, memory in snapshot.memories.items() if memory is not None}
        with fitting(snapshot):
            local.memories = {name: unpack(memory, local.agents[name].Memory) for name, memory in memories.items()}
        return local

    def snapshot(self) -> Snapshot:
        """The run between two ticks, as data."""
        engine = self.engine
        memories = {name: None if memory is None else pack(memory) for name, memory in self.memories.items()}
        scenario, letters = engine.layout.scenario.model_dump(), list(self.post.written.items())
        return Snapshot("", scenario, engine.as_data(), engine.digest, memories, letters, engine.figures_as_data(), sorted(self.agents))

    def tick(self) -> list[Event]:
        """One tenth of a second; what happened in it."""
        tick, seen, mail = self.engine.tick, self.engine.observe().observations(), self.post.deliver(self.engine.tick)
        for name, agent in self.agents.items():
            observation = seen.get(name) or without_body(name, tick)
            self.actions[name] = agent.tick(observation, mail.get(name) or Mail(), self.memories.get(name))
            self.memories[name] = self.actions[name].memory
        for name, action in self.actions.items():
            self.post.collect(name, tick, action)
        return self.engine.advance(self.actions, {name: digest_of(heard) for name, heard in mail.items()})
