"""The step that all modes share: observe, apply the actions, account.

The modes differ only in the source of the actions: `orchard.local` asks the agents itself, and the
physics process (`orchard.server`) gets the actions by messages. To account for a step is to add it
to the run's hash, to the invariants and to the times of the robots in their states.
"""

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from orchard.contract.agent import Action, Hold, Observations, Scans, state_of
from orchard.contract.events import Event
from orchard.contract.messages import Deed, Flatten
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.sim import batteries, stops
from orchard.sim.invariants import Invariants
from orchard.sim.lookahead import Lookahead
from orchard.sim.physics import harvest_is_over
from orchard.sim.physics import step as step_world
from orchard.sim.restore import fitting, world_from
from orchard.sim.scan import Scanner, observe
from orchard.sim.sensors import Sensors
from orchard.sim.snapshot import Snapshot
from orchard.sim.state_times import StateTimes
from orchard.sim.world import World


class Stepped(NamedTuple):
    """A step that is not accounted for yet."""

    # All scans before the step, m, float32.
    ranges: np.ndarray
    # Agent -> the digest of what it heard.
    mail_digests: dict[str, bytes]
    events: list[Event]


class Engine:
    """The simulation of one orchard.

    At each tick call `observe()`, then `due()`, then `advance()` with the actions of those that are
    due. A body without an action stands still, unless its agent holds its velocity. Actions are
    applied in the layout's order, never in the order of arrival. A caller with more urgent work can
    call `step()` instead of `advance()`, and `account()` later.

    >>> from orchard.contract.agent import Twist
    >>> engine = Engine.begin(Scenario(rows=3))
    >>> before = engine.observe()["picker_01"].pose
    >>> asked = engine.due(mail=[])  # at the first tick all are
    >>> events = engine.advance({"picker_01": Action(Twist(x=0.5))}, mail_digests={})
    >>> after = engine.observe()["picker_01"].pose
    >>> round(abs(after.x - before.x) + abs(after.y - before.y), 6)  # m in 0.1 s
    0.05
    """

    def __init__(
        self,
        world: World,
        digest: bytes = bytes(32),
        before: Mapping[str, Any] | None = None,
        holds: type[Lookahead] = Lookahead,
        is_hashed: bool = True,
    ) -> None:
        """Simulate a world from its tick on.

        `digest`, `before`: of a resumed run, its hash so far and what `figures_as_data` returned.
        `holds`: the class that decides which agents are asked at a tick; see
        orchard/sim/lookahead.py. `is_hashed`: False for a run of a study, of which only the figures
        are wanted. Raises ValueError or KeyError if `before` does not fit the world.
        """
        self.world = world
        self.layout = world.layout
        self.is_hashed = is_hashed
        self._scanner = Scanner(world)
        self.sensors = Sensors(world)
        self._scans: Scans | None = None
        before = before or {}
        #: The newest action of each agent that drives or holds. Of a resumed run: what it reported
        #: of itself.
        self.actions = self._reported(before.get("said", {}))
        # The actions of the agents that were asked at the last tick; None: the agent gave none.
        self.answers: dict[str, Action | None] = {}
        self.lookahead = holds(world, self._scanner.begin, before.get("asked"))
        self._invariants = Invariants(world, before.get("invariants"))
        self._states = StateTimes(world, before.get("states"))
        self._digest = digest
        self._stepped: Stepped | None = None  # a step that is not accounted for yet
        # Events of stops and resets, which the next step returns.
        self._news = msgspec.convert(before.get("news", []), list[Event])

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
        """Return the orchard of a snapshot. Raises SnapshotError if that is inconsistent."""
        with fitting(snapshot):
            return cls(world_from(snapshot), snapshot.digest, snapshot.figures, holds, is_hashed)

    def rehearse(self) -> None:
        """Do a step in a separate world with the same bodies.

        After that all kernels are compiled or loaded, and the first tick takes no longer than
        others.
        """
        rehearsal = Engine(World(self.layout))
        rehearsal.observe()
        rehearsal.due(())
        # With a hold and a deed, the kernels of holds and of deeds are called too.
        actions = {self.layout.names[0]: Action(hold=Hold(1))}
        weeds = self.layout.names_of("weed")
        if weeds:
            actions[weeds[0]] = Action(deeds=[Flatten()])
        rehearsal.advance(actions, {})
        rehearsal.violations()

    def figures_as_data(self) -> dict[str, Any]:
        """Return the state besides the world and the hash as plain data, for a snapshot."""
        figures = {
            "invariants": self.invariants.known,
            "states": self.states.counts,
            "news": self._news,
            "asked": self.lookahead.asked,
            "said": {name: said_in(action) for name, action in self.actions.items()},
        }
        return {name: msgspec.to_builtins(figure) for name, figure in figures.items()}

    def as_data(self) -> dict[str, Any]:
        """Return the world as plain data, for a snapshot: numbers, and arrays as bytes."""
        data = dict(self.world.state)
        for name, value in data.items():
            if isinstance(value, np.ndarray):
                data[name] = value.tobytes()
        return data

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
    def scenario(self) -> Scenario:
        """The scenario that is simulated."""
        return self.layout.scenario

    @property
    def tick(self) -> int:
        """The number of steps that the run has done, 0.1 s each."""
        return self.world.tick

    @property
    def over(self) -> bool:
        """Whether the harvest is over.

        Then all rows are picked, all full bins unloaded, and the carriers back in the queue.
        """
        return harvest_is_over(self.world)

    @property
    def digest(self) -> bytes:
        """The run's hash, 32 bytes: SHA-256 over all ticks so far."""
        self.account()
        return self._digest

    @property
    def hash(self) -> str:
        """The run's hash in hexadecimal digits; '' for a run that is not hashed."""
        if not self.is_hashed:
            return ""
        return self.digest.hex()

    @property
    def scans(self) -> Scans:
        """The scans at the last observed tick, m, float32, one array for each body.

        Before any tick was observed they are those of now.
        """
        if self._scans is None:
            self._scans = self._scanner.scan(self.world)
        return self._scans

    def observe(self) -> Observations:
        """Return what all bodies observe now, with poses and twists as sensors measure them."""
        self._scans = self._scanner.scan(self.world)
        return self.sensors.measured(self.truth())

    def truth(self) -> Observations:
        """Return what all bodies would observe with exact sensors.

        It is for viewers and evaluation, never for agents.
        """
        return observe(self.world, self.scans)

    def odometry(self) -> Observations:
        """Return what `truth` does, but with the poses of odometry alone, in each robot's frame
        `odom`.

        They add up the robot's measured motion from its start on.
        """
        return self.sensors.reckoned(self.truth())

    def due(self, mail: Collection[str]) -> list[str]:
        """Return the agents that are asked at this tick, in the layout's order.

        Call it once a tick, after `observe()`. `mail`: the agents that hear something.
        """
        return self.lookahead.due(self.world, self.scans.ranges, mail)

    @property
    def asked_share(self) -> float:
        """The share of agents that were asked, of all agents and ticks so far; 0 to 1."""
        if self.tick == 0:
            return 0.0
        return self.lookahead.asked / (self.tick * len(self.layout.agents))

    def wake(self, names: Iterable[str]) -> None:
        """End the holds of these agents.

        They are asked at the next tick, and without an action their bodies stand.
        """
        self.lookahead.wake(names)

    def advance(
        self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]
    ) -> list[Event]:
        """Do one step of 0.1 s with these actions, and return its events.

        `mail_digests`: agent -> the digest of what it heard, for the run's hash.
        """
        events = self.step(actions, mail_digests)
        self.account()
        return events

    def step(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Do what `advance` does, without accounting for the step."""
        self.account()
        self.answers = self.lookahead.apply(self.world, self.scans.ranges, actions)
        newest = self.actions | self.answers
        self.actions = {name: action for name, action in newest.items() if action is not None}
        events = self._news + step_world(self.world, self.lookahead.wanted, self._deeds(actions))
        self._news = []
        self.sensors.advance()
        self.lookahead.wake(event.who for event in events if event.what in batteries.NEWS)
        # What each agent heard is hashed, too.
        heard = {}
        if mail_digests:
            # Mail to unknown names is left out.
            for name in self.layout.agents:
                if mail_digests.get(name):
                    heard[name] = mail_digests[name]
        self._stepped = Stepped(self.scans.ranges, heard, events)
        return events

    def account(self) -> None:
        """Add the last step, once, to the hash, the invariants and the times in states.

        Call it before whatever needs or changes these. It is apart from `step` so that physics can
        send the new observations first.
        """
        stepped = self._stepped
        if stepped is None:
            return
        self._stepped = None
        if self.is_hashed:
            self._digest = next_digest(
                self._digest, self.world, stepped.ranges, stepped.mail_digests
            )
        self._invariants.update(self.world, stepped.events)
        self._states.update(self.world, self.answers)

    def violations(self) -> list[str]:
        """Return a sentence for each invariant that the run has broken.

        There is one too for each agent that holds wrongly. Call it at the end of a run.
        """
        return [
            *self.invariants.end(self.world, self.over),
            *self.states.faults(self.world),
            *self.lookahead.wrong,
        ]

    def stop(self, words: Sequence[str] = ()) -> list[str]:
        """Stop the robots with these names or kinds, or all without any, until they are reset.

        Return those that were not stopped before. Raises ValueError for a word that is no robot's
        name or kind; then no robot is stopped.
        """
        return self._latch(words, "stopped")

    def reset(self, words: Sequence[str] = ()) -> list[str]:
        """Let these robots, or all, go on. Return those that were stopped before.

        Raises ValueError as `stop` does.
        """
        return self._latch(words, "reset")

    def _latch(self, words: Sequence[str], what: Literal["stopped", "reset"]) -> list[str]:
        """Stop or reset robots, and note an event for each that changes."""
        self.account()
        changed = stops.latch(self.world, words, what == "stopped")
        self._news += [Event(self.tick, what, name) for name in changed]
        return changed

    def _reported(self, actions: Any) -> dict[str, Action]:
        """Return actions that say of their robots what they did when a snapshot was made."""
        known = msgspec.convert(actions, dict[str, Action])
        return {name: action for name, action in known.items() if name in self.layout.agents}

    def _deeds(self, actions: Mapping[str, Action]) -> list[tuple[int, Deed]]:
        """Return the deeds of all bodies, (body index, deed), in body order."""
        index = self.layout.index
        doers = [name for name, action in actions.items() if action.deeds and name in index]
        deeds: list[tuple[int, Deed]] = []
        for name in sorted(doers, key=index.__getitem__):
            deeds += [(index[name], deed) for deed in actions[name].deeds]
        return deeds


def said_in(action: Action) -> dict[str, Any]:
    """Return what an action says of its robot, as plain data: the fields of an action that only
    does this.
    """
    return {
        "doing": action.doing,
        "state": state_of(action),
        "waits_for": action.waits_for,
        "steps_done": action.steps_done,
    }


class Unaudited(Engine):
    """An engine without hash, invariants and figures.

    It is for runs of which only the motion is wanted, such as those in which a policy learns.
    """

    def account(self) -> None:
        """Forget the last step."""
        self._stepped = None


# Numpy's letter of a type -> the type as it is hashed: little endian. The letters are float64,
# float32, two names of int64, and bool.
_LITTLE = {kind: np.dtype(kind).newbyteorder("<") for kind in "dflq?"}


def next_digest(
    before: bytes, world: World, ranges: np.ndarray, mail_digests: Mapping[str, bytes]
) -> bytes:
    """Return SHA-256 over all state and the digest before, 32 bytes, the same on every machine.

    `ranges`: all scans, m, float32. `mail_digests`: agent -> the digest of what it heard. State
    that cannot change in a scenario, such as the charge without batteries, is left out.
    """
    sha = hashlib.sha256(before)
    sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
    arrays = [world.pose, world.coupled, world.fill, world.row_picked, world.alive, ranges]
    if world.layout.first_charging:
        arrays += [world.charge, world.plugged]
    if world.layout.machines["carrier"].haul_ticks:
        arrays.append(world.hauling)
    if world.layout.machines["carrier"].trailer_ticks:
        arrays.append(world.trailers)
    if world.layout.machines["carrier"].truck_ticks:
        arrays.append(np.array([world.waiting_bins], dtype=np.int64))
    for array in arrays:
        sha.update(np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.char]).data)
    for name in sorted(mail_digests):
        encoded = name.encode()
        digest = mail_digests[name]
        sha.update(b"%d %d " % (len(encoded), len(digest)) + encoded + digest)
    return sha.digest()
