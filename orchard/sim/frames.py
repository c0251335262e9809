"""Makes the frames of a picture from the world at each tick. A frame holds only what has changed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from orchard.contract.agent import Action, State, state_of
from orchard.contract.events import SCAN_TICKS, SELDOM, STOPPED, Event, Frame, Velocities
from orchard.sim.stops import as_shown
from orchard.sim.world import World

WHOLE_TICKS = 50  # ticks between two whole frames, 5 s, for viewers that join later


class FrameBuilder:
    """Makes the frames of one world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.forget()

    def frame(self, scans: Sequence[np.ndarray], actions: Mapping[str, Action], events: Sequence[Event], wanted: np.ndarray) -> Frame:
        """Return the frame of the world after a step. `wanted`: (n, 3) the velocities that the agents wanted in it, m/s and rad/s."""
        world = self._world
        if world.tick % WHOLE_TICKS == 0:
            self.forget()
        is_whole = not self._shown  # not: all fields are there; after some ticks without a frame they may all have changed
        news = self._news_of(as_shown(world, actions))
        seldom: dict[str, Any] = {name: self._if_changed(name, getattr(world, name)) for name in SELDOM}
        return Frame(
            tick=world.tick,
            poses=world.pose.copy(),
            doing={name: words for name, (words, _) in news.items()},
            states={name: state for name, (_, state) in news.items()},
            scans=list(scans) if world.tick % SCAN_TICKS == 0 else None,
            delivered=world.delivered,
            events=events,
            is_whole=is_whole,
            velocities=self._new_velocities(np.hstack([world.twist, wanted])),
            **seldom,
        )

    def forget(self) -> None:
        self._shown, self._said = dict[str, np.ndarray](), dict[str, tuple[str, State]]()
        self._drove = np.zeros((0, 6))

    def _if_changed(self, what: str, now: np.ndarray) -> np.ndarray | None:
        if what in self._shown and (self._shown[what] == now).all():
            return None
        self._shown[what] = now.copy()
        return self._shown[what]

    def _new_velocities(self, now: np.ndarray) -> dict[str, Velocities]:
        changed = (self._drove != now).any(axis=1) if len(self._drove) else np.ones(len(now), dtype=bool)
        self._drove, names = now, self._world.layout.names
        return {names[i]: tuple(now[i].tolist()) for i in np.flatnonzero(changed).tolist()}

    def _news_of(self, actions: Mapping[str, Action]) -> dict[str, tuple[str, State]]:
        said: dict[str, tuple[str, State]] = {name: ("standing", "resting") for name, (words, _) in self._said.items() if words == STOPPED}
        said |= {name: (words_of(action), state_of(action)) for name, action in actions.items() if action.doing or action.state}
        news = {name: now for name, now in said.items() if self._said.get(name) != now}
        self._said |= news
        return news


def words_of(action: Action) -> str:
    doing = action.doing or state_of(action)
    return f"{doing}, held up by {action.waits_for}" if action.state == "stopped" and action.waits_for else doing
