"""The guard for agents that may be faulty: an error is logged with its place, the robot stands, and all other agents go on."""

import logging
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from copy import deepcopy
from itertools import chain
from types import FrameType
from typing import Any

import msgspec

from orchard.contract import agent as limits
from orchard.contract.agent import (
    STATES,
    Action,
    Agent,
    Heard,
    Hold,
    Mail,
    Observation,
    State,
    says_holds,
    with_own_arrays,
)
from orchard.contract.difference import difference, parts_of
from orchard.contract.mail import copy_of
from orchard.contract.messages import (
    FASTEST,
    AgentMessage,
    Answer,
    CustomMessage,
    Deed,
    Given,
    Request,
    Written,
    pack,
    type_of,
    unpack,
)
from orchard.field import plugins
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.plugins import MISTAKES, contained, reraise_ctrl_c, text_of
from orchard.field.problems import printable

log = logging.getLogger("orchard")


class Guard:
    """Ticks an agent that may be faulty, converts messages of its own types, and lets only an action pass that physics accepts."""

    def __init__(
        self, name: str, agent: Agent | None, names: Collection[str], trusted: bool = False
    ) -> None:
        """`agent`: None if it could not be made: its robot stands. `names`: all agents of the orchard, to which it may send requests.

        `trusted`: it is built in, with all that it uses. So only that is checked which mail may spoil: tests check the rest.
        """
        self.name, self._names, self._trusted = name, names, trusted
        self.agent: Any = agent
        self.Memory = getattr(agent, "Memory", dict)
        self._memory: Any = None  # the one in its last action
        self._packed: bytes | None = None  # the same as msgpack, of an agent that is not trusted
        self._sideways = kind_of(name) not in KINDS or KINDS[kind_of(name)].sideways
        self._messages = {type_of(message): message for message in _own_messages(agent)}
        self._may_hold = says_holds(type(agent))
        self._repetition: Repetition | None = None
        self._failed = False

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return the agent's action. If it raises, or the action is invalid, return the action of a broken agent, which stands."""
        try:
            action = (
                self._trusted_action(observation, mail, memory)
                if self._trusted
                else self._action(observation, mail, memory)
            )
        except MISTAKES as error:
            reraise_ctrl_c(error)
            _advise(error)
            if not self._failed:
                class_ = type(self.agent)
                lines = [
                    f"{class_.__qualname__}{plugins.place_of_class(class_)}:",
                    *traceback.format_exc(limit=-3).splitlines(),
                ]
                place = "\n".join(
                    f"  {printable(line, 500)}" for line in lines
                )  # none of them looks like one of the program's own
                log.error(
                    "%s raised an error at tick %d; it stands.\n%s",
                    self.name,
                    observation.tick,
                    place,
                )
            self._failed = True
            action = _standing(memory if self._trusted else self._unpacked_memory())
        self._memory = action.memory
        return action

    @property
    def packed(self) -> bytes | None:
        """The memory in its last action, as msgpack."""
        return _packed_or_none(self._memory) if self._trusted else self._packed

    def check(self) -> None:
        """From now on, check whether the agent is repeatable, unless it is built in."""
        if not self._trusted and self.agent is not None and self._repetition is None:
            self._repetition = Repetition(self.name, self.agent)

    def _trusted_action(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        action: Action = self.agent.tick(observation, mail, memory)
        self._checked_twist(action.twist)
        if action.requests:
            self._refuse_addresses([to for to, _ in action.requests])
        return action

    def _action(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        if memory is not self._memory:  # it comes from elsewhere
            self._packed = _packed_or_none(memory)
        if self.agent is None:
            return _standing(memory)
        action = self._checked(self._answer(observation, mail, memory))
        self._keep(action)
        return action

    def _answer(self, observation: Observation, mail: Mail, memory: Any) -> Any:
        """What an own agent returns, which gets arrays and mail of its own: what it changes in them changes nothing for others."""
        action = _ask(self.agent, observation, self._typed(copy_of(mail)), memory)
        if self._repetition is not None:
            again = self._typed(copy_of(mail)), self._unpacked_memory()
            self._repetition.compare(
                observation.tick, action, lambda fresh: _ask(fresh, observation, *again)
            )
        return action

    def _unpacked_memory(self) -> Any:
        return None if self._packed is None else unpack(self._packed, self.Memory)

    def _keep(self, action: Action) -> None:
        """Pack the memory, and put in its place what its bytes give, as after a kill. Raises ValueError or TypeError if that is another.

        It is compared by `==` in every tick, and type by type when its bytes change.
        """
        memory, before = action.memory, self._packed
        packed = None if memory is None else _packed_memory(memory)
        if packed is not None:
            try:
                action.memory = unpack(packed, self.Memory)
            except ValueError as error:
                raise TypeError(
                    f"its memory does not fit its `Memory`, {self.Memory}: {error}"
                ) from None
            is_new = memory != action.memory or packed != before
            if is_new and (change := difference(memory, action.memory, "memory")):
                raise TypeError(
                    f"its memory would be another after a kill: {change}. Use {SURVIVES}"
                )
        self._packed = packed

    def _checked(self, action: Any) -> Action:
        if not isinstance(action, Action):
            raise TypeError(f"tick returned {type(action).__name__}; it must return an Action")
        twist, steps = self._checked_twist(action.twist), action.steps_done
        if type(steps) is not int or not 0 <= steps <= limits.MOST_STEPS:
            raise ValueError(
                f"steps_done {steps!r}: must be a whole number from 0 to {limits.MOST_STEPS}"
            )
        checked = Action(
            twist, memory=action.memory, state=_checked_state(action.state), steps_done=steps
        )
        checked.doing, checked.waits_for = _for_people(action.doing, action.waits_for)
        checked.hold = self._checked_hold(action.hold)
        if action.deeds != [] or action.requests != [] or action.answers != []:
            checked.deeds, checked.requests, checked.answers = self._checked_messages(
                action.deeds, action.requests, action.answers
            )
        return checked

    def _checked_hold(self, hold: Any) -> Hold | None:
        if hold is None or not self._may_hold:
            return None
        if not isinstance(hold, Hold):
            raise TypeError(f"hold {hold!r}: must be a Hold or None")
        checked: Hold = unpack(pack(hold), Hold)
        return checked

    def _checked_twist(self, twist: Any) -> Twist:
        checked = Twist(*map(float, twist))
        if not all(abs(number) <= FASTEST for number in checked):  # refuses NaN too
            raise ValueError(f"{checked}: each number must be from {-FASTEST:g} to {FASTEST:g}")
        if checked.y and not self._sideways:
            raise ValueError(f"{checked}: a {kind_of(self.name)} does not move sideways")
        return checked

    def _checked_messages(
        self, deeds: Any, requests: Any, answers: Any
    ) -> tuple[list[Deed], list[tuple[str, Request]], list[tuple[Heard, Answer]]]:
        deeds, requests, answers = (
            _listed("deeds", deeds),
            _listed("requests", requests),
            _listed("answers", answers),
        )
        _refuse_more("deeds", len(deeds), limits.MOST_DEEDS)
        _refuse_more("requests", len(requests), limits.MOST_REQUESTS)
        asked = [(to, _of_kind(self._custom(body), Request)) for to, body in requests]
        given = [
            Given(heard.sender, heard.tick, heard.number, _of_kind(self._custom(body), Answer))
            for heard, body in answers
        ]
        packed = _packed(
            ([_of_kind(deed, Deed) for deed in deeds], Written(asked, given)),
            "its deeds and messages take",
        )
        sound: tuple[list[Deed], Written] = unpack(packed, tuple[list[Deed], Written])
        self._refuse_addresses([to for to, _ in sound[1].requests])
        _refuse_depth(
            [*(body for _, body in sound[1].requests), *(body for *_, body in sound[1].answers)]
        )
        heard_and_given = zip((heard for heard, _ in answers), sound[1].answers, strict=True)
        return (
            sound[0],
            sound[1].requests,
            [
                (Heard(to, at, number, heard.body), body)
                for heard, (to, at, number, body) in heard_and_given
            ],
        )

    def _refuse_addresses(self, recipients: Sequence[str]) -> None:
        for to, count in Counter(recipients).items():
            if to not in self._names:
                raise ValueError(f"a request to {printable(to)!r}: no agent has that name")
            _refuse_more(f"requests to {to}", count, limits.MOST_TO_ONE)

    def _typed(self, mail: Mail) -> Mail:
        if not self._messages:
            return mail
        requests = [
            heard._replace(body=body)
            for heard in mail.requests
            if (body := self._of_type(heard.sender, heard.body)) is not None
        ]
        replies = [
            reply._replace(
                request=self._of_type(self.name, reply.request),
                body=self._of_type(reply.sender, reply.body),
            )
            for reply in mail.replies
        ]
        return Mail(requests, replies)

    def _of_type(self, sender: str, body: Any) -> Any:
        if not isinstance(body, CustomMessage) or body.name not in self._messages:
            return body
        try:
            return msgspec.convert(body.fields, self._messages[body.name])
        except ValueError as error:
            log.warning(
                "%s: message %r from %s does not fit its type: %s",
                self.name,
                body.name,
                sender,
                printable(str(error)),
            )
            return None

    def _custom(self, body: Any) -> Any:
        if type(body) not in self._messages.values():
            return body
        fields = msgspec.to_builtins(body, order="deterministic")
        return CustomMessage(fields.pop("type"), fields)


class Repetition:
    """Asks a copy of an agent, as it was made, what the agent was asked, and compares the two answers."""

    def __init__(self, name: str, agent: Agent) -> None:
        self._name, self._made, self._is_logged = name, _copy_of(agent), False

    def compare(self, tick: int, action: Any, ask: Callable[[Agent], Any]) -> None:
        """Let `ask` ask a fresh copy. If it answers otherwise, log the first difference, once, and let the action's state be `broken`."""
        try:
            other = ask(_copy_of(self._made))
        except MISTAKES as error:
            reraise_ctrl_c(error)
            words = f"its answer: an action, then, asked again, {type(error).__name__}: {error}"
        else:
            words = difference(action, other, "its answer")
        if words and isinstance(action, Action):  # the guard refuses what is no action
            if not self._is_logged:
                log.error("%s is not repeatable, tick %d: %s", self._name, tick, words)
            self._is_logged, action.state = True, "broken"


def _copy_of(agent: Any) -> Any:
    try:
        return deepcopy(agent)
    except MISTAKES as error:
        reraise_ctrl_c(error)
        return agent


def _ask(agent: Any, observation: Observation, mail: Mail, memory: Any) -> Any:
    return contained(agent.tick, with_own_arrays(observation), mail, memory)


def _standing(memory: Any) -> Action:
    return Action(memory=memory, doing="broken", state="broken")


def _own_messages(agent: Any) -> tuple[type[AgentMessage], ...]:
    types = getattr(agent, "Messages", ())
    if not isinstance(types, tuple) or not all(
        isinstance(one, type) and issubclass(one, AgentMessage) for one in types
    ):
        raise TypeError(
            f"Messages must be a tuple of classes that are derived from AgentMessage, not {types!r}"
        )
    return types


def _packed_or_none(memory: Any) -> bytes | None:
    return None if memory is None else pack(memory)


def _packed(data: Any, what: str) -> bytes:
    packed = pack(data)
    if len(packed) > limits.LARGEST_MEMORY:
        raise ValueError(f"{what} {len(packed)} bytes; at most {limits.LARGEST_MEMORY}")
    return packed


def _packed_memory(memory: Any) -> bytes:
    try:
        return _packed(memory, "its memory takes")
    except NOT_PLAIN as error:
        raise TypeError(f"{_place_of_fault(memory, 'memory')}: {error}. Use {SURVIVES}") from None


def _place_of_fault(data: Any, where: str) -> str:
    for at, value in parts_of(data, where):
        try:
            pack(value)
        except NOT_PLAIN:
            return _place_of_fault(value, at)
    return where


NOT_PLAIN = (TypeError, OverflowError, UnicodeError)  # what `pack` raises
SURVIVES = (
    "numbers, texts, bytes, lists, dicts, or a msgspec.Struct that the agent's `Memory` names"
)
READ_ONLY = "What an agent is given is read-only. To change ranges, take a copy: scan = observation.scan.copy()"


def _advise(error: BaseException) -> None:
    text = text_of(error)
    is_array = isinstance(error, ValueError) and ("read-only" in text or "WRITEABLE" in text)
    words = ("immutable type", "can't set attribute", "no setter", "cannot assign", "mappingproxy")
    if is_array or (
        isinstance(error, AttributeError | TypeError) and any(word in text for word in words)
    ):
        error.add_note(READ_ONLY)


def _checked_state(state: Any) -> State | None:
    state = "".join([state]) if isinstance(state, str) else state
    if state is not None and (not isinstance(state, str) or state not in STATES):
        raise ValueError(f"state {state!r}: must be one of {', '.join(STATES)}")
    return state


def _for_people(doing: Any, waits_for: Any) -> tuple[str, str]:
    if not (isinstance(doing, str) and isinstance(waits_for, str)):
        raise TypeError(f"doing {doing!r}, waits_for {waits_for!r}: both must be text")
    return printable("".join([doing])), printable(
        "".join([waits_for])
    )  # of the exact type: a subclass may have other methods


def _listed(what: str, messages: Any) -> Sequence[Any]:
    if not isinstance(messages, list | tuple):
        raise TypeError(f"{what} {type(messages).__name__}: must be a list")
    return messages


def _of_kind(message: Any, type_: Any) -> Any:
    if not isinstance(message, type_):
        raise TypeError(
            f"{message!r} is neither a message of orchard/contract/messages.py nor of a type in the agent's `Messages`"
        )
    return message


def _refuse_depth(messages: Sequence[Request | Answer]) -> None:
    for message in messages:
        if isinstance(message, CustomMessage) and not _is_shallow(
            message.fields, limits.MOST_LEVELS
        ):
            raise ValueError(
                f"{message.name}: lists and maps are nested more than {limits.MOST_LEVELS} levels deep"
            )


def _is_shallow(data: Any, levels: int) -> bool:
    parts: Iterable[Any] = (
        chain(data, data.values())
        if isinstance(data, dict)
        else data
        if isinstance(data, list | tuple)
        else ()
    )
    return levels > 0 and all(_is_shallow(part, levels - 1) for part in parts)


def _refuse_more(what: str, count: int, most: int) -> None:
    if count > most:
        raise ValueError(f"{count} {what} in one tick; at most {most}")


def place_in_agent(frame: FrameType | None) -> str:
    """Return the file and line of an agent's own code, below its guard; '' if the frame is not in an agent."""
    frames = traceback.extract_stack(frame)
    inside = [i for i, frame in enumerate(frames) if frame.filename == __file__]
    here = (
        [
            frame
            for frame in frames[inside[-1] :]
            if frame.filename not in (__file__, plugins.__file__)
        ]
        if inside
        else []
    )
    return f", in {here[0].filename}, line {here[0].lineno}" if here else ""
