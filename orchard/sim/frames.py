"""Makes the frames that a picture is made of: from the world at each tick, only what has changed."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchard.contract.agent import Action
from orchard.contract.events import SCAN_TICKS, STOPPED, Event, Frame
from orchard.contract.messages import Answer, Call, Come, EmptyBin, Here, Offer, Request, kind_of_message
from orchard.sim.stops import as_shown

if TYPE_CHECKING:
    from orchard.sim.world import World
WHOLE_TICKS = 50  # every five seconds a frame says everything, for those who came late


class FrameBuilder:
    """Looks at one world."""

    def __init__(self, world: "World") -> None:
        self._world = world
        self._shown: dict[str, np.ndarray] = {}
        self._doing: dict[str, str] = {}

    def frame(self, scans: Sequence[np.ndarray], actions: Mapping[str, Action], events: Sequence[Event]) -> Frame:
        """The world as it is now, after the step in which these actions were done and these events happened."""
        world = self._world
        if world.tick % WHOLE_TICKS == 0:
            self.forget()
        return Frame(
            tick=world.tick,
            poses=world.pose.copy(),
            doing=self._news_of(as_shown(world, actions)),
            scans=list(scans) if world.tick % SCAN_TICKS == 0 else None,
            coupled=self._if_changed("coupled", world.coupled),
            fill=self._if_changed("fill", world.fill),
            alive=self._if_changed("alive", world.alive),
            row_picked=self._if_changed("row_picked", world.row_picked),
            delivered=world.delivered,
            events=events,
        )

    def forget(self) -> None:
        """The next frame says everything."""
        self._shown, self._doing = {}, {}

    def _if_changed(self, what: str, now: np.ndarray) -> np.ndarray | None:
        if what in self._shown and (self._shown[what] == now).all():
            return None
        self._shown[what] = now.copy()
        return self._shown[what]

    def _news_of(self, actions: Mapping[str, Action]) -> dict[str, str]:
        said = {name: "standing" for name, words in self._doing.items() if words == STOPPED}  # unless it has an agent, which knows more
        said |= {name: words_of(action) for name, action in actions.items() if action.doing}
        news = {name: words for name, words in said.items() if self._doing.get(name) != words}
        self._doing |= news
        return news


def words_of(action: Action) -> str:
    """What a robot does, and whether it is held up by something in its way."""
    return f"{action.doing}, held up by {action.waits_for}" if "obstacle" in action.waits_for else action.doing


def talk_of(tick: int, name: str, requests: Sequence[tuple[str, Request]], answers: Sequence[tuple[str, Answer]]) -> list[Event]:
    """The messages that agent `name` sent at a tick, as events; `requests` and `answers`: (recipient, message)."""
    return [Event(tick, kind_of_message(body), name, to, _said(body)) for to, body in [*requests, *answers]]


def _said(body: Request | Answer) -> str:
    if isinstance(body, Call):
        return f"who is free? row {body.lane}, {body.side} end"
    if isinstance(body, Come):
        return f"come, row {body.lane}, {body.side} end"
    if isinstance(body, Offer):
        return f"I am, {body.distance:.0f} m away"
    if isinstance(body, EmptyBin):
        return "who brings me one?"
    if isinstance(body, Here):
        return f"here is {body.bin}"
    return getattr(body, "reason", "") or getattr(body, "carrier", "")
