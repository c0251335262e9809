"""The step that all modes share: observe, apply the actions, account. The modes differ only in the source of the actions."""

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from orchard.contract.agent import Action, Hold, Observations, Scans, state_of
from orchard.contract.events import Event
from orchard.contract.messages import Deed, Flatten
from orchard.field.kinds import kind_of
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.sim import batteries, stops
from orchard.sim.invariants import Invariants
from orchard.sim.lookahead import Lookahead
from orchard.sim.physics import harvest_is_over, step
from orchard.sim.restore import fitting, world_from
from orchard.sim.scan import Scanner, observe
from orchard.sim.sensors import Sensors
from orchard.sim.snapshot import Snapshot
from orchard.sim.state_times import StateTimes
from orchard.sim.world import World

Stepped = tuple[np.ndarray, dict[str, bytes], list[Event]]  # ranges before, mail digests, events


class Engine:
    """The simulation of one orchard. At each tick call `observe()`, then `due()`, then `advance()` with the actions of those that are due.

    A body without an action stands still, unless its agent holds its velocity. Actions are applied in the layout's order, never in the
    order of arrival. A caller with more urgent work can call `step()` instead of `advance()`, and `account()` later.
    """

    def __init__(
        self,
        world: World,
        digest: bytes = bytes(32),
        before: Mapping[str, Any] | None = None,
        holds: type[Lookahead] = Lookahead,
        is_hashed: bool = True,
    ) -> None:
        """`digest`, `before`: of a resumed run, its hash so far and what `figures_as_data` returned.

        `holds`: which agents are asked at a tick. `is_hashed`: False for a run of a study, of which only the figures are wanted.
        """
        self.world, self.layout, self.is_hashed = world, world.layout, is_hashed
        self._scanner, self.sensors = Scanner(world), Sensors(world)
        self._scans: Scans | None = None
        before = before or {}
        #: The newest action of each agent that drives or holds. Of a resumed run: what it said of itself.
        self.actions = self._said(before.get("said", {}))
        self.answers: dict[
            str, Action | None
        ] = {}  # of the agents that were asked at the last tick; None: it gave no action
        self.lookahead = holds(world, self._scanner.begin, before.get("asked"))
        self._invariants = Invariants(world, before.get("invariants"))
        self._states = StateTimes(world, before.get("states"))
        self._digest = digest
        self._stepped: Stepped | None = None  # a step that is not accounted for yet
        self._news = msgspec.convert(
            before.get("news", []), list[Event]
        )  # events of stops and resets, which the next step returns

    @classmethod
    def begin(
        cls, scenario: Scenario, holds: type[Lookahead] = Lookahead, is_hashed: bool = True
    ) -> "Engine":
        """Return an orchard at tick 0."""
        return cls(World(lay_out(scenario)), holds=holds, is_hashed=is_hashed)

    @classmethod
    def resume(
        cls, snapshot: Snapshot, holds: type[Lookahead] = Lookahead, is_hashed: bool = True
    ) -> "Engine":
        """Return the orchard of a snapshot. Raises SnapshotError if the snapshot is inconsistent."""
        with fitting(snapshot):
            return cls(world_from(snapshot), snapshot.digest, snapshot.figures, holds, is_hashed)

    def rehearse(self) -> None:
        """Do a step in a separate world with the same bodies, so that all kernels are compiled, or loaded, before the first tick."""
        rehearsal = Engine(World(self.layout))
        rehearsal.observe()
        rehearsal.due(())
        weeds = [name for name in self.layout.names if kind_of(name) == "weed"]
        rehearsal.advance(
            {name: Action(deeds=[Flatten()]) for name in weeds[:1]}
            | {self.layout.names[0]: Action(hold=Hold(1))},
            {},
        )
        rehearsal.violations()

    def figures_as_data(self) -> dict[str, Any]:
        """Return the state besides the world and the hash as plain data, for a snapshot's figures."""
        figures = {
            "invariants": self.invariants.known,
            "states": self.states.counts,
            "news": self._news,
            "asked": self.lookahead.asked,
            "said": {name: said_in(action) for name, action in self.actions.items()},
        }
        return {name: msgspec.to_builtins(figure) for name, figure in figures.items()}

    def as_data(self) -> dict[str, Any]:
        return {
            name: value.tobytes() if isinstance(value, np.ndarray) else value
            for name, value in self.world.state.items()
        }

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
        """The number of steps that the run has done, 0.1 s each."""
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
        """The run's hash in hexadecimal digits; '' for a run that is not hashed."""
        return self.digest.hex() if self.is_hashed else ""

    @property
    def scans(self) -> Scans:
        """The scans at the last observed tick, m, float32, one array for each body.

        Before any tick was observed they are those of now.
        """
        if self._scans is None:
            self._scans = self._scanner.scan(self.world)
        return self._scans

    def observe(self) -> Observations:
        """Return what all bodies observe at this tick: poses and twists as their sensors measure them."""
        self._scans = self._scanner.scan(self.world)
        return self.sensors.measured(self.truth())

    def truth(self) -> Observations:
        """Return what all bodies would observe with exact sensors: for viewers and evaluation, never for agents."""
        return observe(self.world, self.scans)

    def odometry(self) -> Observations:
        """Return the same with the poses of odometry alone, in each robot's frame `odom`: its measured motion from its start on."""
        return self.sensors.reckoned(self.truth())

    def due(self, mail: Collection[str]) -> list[str]:
        """Return the agents that are asked at this tick, in the layout's order; once a tick, after `observe()`. `mail`: those that hear."""
        return self.lookahead.due(self.world, self.scans.ranges, mail)

    @property
    def asked_share(self) -> float:
        """Agents that were asked, of all agents and ticks so far."""
        return self.lookahead.asked / (self.tick * len(self.layout.agents)) if self.tick else 0.0

    def wake(self, names: Iterable[str]) -> None:
        """End the holds of these agents: they are asked at the next tick, and without an action their bodies stand."""
        self.lookahead.wake(names)

    def advance(
        self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]
    ) -> list[Event]:
        """Do one step of 0.1 s with these actions, and return its events. `mail_digests`: agent -> digest of what it heard."""
        events = self.step(actions, mail_digests)
        self.account()
        return events

    def step(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Do what `advance` does, without accounting for the step."""
        self.account()
        self.answers = self.lookahead.hold(self.world, self.scans.ranges, actions)
        self.actions = {
            name: action
            for name, action in (self.actions | self.answers).items()
            if action is not None
        }
        events, self._news = (
            self._news + step(self.world, self.lookahead.wanted, self._deeds(actions)),
            [],
        )
        self.sensors.advance()
        self.lookahead.wake(event.who for event in events if event.what in batteries.NEWS)
        heard = (
            {name: mail_digests[name] for name in self.layout.agents if mail_digests.get(name)}
            if mail_digests
            else {}
        )
        self._stepped = self.scans.ranges, heard, events  # mail to unknown names is left out
        return events

    def account(self) -> None:
        """Add the last step, once, to the hash, the invariants and the times in states: before whatever needs or changes these."""
        if self._stepped is not None:
            (ranges, heard, events), self._stepped = self._stepped, None
            if self.is_hashed:
                self._digest = next_digest(self._digest, self.world, ranges, heard)
            self._invariants.update(self.world, events)
            self._states.update(self.world, self.answers)

    def violations(self) -> list[str]:
        """Return a sentence for each invariant that the run has broken, and each agent that holds wrongly. Call it at the end of a run."""
        return [
            *self.invariants.end(self.world, self.over),
            *self.states.faults(self.world),
            *self.lookahead.wrong,
        ]

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

    def _said(self, said: Any) -> dict[str, Action]:
        """Return actions that say of their robots what they did when a snapshot was made."""
        known = msgspec.convert(said, dict[str, Action])
        return {name: action for name, action in known.items() if name in self.layout.agents}

    def _deeds(self, actions: Mapping[str, Action]) -> list[tuple[int, Deed]]:
        """In body order."""
        doers = sorted(
            self.layout.index[name]
            for name, action in actions.items()
            if action.deeds and name in self.layout.index
        )
        return [(i, deed) for i in doers for deed in actions[self.layout.names[i]].deeds]


def said_in(action: Action) -> dict[str, Any]:
    """Return what an action says of its robot, as plain data: the fields of an action that only does this."""
    return {
        "doing": action.doing,
        "state": state_of(action),
        "waits_for": action.waits_for,
        "steps_done": action.steps_done,
    }


class Unaudited(Engine):
    """An engine for runs of which only the motion is wanted, such as those in which a policy learns: no hash, no invariants, no figures."""

    def account(self) -> None:
        self._stepped = None


_LITTLE = {kind: np.dtype(kind).newbyteorder("<") for kind in "dflq?"}


def next_digest(
    before: bytes, world: World, ranges: np.ndarray, mail_digests: Mapping[str, bytes]
) -> bytes:
    """Return SHA-256 over all state and the digest before. `ranges`: all scans (float32); `mail_digests`: agent -> what it heard."""
    sha = hashlib.sha256(before)
    sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
    charge = (world.charge, world.plugged) if world.layout.first_charging else ()
    for array in (
        world.pose,
        world.coupled,
        world.fill,
        world.row_picked,
        world.alive,
        ranges,
        *charge,
    ):
        sha.update(
            np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.char]).data
        )  # the same on every machine
    for name in sorted(mail_digests):
        sha.update(
            b"%d %d " % (len(name.encode()), len(mail_digests[name]))
            + name.encode()
            + mail_digests[name]
        )
    return sha.digest()
