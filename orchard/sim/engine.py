"""The step that all modes share: observe, apply the actions, account. The modes differ only in the source of the actions."""

import hashlib
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import msgspec
import numpy as np

from orchard.contract.agent import Action, Observations
from orchard.contract.events import Event
from orchard.contract.messages import Deed, Flatten
from orchard.field.geometry import STILL
from orchard.field.kinds import kind_of
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.sim import stops
from orchard.sim.invariants import Invariants
from orchard.sim.physics import harvest_is_over, step
from orchard.sim.restore import fitting, world_as_data, world_from
from orchard.sim.scan import Scanner, observe
from orchard.sim.snapshot import Snapshot
from orchard.sim.state_times import StateTimes
from orchard.sim.world import World

Stepped = tuple[list[np.ndarray], Mapping[str, Action], dict[str, bytes], list[Event]]  # scans before, actions, mail digests, events


class Engine:
    """The simulation of one orchard. At each tick call `observe()`, and then `advance()` with the agents' actions.

    A body without an action stands still. Actions are applied in the layout's order, never in the order of arrival.
    A caller with more urgent work can call `step()` instead of `advance()`, and `account()` later.
    """

    def __init__(self, world: World, digest: bytes = bytes(32), before: Mapping[str, Any] | None = None) -> None:
        """`digest`, `before`: of a resumed run, its hash so far and what `figures_as_data` returned."""
        self.world, self.layout = world, world.layout
        self.scans: list[np.ndarray] = []  # ranges at the last observed tick, m, float32, one array for each body
        self._scanner = Scanner(world)
        before = before or {}
        self._invariants = Invariants(world, before.get("invariants"))
        self._states = StateTimes(world, before.get("states"))
        self._digest = digest
        self._stepped: Stepped | None = None  # a step that is not accounted for yet
        self._news = msgspec.convert(before.get("news", []), list[Event])  # events of stops and resets, which the next step returns

    @classmethod
    def begin(cls, scenario: Scenario) -> "Engine":
        """Return an orchard at tick 0."""
        return cls(World(lay_out(scenario)))

    @classmethod
    def resume(cls, snapshot: Snapshot) -> "Engine":
        """Return the orchard of a snapshot. Raises SnapshotError if the snapshot is inconsistent."""
        with fitting(snapshot):
            return cls(world_from(snapshot), snapshot.digest, snapshot.figures)

    def rehearse(self) -> None:
        """Do a step in a separate world with the same bodies, so that all kernels are compiled, or loaded, before the first tick."""
        rehearsal = Engine(World(self.layout))
        rehearsal.observe()
        weeds = [name for name in self.layout.names if kind_of(name) == "weed"]
        rehearsal.advance({name: Action(deeds=[Flatten()]) for name in weeds[:1]}, {})
        rehearsal.violations()

    def figures_as_data(self) -> dict[str, Any]:
        """Return the state besides the world and the hash as plain data, for a snapshot's figures."""
        figures = {"invariants": self.invariants.known, "states": self.states.counts, "news": self._news}
        return {name: msgspec.to_builtins(figure) for name, figure in figures.items()}

    def as_data(self) -> dict[str, Any]:
        """Return the world as a snapshot holds it."""
        return world_as_data(self.world)

    @property
    def invariants(self) -> Invariants:
        """The invariants, after all steps so far."""
        self.account()
        return self._invariants

    @property
    def states(self) -> StateTimes:
        """The times of each robot in each state, after all steps so far."""
        self.account()
        return self._states

    @property
    def tick(self) -> int:
        return self.world.tick

    @property
    def over(self) -> bool:
        """Whether all rows are picked, all full bins unloaded, and the carriers back in the queue."""
        return harvest_is_over(self.world)

    @property
    def digest(self) -> bytes:
        """The run's hash, 32 bytes: SHA-256 over all ticks so far."""
        self.account()
        return self._digest

    @property
    def hash(self) -> str:
        """The run's hash in hexadecimal digits."""
        return self.digest.hex()

    def observe(self) -> Observations:
        """Return the observations of all bodies at this tick."""
        self.scans = self._scanner.scan(self.world)
        return observe(self.world, self.scans)

    def advance(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Apply the actions of this tick, advance the world by 0.1 s, account for the step, and return its events.

        `mail_digests`: name -> digest of the mail that the agent heard at this tick.
        """
        events = self.step(actions, mail_digests)
        self.account()
        return events

    def step(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Do what `advance` does, without accounting for the step."""
        self.account()
        events, self._news = self._news + step(self.world, self._twists(actions), self._deeds(actions)), []
        heard = {name: mail_digests[name] for name in self.layout.agents if mail_digests.get(name)}  # mail to unknown names is left out
        self._stepped = self.scans, dict(actions), heard, events
        return events

    def account(self) -> None:
        """Add the last step to the hash, the invariants and the times in states: its scans, its mail, and the new state of the world.

        A step is added only once. Every other method that needs or changes these figures calls this first.
        """
        if self._stepped is not None:
            (scans, actions, heard, events), self._stepped = self._stepped, None
            self._digest = next_digest(self._digest, self.world, scans, heard)
            self._invariants.update(self.world, events)
            self._states.update(self.world, actions)

    def violations(self) -> list[str]:
        """Return a sentence for each invariant that the run has broken. Call it at the end of a run."""
        return self.invariants.end(self.world, self.over) + self.states.faults(self.world)

    def stop(self, words: Sequence[str] = ()) -> list[str]:
        """Stop the robots with these names or kinds, or all, until they are reset. Return those that were not stopped before.

        Raises ValueError for a word that is no robot's name or kind; then no robot is stopped.
        """
        return self._latch(words, "stopped")

    def reset(self, words: Sequence[str] = ()) -> list[str]:
        """Let these robots, or all, go on. Return those that were stopped before. Raises ValueError as `stop` does."""
        return self._latch(words, "reset")

    def _latch(self, words: Sequence[str], what: str) -> list[str]:
        self.account()
        changed = stops.latch(self.world, words, what == "stopped")
        self._news += [Event(self.tick, what, name) for name in changed]
        return changed

    def _twists(self, actions: Mapping[str, Action]) -> np.ndarray:
        twists = (actions[name].twist if name in actions else STILL for name in self.layout.names)
        return np.fromiter(chain.from_iterable(twists), dtype=np.float64).reshape(-1, 3)

    def _deeds(self, actions: Mapping[str, Action]) -> list[tuple[int, Deed]]:
        """In body order."""
        doers = sorted(self.layout.index[name] for name, action in actions.items() if action.deeds and name in self.layout.index)
        return [(i, deed) for i in doers for deed in actions[self.layout.names[i]].deeds]


_NOTHING = np.zeros(0, dtype=np.float32)
_LITTLE = {kind: np.dtype(f"<{kind}") for kind in ("f8", "f4", "i8", "b1")}


def next_digest(before: bytes, world: World, scans: Sequence[np.ndarray], mail_digests: Mapping[str, bytes]) -> bytes:
    """Return SHA-256 over all state of a run, 32 bytes. Each tick's digest includes the one before.

    `scans`: those that the agents received (float32); `mail_digests`: name -> digest of the mail that the agent heard.
    """
    sha = hashlib.sha256(before)
    sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
    for array in (world.pose, world.coupled, world.fill, world.row_picked, world.alive, np.concatenate([_NOTHING, *scans])):
        sha.update(np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.kind + str(array.itemsize)]).data)  # the same on every machine
    for name in sorted(mail_digests):
        sha.update(b"%d %d " % (len(name.encode()), len(mail_digests[name])) + name.encode() + mail_digests[name])
    return sha.digest()
