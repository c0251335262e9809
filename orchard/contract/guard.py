"""The guard for agents that may be faulty: an error is logged with its place, the robot stands, and all other agents go on."""

import logging
import traceback
from typing import Any, get_args

import msgspec

from orchard.contract.agent import LARGEST_MEMORY, MOST_DEEDS, Action, Agent, Mail, Observation, State
from orchard.contract.mail import written_by
from orchard.contract.messages import FASTEST, AgentMessage, Answer, CustomMessage, Deed, Request, Written, pack, type_of, unpack
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.plugins import MISTAKES

log = logging.getLogger("orchard")

STATES = get_args(State)


class Guarded:
    """Checks an agent's actions before they count, and converts messages of the agent's own types (see `CustomMessage`)."""

    def __init__(self, name: str, agent: Agent) -> None:
        self.name = name
        self.Memory = getattr(agent, "Memory", dict)
        self._sideways = kind_of(name) not in KINDS or KINDS[kind_of(name)].sideways
        self.packed: bytes | None = None  # its memory as msgpack
        self._agent = agent
        self._messages = {type_of(message): message for message in _own_messages(agent)}
        self._failed = False

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return the agent's action. If it raises, or the action is invalid, return the action of a broken agent, which stands."""
        try:
            action = self._agent.tick(observation, self._typed(mail) if self._messages else mail, memory)
            if self._messages:
                action.requests = [(to, self._custom(body)) for to, body in action.requests]
                action.answers = [(heard, self._custom(body)) for heard, body in action.answers]
            _check(action)
            if action.twist.y and not self._sideways:
                raise ValueError(f"{action.twist}: a {kind_of(self.name)} does not move sideways")
            self.packed = None if action.memory is None else _packed(action.memory, "its memory takes")
        except MISTAKES:
            if not self._failed:
                log.error("%s raised an error at tick %d; it stands.\n%s", self.name, observation.tick, traceback.format_exc(limit=-3))
            self._failed = True
            return Broken().tick(observation, mail, memory)
        return action

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

    def _custom(self, body: Any) -> Any:
        """Convert a message of the agent's own types to a custom message."""
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


def _packed(data: Any, what: str) -> bytes:
    """Encode a memory or messages. Raises ValueError if it is too large, TypeError if it is not plain data."""
    packed = pack(data)
    if len(packed) > LARGEST_MEMORY:
        raise ValueError(f"{what} {len(packed)} bytes; at most {LARGEST_MEMORY}")
    return packed


class Broken:
    """The replacement for an agent that could not be made: it stands."""

    Memory = dict

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        return Action(memory=memory, doing="broken", state="broken")


def _check(action: Any) -> None:
    """Raise TypeError or ValueError if an action is invalid."""
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
    """Raise TypeError or ValueError for deeds and messages that physics would refuse with all others of the session."""
    sent = [(deed, Deed) for deed in action.deeds] + [(body, Request) for _, body in action.requests]
    for message, type_ in [*sent, *((body, Answer) for _, body in action.answers)]:
        if not isinstance(message, type_):
            raise TypeError(f"{message!r} is neither a message of orchard/contract/messages.py nor of a type in the agent's `Messages`")
    if len(action.deeds) > MOST_DEEDS:
        raise ValueError(f"{len(action.deeds)} deeds in one tick; at most {MOST_DEEDS}")
    packed = _packed((action.deeds, written_by(action)), "its deeds and messages take")
    unpack(packed, tuple[list[Deed], Written | None])
