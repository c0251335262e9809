"""Makes the frames of a picture from the world at each tick. A frame holds only what has changed."""

from typing import Any

import numpy as np

from orchard.contract.agent import Action, State, state_of
from orchard.contract.events import SCAN_TICKS, SELDOM, STOPPED, Event, Frame, Velocities
from orchard.field.scenario import TICKS_PER_SECOND
from orchard.sim.engine import Engine
from orchard.sim.obstacles import PLACES
from orchard.sim.stops import as_shown

WHOLE_TICKS = 50  # ticks between two whole frames, 5 s, for viewers that join later


class FrameBuilder:
    """Makes the frames of one engine's world."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.forget()

    def frame(self, events: list[Event]) -> Frame:
        """Return the frame of the world after a step, with the events of the step. Units and shapes are those of `Frame`."""
        world, scans = self._engine.world, self._engine.scans
        if world.tick % WHOLE_TICKS == 0:
            self.forget()
        is_whole = (
            not self._shown
        )  # not: all fields are there; after some ticks without a frame they may all have changed
        news = self._news_of()
        seldom: dict[str, Any] = {
            name: self._if_changed(name, getattr(world, name)) for name in SELDOM
        }
        return Frame(
            tick=world.tick,
            poses=world.pose.copy(),
            doing={name: words for name, (words, _) in news.items()},
            states={name: state for name, (_, state) in news.items()},
            scans=list(scans) if world.tick % SCAN_TICKS == 0 else None,
            delivered=world.delivered,
            events=events,
            is_whole=is_whole,
            velocities=self._new_velocities(
                np.concatenate([world.twist, self._engine.lookahead.wanted], axis=1)
            ),
            charges=self._charges(is_whole),
            **seldom,
        )

    def _charges(self, is_whole: bool) -> dict[str, float]:
        """Return the charges of all batteries, once a second and in a whole frame."""
        world = self._engine.world
        is_due = is_whole or world.tick % TICKS_PER_SECOND == 0
        if not is_due or not world.layout.scenario.has_batteries:
            return {}
        carriers = world.fixed.carriers
        names = [world.layout.names[carrier] for carrier in carriers]
        return dict(zip(names, world.charge[carriers].tolist(), strict=True))

    def forget(self) -> None:
        self._shown, self._said = dict[str, bytes](), dict[str, tuple[str, State]]()
        self._drove, self._tick = (
            np.zeros((0, 6)),
            -1,
        )  # of the newest frame: the velocities, as in `Velocities`, and its tick
        self._halted, self._hindered = (
            list[str](),
            list[str](),
        )  # robots that are shown as stopped, and those with an obstacle in the way

    def _if_changed(self, what: str, now: np.ndarray) -> np.ndarray | None:
        if self._shown.get(what) == (shown := now.tobytes()):
            return None
        self._shown[what] = shown
        return now.copy()

    def _new_velocities(self, now: np.ndarray) -> dict[str, Velocities]:
        changed = (
            (self._drove != now).any(axis=1).nonzero()[0]
            if len(self._drove)
            else np.arange(len(now))
        )
        self._drove, names = now, self._engine.layout.names
        return {
            names[i]: tuple(own)
            for i, own in zip(changed.tolist(), now[changed].tolist(), strict=True)
        }

    def _news_of(self) -> dict[str, tuple[str, State]]:
        """Return what robots do that did something else. Beside new actions, bodies in the way and stops change what is said of a robot."""
        engine = self._engine
        said: dict[str, tuple[str, State]] = dict.fromkeys(self._halted, ("standing", "resting"))
        names = (
            [*engine.answers, *self._hindered, *self._halted]
            if engine.tick == self._tick + 1
            else engine.actions
        )
        new = {name: engine.actions[name] for name in names if name in engine.actions}
        shown = as_shown(engine.world, new)
        said |= {
            name: (words_of(action), state_of(action))
            for name, action in shown.items()
            if action.doing or action.state
        }
        self._hindered, self._tick = (
            [name for name, action in new.items() if action.waits_for in PLACES],
            engine.tick,
        )
        self._halted = [name for name, (words, _) in said.items() if words == STOPPED]
        news = {name: now for name, now in said.items() if self._said.get(name) != now}
        self._said |= news
        return news


def words_of(action: Action) -> str:
    doing = action.doing or state_of(action)
    return (
        f"{doing}, held up by {action.waits_for}"
        if action.state == "stopped" and action.waits_for
        else doing
    )
