"""Makes the frames of a picture from the world at each tick.

The picture is what viewers, recordings and the web page show of a run. `orchard.server.account`
asks for a frame after each step. A frame holds only what has changed since the one
before, and now and then all of it ("a whole frame").
"""

from typing import Any

import numpy as np

from orchard.contract.agent import Action, State, state_of
from orchard.contract.events import SCAN_TICKS, SELDOM, STOPPED, Event, Frame, Velocities
from orchard.field.scenario import TICKS_PER_SECOND
from orchard.sim.engine import Engine
from orchard.sim.obstacles import PLACES
from orchard.sim.stops import as_shown

# Ticks between two whole frames, 5 s, for viewers that join later.
WHOLE_TICKS = 50


class FrameBuilder:
    """Makes the frames of one engine's world."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.forget()

    def frame(self, events: list[Event]) -> Frame:
        """Return the frame of the world after a step, with the events of the step.

        Units and shapes are those of `Frame`.
        """
        world = self._engine.world
        if world.tick % WHOLE_TICKS == 0:
            self.forget()
        # `forget` empties `_shown`, and the loop below fills it. A frame with all fields need not
        # be whole: after some ticks without a frame all of them may have changed.
        is_whole = not self._shown
        news = self._changed_words()
        velocities = np.concatenate([world.twist, self._engine.lookahead.wanted], axis=1)
        doing = {}
        states = {}
        for name, (words, state) in news.items():
            doing[name] = words
            states[name] = state
        seldom: dict[str, Any] = {}
        for name in SELDOM:
            seldom[name] = self._if_changed(name, getattr(world, name))
        return Frame(
            tick=world.tick,
            poses=world.pose.copy(),
            doing=doing,
            states=states,
            scans=self._scans_if_due(),
            delivered=world.delivered,
            waiting_bins=world.waiting_bins,
            events=events,
            is_whole=is_whole,
            velocities=self._new_velocities(velocities),
            charges=self._charges(is_whole),
            **seldom,
        )

    def _scans_if_due(self) -> list[np.ndarray] | None:
        """Return the scans of all bodies, every `SCAN_TICKS`; else None."""
        if self._engine.tick % SCAN_TICKS:
            return None
        return list(self._engine.scans)

    def _charges(self, is_whole: bool) -> dict[str, float]:
        """Return the charges of all batteries, once a second and in a whole frame."""
        world = self._engine.world
        is_due = is_whole or world.tick % TICKS_PER_SECOND == 0
        if not is_due or not world.layout.scenario.has_batteries:
            return {}
        carriers = world.fixed.carriers
        names = world.layout.names_at(carriers.tolist())
        return dict(zip(names, world.charge[carriers].tolist(), strict=True))

    def forget(self) -> None:
        """Make the next frame a whole one."""
        # Field -> its bytes in the newest frame that had it.
        self._shown: dict[str, bytes] = {}
        # Robot -> the words and the state in which it was last shown.
        self._words: dict[str, tuple[str, State]] = {}
        # Of the newest frame: the velocities, as in `Velocities`, and its tick.
        self._velocities = np.zeros((0, 6))
        # -1: there is none, so the words of all robots are due.
        self._tick = -1
        # Names of the robots that are shown as stopped, and of those with an obstacle in the way.
        self._halted: list[str] = []
        self._hindered: list[str] = []

    def _if_changed(self, field: str, now: np.ndarray) -> np.ndarray | None:
        """Return a copy of an array if it is not as in the frame before, else None."""
        shown = now.tobytes()
        if self._shown.get(field) == shown:
            return None
        self._shown[field] = shown
        return now.copy()

    def _new_velocities(self, now: np.ndarray) -> dict[str, Velocities]:
        """Return the velocities that have changed, by name. `now`: those of all bodies, (n, 6)."""
        if len(self._velocities):
            changed = (self._velocities != now).any(axis=1).nonzero()[0]
        else:
            changed = np.arange(len(now))
        self._velocities = now
        names = self._engine.layout.names_at(changed.tolist())
        return dict(zip(names, map(tuple, now[changed].tolist()), strict=True))

    def _changed_words(self) -> dict[str, tuple[str, State]]:
        """Return the words and the state of each robot that is shown otherwise than before.

        Beside new actions, bodies in the way and stops change how a robot is shown.
        """
        engine = self._engine
        # After the tick of the frame before, only these robots can be shown otherwise.
        if engine.tick == self._tick + 1:
            names = [*engine.answers, *self._hindered, *self._halted]
        else:
            names = list(engine.actions)
        new = {name: engine.actions[name] for name in names if name in engine.actions}
        # A robot that was stopped and has no action now stands.
        words: dict[str, tuple[str, State]] = dict.fromkeys(self._halted, ("standing", "resting"))
        for name, action in as_shown(engine.world, new).items():
            if action.doing or action.state:
                words[name] = (words_of(action), state_of(action))
        self._hindered = [name for name, action in new.items() if action.waits_for in PLACES]
        self._tick = engine.tick
        self._halted = [name for name, (doing, _) in words.items() if doing == STOPPED]
        changed = {name: now for name, now in words.items() if self._words.get(name) != now}
        self._words |= changed
        return changed


def words_of(action: Action) -> str:
    """Return what an agent does, and what holds its robot up, as a phrase for people."""
    doing = action.doing or state_of(action)
    if action.state == "stopped" and action.waits_for:
        return f"{doing}, held up by {action.waits_for}"
    return doing
