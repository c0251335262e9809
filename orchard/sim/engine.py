"""The step that all modes share: observe, apply the actions, account. The modes differ only in the source of the actions."""

import hashlib
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

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
from orchard.sim.world import World, new_world


class Stepped(NamedTuple):
    """A step that is not accounted for yet."""

    scans: list[np.ndarray]  # of the tick before the step
    actions: Mapping[str, Action]
    heard: dict[str, bytes]  # name -> digest of its mail
    events: list[Event]


class Engine:
    """The simulation of one orchard. At each tick call `observe()`, and then `advance()` with the agents' actions.

    A body without an action stands still. Actions are applied in the layout's order, never in the order of arrival.
    A caller with more urgent work can call `step()` instead of `advance()`, and `account()` later.
    """

    def __init__(self, world: World, digest: bytes = bytes(32), before: Mapping[str, Any] | None = None) -> None:
        """`digest`, `before`: of a resumed run, its hash so far and what `figures_as_data` returned."""
        self.world, self.layout = world, world.layout
        self.agents = self.layout.agents  # the names of all agents
        self.scans: list[np.ndarray] = []  # ranges at the last observed tick, m, float32, one array for each body
        self._scanner = Scanner(self.layout)
        before = before or {}
        self._invariants = Invariants(world, before.get("invariants"))
        self._states = StateTimes(world, before.get("states"))
        self._digest = RunDigest(digest)
        self._stepped: Stepped | None = None
        self._news = msgspec.convert(before.get("news", []), list[Event])  # events of stops and resets, which the next step returns

    @classmethod
    def begin(cls, scenario: Scenario) -> "Engine":
        """Return an orchard at tick 0."""
        return cls(new_world(lay_out(scenario)))

    @classmethod
    def resume(cls, snapshot: Snapshot) -> "Engine":
        """Return the orchard of a snapshot. Raises SnapshotError if the snapshot is inconsistent."""
        with fitting(snapshot):
            return cls(world_from(snapshot), snapshot.digest, snapshot.figures)

    def rehearse(self) -> None:
        """Do a step in a separate world with the same bodies, so that all kernels are compiled, or loaded, before the first tick."""
        rehearsal = Engine(new_world(self.layout))
        rehearsal.observe()
        weeds = [name for name in self.layout.names if kind_of(name) == "weed"]
        rehearsal.advance({name: Action(deeds=[Flatten()]) for name in weeds[:1]}, {})
        rehearsal.violations()

    def figures_as_data(self) -> dict[str, Any]:
        """Return the state besides the world and the hash as plain data, for a snapshot's figures."""
        news = msgspec.to_builtins(self._news)
        return {"invariants": self.invariants.as_data(), "states": self.states.as_data(), "news": news}

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
        """The state of the run's hash, 32 bytes."""
        self.account()
        return self._digest.state

    @property
    def hash(self) -> str:
        """The run's hash: SHA-256 over all ticks so far, in hexadecimal digits."""
        self.account()
        return self._digest.hexdigest()

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
        self._stepped = Stepped(self.scans, dict(actions), self._heard(mail_digests), events)
        return events

    def account(self) -> None:
        """Add the last step to the hash, the invariants and the times in states: its scans, its mail, and the new state of the world.

        A step is added only once. Every other method that needs or changes these figures calls this first.
        """
        if self._stepped is not None:
            (scans, actions, heard, events), self._stepped = self._stepped, None
            self._digest.update(self.world, scans, heard)
            self._invariants.update(self.world, events)
            self._states.update(self.world, actions)

    def violations(self) -> list[str]:
        """Return a sentence for each invariant that the run has broken. Call it at the end of a run."""
        return self.invariants.end(self.world, self.over) + self.states.faults(self.world)

    def stop(self, words: Sequence[str] = ()) -> list[str]:
        """Stop these robots, or all, until they are reset (see `stops.stop`). Return those that were not stopped before."""
        self.account()
        changed = stops.stop(self.world, words)
        self._news += [Event(self.tick, "stopped", name) for name in changed]
        return changed

    def reset(self, words: Sequence[str] = ()) -> list[str]:
        """Let these robots, or all, go on (see `stops.reset`). Return those that were stopped before."""
        self.account()
        changed = stops.reset(self.world, words)
        self._news += [Event(self.tick, "reset", name) for name in changed]
        return changed

    def _heard(self, mail_digests: Mapping[str, bytes]) -> dict[str, bytes]:
        """The digests of mail that was heard. Mail to unknown names is left out."""
        return {name: mail_digests[name] for name in self.agents if mail_digests.get(name)}

    def _twists(self, actions: Mapping[str, Action]) -> np.ndarray:
        twists = (actions[name].twist if name in actions else STILL for name in self.layout.names)
        return np.fromiter(chain.from_iterable(twists), dtype=np.float64).reshape(-1, 3)

    def _deeds(self, actions: Mapping[str, Action]) -> list[tuple[int, Deed]]:
        """In body order."""
        doers = sorted(self.layout.index[name] for name, action in actions.items() if action.deeds and name in self.layout.index)
        return [(i, deed) for i in doers for deed in actions[self.layout.names[i]].deeds]


_NOTHING = np.zeros(0, dtype=np.float32)
_LITTLE = {kind: np.dtype(f"<{kind}") for kind in ("f8", "f4", "i8", "b1")}


class RunDigest:
    """SHA-256 over all state of a run. Each tick's hash includes the one before, so 32 bytes cover all ticks."""

    def __init__(self, state: bytes = bytes(32)) -> None:
        self.state = state

    def update(self, world: World, scans: Sequence[np.ndarray], mail_digests: Mapping[str, bytes]) -> None:
        """Add one tick: the world, the scans that the agents received (float32), and name -> digest of the mail that the agent heard."""
        sha = hashlib.sha256(self.state)
        sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
        for array in (world.pose, world.coupled, world.fill, world.row_picked, world.alive, np.concatenate([_NOTHING, *scans])):
            sha.update(_little_endian(array))
        for name in sorted(mail_digests):
            sha.update(b"%d %d " % (len(name.encode()), len(mail_digests[name])) + name.encode() + mail_digests[name])
        self.state = sha.digest()

    def hexdigest(self) -> str:
        """Return the hash of all ticks so far, 64 hexadecimal digits."""
        return self.state.hex()


def _little_endian(array: np.ndarray) -> memoryview:
    """An array's bytes, the same on every machine."""
    return np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.kind + str(array.itemsize)]).data
