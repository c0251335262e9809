"""The step that every mode shares: observe, apply the actions, account. The modes differ only in where the actions come from."""

import hashlib
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import msgspec
import numpy as np

from orchard.contract.agent import Action
from orchard.contract.events import Event
from orchard.contract.messages import TRAFFIC, Deed, Flatten
from orchard.contract.observations import Observations
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
    """A step that the accounts lack."""

    scans: list[np.ndarray]  # of the tick before it
    heard: dict[str, bytes]  # name -> digest of its mail
    events: list[Event]


class Engine:
    """One orchard on its way through the ticks: `observe()` once per tick, then `advance()` with what the agents answered.

    A body without an action stands still. Actions count by name and are applied in the layout's order, never in that of arrival.
    Whoever has more urgent things to do than to account for a step calls `step()` in place of `advance()`, and `account()` later.
    """

    def __init__(self, world: World, digest: bytes = bytes(32), before: Mapping[str, Any] | None = None) -> None:
        """`before`: what `figures_as_data` gave, of a run that goes on."""
        self.world, self.layout = world, world.layout
        self.agents = (*self.layout.names, TRAFFIC)  # every name that an agent can hold
        self.scans: list[np.ndarray] = []  # m, float32: of the tick that was last observed, one array per body
        self._scanner = Scanner(self.layout)
        before = before or {}
        self._invariants = Invariants(world, before.get("invariants"))
        self._states = StateTimes(world, before.get("states"))
        self._digest = RunDigest(digest)
        self._stepped: Stepped | None = None
        self._news = msgspec.convert(before.get("news", []), list[Event])  # of stops, for the next step to tell

    @classmethod
    def begin(cls, scenario: Scenario) -> "Engine":
        """An orchard at tick 0."""
        return cls(new_world(lay_out(scenario)))

    @classmethod
    def resume(cls, snapshot: Snapshot) -> "Engine":
        """The orchard of a snapshot. Raises SnapshotError for one that does not fit together."""
        with fitting(snapshot):
            return cls(world_from(snapshot), snapshot.digest, snapshot.figures)

    def rehearse(self) -> None:
        """Do a step with the same bodies in a world that nobody sees: all kernels are compiled, or loaded, before a tick waits for them."""
        rehearsal = Engine(new_world(self.layout))
        rehearsal.observe()
        weeds = [name for name in self.layout.names if kind_of(name) == "weed"]
        rehearsal.advance({name: Action(deeds=[Flatten()]) for name in weeds[:1]}, {})
        rehearsal.violations()

    def figures_as_data(self) -> dict[str, Any]:
        """What it must remember besides the world and the hash, plain: for a snapshot's figures."""
        news = msgspec.to_builtins(self._news)
        return {"invariants": self.invariants.as_data(), "states": self.states.as_data(), "news": news}

    def as_data(self) -> dict[str, Any]:
        """The world, as a snapshot holds it."""
        return world_as_data(self.world)

    @property
    def invariants(self) -> Invariants:
        """What must be so, after all steps so far."""
        self.account()
        return self._invariants

    @property
    def states(self) -> StateTimes:
        """What each robot did, in all steps so far."""
        self.account()
        return self._states

    @property
    def tick(self) -> int:
        return self.world.tick

    @property
    def over(self) -> bool:
        """Every row is picked, every full bin unloaded, and the carriers are back in the queue."""
        return harvest_is_over(self.world)

    @property
    def digest(self) -> bytes:
        """What the hash must remember."""
        self.account()
        return self._digest.state

    @property
    def hash(self) -> str:
        """SHA-256 over all ticks so far."""
        self.account()
        return self._digest.hexdigest()

    def observe(self) -> Observations:
        """What each body sees at this tick."""
        self.scans = self._scanner.scan(self.world)
        return observe(self.world, self.scans)

    def advance(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Apply the answers to this tick, 0.1 s long, and account for it."""
        events = self.step(actions, mail_digests)
        self.account()
        return events

    def step(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Apply the answers to this tick; what happened."""
        self.account()
        events, self._news = self._news + step(self.world, self._twists(actions), self._deeds(actions)), []
        self._stepped = Stepped(self.scans, self._heard(mail_digests), events)
        return events

    def account(self) -> None:
        """Take the last step into the hash, the invariants and the states' times: its scans and mail, and the state that came of it.

        Once; before anything here is changed or asked it is done in any case.
        """
        if self._stepped is not None:
            (scans, heard, events), self._stepped = self._stepped, None
            self._digest.update(self.world, scans, heard)
            self._invariants.update(self.world, events)
            self._states.update(self.world)

    def violations(self) -> list[str]:
        """Which invariants the run has broken, now that it is over; a sentence each."""
        return self.invariants.end(self.world, self.over) + self.states.faults(self.world)

    def stop(self, words: Sequence[str] = ()) -> list[str]:
        """Stop these robots, or all, until they are reset; see `stops.stop`. Those that were not stopped before."""
        self.account()
        changed = stops.stop(self.world, words)
        self._news += [Event(self.tick, "stopped", name) for name in changed]
        return changed

    def reset(self, words: Sequence[str] = ()) -> list[str]:
        """Let these robots, or all, go on; see `stops.reset`. Those that were stopped before."""
        self.account()
        changed = stops.reset(self.world, words)
        self._news += [Event(self.tick, "reset", name) for name in changed]
        return changed

    def _heard(self, mail_digests: Mapping[str, bytes]) -> dict[str, bytes]:
        """The digests of what was heard; what is written to nobody is not."""
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
    """SHA-256 over everything that a run decides, tick by tick: each tick's hash takes in the one before, so 32 bytes hold it all."""

    def __init__(self, state: bytes = bytes(32)) -> None:
        self.state = state

    def update(self, world: World, scans: Sequence[np.ndarray], mail_digests: Mapping[str, bytes]) -> None:
        """Take one tick in: the world, the scans given to the agents (float32), and name -> digest of the mail it heard."""
        sha = hashlib.sha256(self.state)
        sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
        for array in (world.pose, world.coupled, world.fill, world.row_picked, world.alive, np.concatenate([_NOTHING, *scans])):
            sha.update(_little_endian(array))
        for name in sorted(mail_digests):
            sha.update(b"%d %d " % (len(name.encode()), len(mail_digests[name])) + name.encode() + mail_digests[name])
        self.state = sha.digest()

    def hexdigest(self) -> str:
        """64 hexadecimal digits, of all ticks so far."""
        return self.state.hex()


def _little_endian(array: np.ndarray) -> memoryview:
    """An array's bytes, the same on every machine."""
    return np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.kind + str(array.itemsize)]).data
