"""The guard for agents that may be faulty: an error is logged with its place, the robot stands, and all other agents go on."""

import logging
import traceback
from typing import Any, get_args

import msgspec

from orchard.contract.agent import Action, Agent, Mail, Observation, State
from orchard.contract.mail import written_by
from orchard.contract.messages import (
    FASTEST,
    MAX_PAYLOAD,
    MOST_DEEDS,
    AgentMessage,
    Answer,
    CustomMessage,
    Deed,
    Request,
    Written,
    pack,
    type_of,
    unpack,
)
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.plugins import MISTAKES

log = logging.getLogger("orchard")

LARGEST_MEMORY = MAX_PAYLOAD // 32  # bytes: the memories of a session's agents go in one message to a session that takes over
STATES = get_args(State)


class Guarded:
    """Checks an agent's actions before they count, and converts messages of the agent's own types (see `CustomMessage`)."""

    def __init__(self, name: str, agent: Agent) -> None:
        self.name = name
        self.Memory = getattr(agent, "Memory", dict)
        kind = KINDS.get(kind_of(name))
        self._sideways = kind is None or kind.sideways
        self.packed: bytes | None = None  # its memory as msgpack
        self._agent = agent
        self._messages = {type_of(message): message for message in _own_messages(agent)}
        self._failed = False

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return the agent's action. If it raises, or the action is invalid, return the action of a broken agent, which stands."""
        try:
            action = self._agent.tick(observation, self._typed(mail) if self._messages else mail, memory)
            if self._messages:
                self._untype(action)
            _check(action)
            if action.twist.y and not self._sideways:
                raise ValueError(f"{action.twist}: a {kind_of(self.name)} does not move sideways")
            self.packed = None if action.memory is None else _packed(action.memory)
        except MISTAKES:
            self._report(observation.tick)
            return Action(memory=memory, doing="broken", state="broken")
        return action

    def _report(self, tick: int) -> None:
        if not self._failed:
            log.error("%s raised an error at tick %d; it stands.\n%s", self.name, tick, traceback.format_exc(limit=-3))
        self._failed = True

    # -- messages of the agent's own types

    def _typed(self, mail: Mail) -> Mail:
        """Convert custom messages to the agent's types. A message that does not fit its type is logged and left out."""
        requests = [heard._replace(body=body) for heard in mail.requests if (body := self._of_type(heard.sender, heard.body)) is not None]
        replies = [
            reply._replace(request=self._of_type(self.name, reply.request), body=self._of_type(reply.sender, reply.body))
            for reply in mail.replies
        ]
        return Mail(requests, replies)

    def _of_type(self, sender: str, body: Any) -> Any:
        if not isinstance(body, CustomMessage) or body.name not in self._messages:
            return body
        try:
            return msgspec.convert(body.fields, self._messages[body.name])
        except ValueError as error:
            log.warning("%s: message %r from %s does not fit its type: %s", self.name, body.name, sender, error)
            return None

    def _untype(self, action: Action) -> None:
        """Convert messages of the agent's own types to custom messages."""
        action.requests = [(to, self._custom(body)) for to, body in action.requests]
        action.answers = [(heard, self._custom(body)) for heard, body in action.answers]

    def _custom(self, body: Any) -> Any:
        if type(body) not in self._messages.values():
            return body
        fields = msgspec.to_builtins(body, order="deterministic")
        return CustomMessage(fields.pop("type"), fields)


def _own_messages(agent: Any) -> tuple[type[AgentMessage], ...]:
    """The agent's own types of messages. Raises TypeError for what is not a tuple of classes that are derived from AgentMessage."""
    types = getattr(agent, "Messages", ())
    if not isinstance(types, tuple) or not all(isinstance(one, type) and issubclass(one, AgentMessage) for one in types):
        raise TypeError(f"Messages must be a tuple of classes that are derived from AgentMessage, not {types!r}")
    return types


def _packed(memory: Any) -> bytes:
    """Encode a memory. Raises ValueError if it is too large, TypeError if it is not plain data."""
    packed = pack(memory)
    if len(packed) > LARGEST_MEMORY:
        raise ValueError(f"its memory takes {len(packed)} bytes; at most {LARGEST_MEMORY}")
    return packed


class Broken:
    """The replacement for an agent that could not be made: it stands."""

    Memory = dict

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        return Action(memory=memory, doing="broken", state="broken")


def _check(action: Any) -> None:
    """Check an action. Raises TypeError or ValueError if it is invalid."""
    if not isinstance(action, Action):
        raise TypeError(f"tick returned {type(action).__name__}; it must return an Action")
    x, y, yaw = map(float, action.twist)
    action.twist = twist = Twist(x, y, yaw)
    if not (abs(x) <= FASTEST and abs(y) <= FASTEST and abs(yaw) <= FASTEST):  # refuses NaN too
        raise ValueError(f"{twist}: each number must be from {-FASTEST:g} to {FASTEST:g}")
    if not (isinstance(action.doing, str) and isinstance(action.waits_for, str)):
        raise TypeError(f"doing {action.doing!r}, waits_for {action.waits_for!r}: both must be text")
    if action.state is not None and action.state not in STATES:
        raise ValueError(f"state {action.state!r}: must be one of {', '.join(STATES)}")
    if not (isinstance(action.steps_done, int) and action.steps_done >= 0):
        raise ValueError(f"steps_done {action.steps_done!r}: must be a whole number from 0")
    if (action.deeds, action.requests, action.answers) != ([], [], []):
        _check_messages(action)


def _check_messages(action: Action) -> None:
    """Check deeds and messages. Raises TypeError or ValueError for any that physics would refuse with all others of the session."""
    sent = [(deed, Deed) for deed in action.deeds] + [(body, Request) for _, body in action.requests]
    for message, type_ in [*sent, *((body, Answer) for _, body in action.answers)]:
        if not isinstance(message, type_):
            raise TypeError(f"{message!r} is neither a message of orchard/contract/messages.py nor of a type in the agent's `Messages`")
    if len(action.deeds) > MOST_DEEDS:
        raise ValueError(f"{len(action.deeds)} deeds in one tick; at most {MOST_DEEDS}")
    packed = pack((action.deeds, written_by(action)))
    if len(packed) > LARGEST_MEMORY:
        raise ValueError(f"its deeds and messages take {len(packed)} bytes; at most {LARGEST_MEMORY}")
    unpack(packed, tuple[list[Deed], Written | None])
