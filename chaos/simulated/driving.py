"""Whether physics does what drivers ask for: the sessions and clients that drive robots.

Each deed is done or refused, once, and advice drives for as long as it may. That is checked without
another run to compare with, so also in realtime, and where agents were lost.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from chaos.simulated.census import KEYS
from orchard.contract.events import Event
from orchard.contract.messages import Couple, Deed, Flatten, PickFrom, Uncouple
from orchard.field.geometry import STILL, Twist
from orchard.sim.engine import Engine
from orchard.wire.codec import twist_of, velocities_of
from orchard.wire.messages import Advice, Velocity, read

# Steps that one piece of advice drives at most, as keyspace.md promises.
ADVICE_TICKS = 5
# Steps in turn in which a robot may ask for deeds, and none is done or refused.
PATIENCE = 10
# Event -> the deed that it shows to be done.
DONE: dict[str, type] = {
    "coupled": Couple,
    "uncoupled": Uncouple,
    "picks from": PickFrom,
    "weed flattened": Flatten,
}
REFUSED = "deed refused"


class Driving:
    """Follows what arrives at one physics process, and the steps that it does."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        # Robot -> the deeds that came since the last step.
        self._wanted: dict[str, list[Deed]] = {}
        # Robots with deeds that came between the two steps before.
        self._wanted_before: set[str] = set()
        # Robot -> steps in turn in which it asked for deeds in vain.
        self._in_vain: dict[str, int] = {}
        # Robot -> velocity -> the newest tick at which it was advised.
        self._advised: dict[str, dict[Twist, int]] = {}
        self.complaints: list[str] = []

    def hear(self, key: str, payload: bytes) -> None:
        """Take what arrives at physics."""
        with suppress(ValueError):
            match KEYS.parts(key):
                case [name, "advice"]:
                    advice = read(payload, Advice)
                    self._advised.setdefault(name, {})[twist_of(advice)] = advice.tick
                case [name, "velocity"] if b"deeds" in payload:
                    self._want(name, read(payload, Velocity).deeds)
                case ["hosts", _, "velocities"] if b"deeds" in payload:
                    for name, report in velocities_of(payload)[0].velocities.items():
                        self._want(name, report.deeds)

    def _want(self, name: str, deeds: Sequence[Deed]) -> None:
        """Note the deeds that a robot asks for."""
        if deeds:
            self._wanted.setdefault(name, []).extend(deeds)

    def step(self, tick: int, events: Sequence[Event]) -> None:
        """Look at a step that physics has reported."""
        if not self.complaints:
            self.complaints += [*self._of_deeds(tick, events), *self._of_advice(tick)]
        # Physics reports a step after it has published the next tick, so answers to that tick may
        # have come already. What was asked for before the step counts for one more report.
        self._wanted_before = set(self._wanted)
        self._wanted = {}

    def _of_deeds(self, tick: int, events: Sequence[Event]) -> Iterator[str]:
        """Complain about a robot whose deeds are neither done nor refused for PATIENCE steps.

        Complain about one, too, that does a deed which was not asked for, or does it again.
        """
        served = {event.who for event in events if event.what in DONE or event.what == REFUSED}
        for name in sorted(served - self._wanted.keys() - self._wanted_before):
            yield f"{name} does a deed that was not asked for: tick {tick}"
        for name in self._wanted:
            if name in served or not self._may_act(name):
                self._in_vain[name] = 0
                continue
            self._in_vain[name] = self._in_vain.get(name, 0) + 1
            if self._in_vain[name] >= PATIENCE:
                yield f"{name} asks for deeds in vain: tick {tick}"

    def _may_act(self, name: str) -> bool:
        """Whether a robot is neither stopped nor flat."""
        world = self._engine.world
        body = self._engine.layout.index.get(name)
        if body is None:
            return False
        return not world.stopped[body] and bool(world.charge[body] > 0.0)

    def _of_advice(self, tick: int) -> Iterator[str]:
        """Complain about a robot that drives by advice that is over."""
        for name, known in self._advised.items():
            action = self._engine.actions.get(name)
            if action is None or action.twist == STILL or action.twist not in known:
                continue
            last = known[action.twist]
            if tick - last >= ADVICE_TICKS:
                yield f"{name} is driven by advice of tick {last}: tick {tick}"
