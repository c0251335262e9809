"""Agents that may have mistakes in them: a mistake is told with its place, its robot stands, and the others go on."""

import logging
import traceback
from typing import Any

from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.mail import written_by
from orchard.contract.messages import FASTEST, MAX_PAYLOAD, MOST_DEEDS, Answer, Deed, Request, Written, pack, unpack
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of

log = logging.getLogger("orchard")

LARGEST_MEMORY = MAX_PAYLOAD // 32  # bytes: those of all agents of a session travel in one message when another takes over
MISTAKES = (Exception, SystemExit)  # one agent's sys.exit() ends neither the others of its process nor the run


class Guarded:
    """An agent whose actions are looked at before they count."""

    def __init__(self, name: str, agent: Agent) -> None:
        self.name = name
        self.Memory = getattr(agent, "Memory", dict)
        kind = KINDS.get(kind_of(name))
        self._sideways = kind is None or kind.sideways
        self.packed: bytes | None = None  # its memory, as it travels
        self._agent = agent
        self._failed = False

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        try:
            action = self._agent.tick(observation, mail, memory)
            _check(action)
            if action.twist.y and not self._sideways:
                raise ValueError(f"{action.twist}: a {kind_of(self.name)} does not move sideways")
            self.packed = None if action.memory is None else _packed(action.memory)
        except MISTAKES:
            self._tell(observation.tick)
            return Action(memory=memory, doing="broken")
        return action

    def _tell(self, tick: int) -> None:
        if not self._failed:
            log.error("%s made a mistake at tick %d; it stands.\n%s", self.name, tick, traceback.format_exc(limit=-3))
        self._failed = True


def _packed(memory: Any) -> bytes:
    """A memory as it travels. Raises ValueError for one that is too large, TypeError for what is no plain data."""
    packed = pack(memory)
    if len(packed) > LARGEST_MEMORY:
        raise ValueError(f"its memory takes {len(packed)} bytes; at most {LARGEST_MEMORY}")
    return packed


class Broken:
    """What stands in for an agent that could not be made."""

    Memory = dict

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        return Action(memory=memory, doing="broken")


def _check(action: Any) -> None:
    """Raises TypeError or ValueError for what is no action."""
    if not isinstance(action, Action):
        raise TypeError(f"tick gave {type(action).__name__} back; wanted is an Action")
    x, y, yaw = map(float, action.twist)
    action.twist = twist = Twist(x, y, yaw)
    if not (abs(x) <= FASTEST and abs(y) <= FASTEST and abs(yaw) <= FASTEST):  # not so of what is not a number
        raise ValueError(f"{twist}: wanted are numbers from {-FASTEST:g} to {FASTEST:g}")
    if not (isinstance(action.doing, str) and isinstance(action.waits_for, str)):
        raise TypeError(f"doing {action.doing!r}, waits_for {action.waits_for!r}: wanted are texts")
    if not (isinstance(action.steps_done, int) and action.steps_done >= 0):
        raise ValueError(f"steps_done {action.steps_done!r}: wanted is a whole number from 0")
    if (action.deeds, action.requests, action.answers) != ([], [], []):
        _check_said(action)


def _check_said(action: Action) -> None:
    """Raises TypeError or ValueError for what would be refused on its way, and what others of the session say with it."""
    said = [(deed, Deed) for deed in action.deeds] + [(body, Request) for _, body in action.requests]
    for message, type_ in [*said, *((body, Answer) for _, body in action.answers)]:
        if not isinstance(message, type_):
            raise TypeError(f"{message!r} is none of the messages in orchard/contract/messages.py")
    if len(action.deeds) > MOST_DEEDS:
        raise ValueError(f"{len(action.deeds)} deeds in one tick; at most {MOST_DEEDS}")
    unpack(pack((action.deeds, written_by(action))), tuple[list[Deed], Written | None])


def place(error: BaseException) -> str:
    """Where in the user's files it happened; '' if it was not there."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__ and "importlib" not in f.filename]
    if isinstance(error, SyntaxError):
        return f" ({error.filename}, line {error.lineno})"
    return f" ({frames[-1].filename}, line {frames[-1].lineno})" if frames else ""
