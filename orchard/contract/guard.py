"""The guard for agents that may be faulty.

An error is logged with its place, the robot stands, and all other agents go on.
"""

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
    """Ticks an agent that may be faulty, and lets only an action pass that physics accepts.

    It also converts messages of the agent's own types.
    """

    def __init__(
        self, name: str, agent: Agent | None, names: Collection[str], trusted: bool = False
    ) -> None:
        """Guard an agent; None if it could not be made: then its robot stands.

        `names`: all agents of the orchard, to which it may send requests. `trusted`: it is built
        in, with all that it uses. So only that is checked which mail may spoil: tests check the
        rest.
        """
        self.name = name
        self.agent: Any = agent
        self.Memory = getattr(agent, "Memory", dict)
        self._names = names
        self._trusted = trusted
        # The memory in its last action, and the same as msgpack, if the agent is not trusted.
        self._memory: Any = None
        self._packed: bytes | None = None
        self._sideways = kind_of(name) not in KINDS or KINDS[kind_of(name)].sideways
        self._messages = {type_of(message): message for message in _own_messages(agent)}
        self._may_hold = says_holds(type(agent))
        self._repetition: Repetition | None = None
        self._failed = False

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return the agent's action.

        If it raises, or the action is invalid, return the action of a broken agent, which stands.
        """
        try:
            if self._trusted:
                action = self._trusted_action(observation, mail, memory)
            else:
                action = self._action(observation, mail, memory)
        except MISTAKES as error:
            reraise_ctrl_c(error)
            _advise(error)
            if not self._failed:
                self._log_error(observation.tick)
            self._failed = True
            if not self._trusted:
                memory = self._unpacked_memory()
            action = _standing(memory)
        self._memory = action.memory
        return action

    def _log_error(self, tick: int) -> None:
        """Log the error that is handled, with its place in the user's file."""
        class_ = type(self.agent)
        lines = [
            f"{class_.__qualname__}{plugins.place_of_class(class_)}:",
            *traceback.format_exc(limit=-3).splitlines(),
        ]
        # Each line is indented, so that none looks like one of the program's own.
        place = "\n".join(f"  {printable(line, 500)}" for line in lines)
        log.error("%s raised an error at tick %d; it stands.\n%s", self.name, tick, place)

    @property
    def packed(self) -> bytes | None:
        """The memory in its last action, as msgpack."""
        if self._trusted:
            return _packed_or_none(self._memory)
        return self._packed

    def check(self) -> None:
        """From now on, check whether the agent is repeatable, unless it is built in."""
        if not self._trusted and self.agent is not None and self._repetition is None:
            self._repetition = Repetition(self.name, self.agent)

    def _trusted_action(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return what a built-in agent does. Of it only velocity and addresses are checked."""
        action: Action = self.agent.tick(observation, mail, memory)
        self._checked_twist(action.twist)
        if action.requests:
            self._refuse_addresses(action.requests)
        return action

    def _action(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        """Return what an own agent does, checked. Raises what its mistakes raise."""
        comes_from_elsewhere = memory is not self._memory
        if comes_from_elsewhere:
            self._packed = _packed_or_none(memory)
        if self.agent is None:
            return _standing(memory)
        action = self._checked(self._answer(observation, mail, memory))
        self._keep(action)
        return action

    def _answer(self, observation: Observation, mail: Mail, memory: Any) -> Any:
        """Return what an own agent returns.

        It gets arrays and mail of its own: what it changes in them changes nothing for others.
        """
        action = _ask(self.agent, observation, self._typed(copy_of(mail)), memory)
        if self._repetition is not None:
            same_mail = self._typed(copy_of(mail))
            same_memory = self._unpacked_memory()

            def ask_again(fresh: Agent) -> Any:
                """Return what a new agent answers to the same."""
                return _ask(fresh, observation, same_mail, same_memory)

            self._repetition.compare(observation.tick, action, ask_again)
        return action

    def _unpacked_memory(self) -> Any:
        """Return the memory as its bytes give it back."""
        if self._packed is None:
            return None
        return unpack(self._packed, self.Memory)

    def _keep(self, action: Action) -> None:
        """Pack the memory, and put in its place what its bytes give, as after a kill.

        Raises ValueError or TypeError if that is another one. The memory is compared by `==` in
        every tick, and type by type when its bytes change.
        """
        memory = action.memory
        if memory is None:
            self._packed = None
            return
        packed = _packed_memory(memory)
        try:
            action.memory = unpack(packed, self.Memory)
        except ValueError as error:
            text = f"its memory does not fit its `Memory`, {self.Memory}: {error}"
            raise TypeError(text) from None
        if memory != action.memory or packed != self._packed:
            change = difference(memory, action.memory, "memory")
            if change:
                text = f"its memory would be another after a kill: {change}. Use {SURVIVES}"
                raise TypeError(text)
        self._packed = packed

    def _checked(self, action: Any) -> Action:
        """Return what an own agent returned, of plain types. Raises TypeError or ValueError."""
        if not isinstance(action, Action):
            raise TypeError(f"tick returned {type(action).__name__}; it must return an Action")
        twist = self._checked_twist(action.twist)
        steps = action.steps_done
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
        """Return a hold; None if the agent's class does not say that its holds count."""
        if hold is None or not self._may_hold:
            return None
        if not isinstance(hold, Hold):
            raise TypeError(f"hold {hold!r}: must be a Hold or None")
        checked: Hold = unpack(pack(hold), Hold)
        return checked

    def _checked_twist(self, twist: Any) -> Twist:
        """Return a velocity that the body can have. Raises ValueError or TypeError."""
        checked = Twist(*map(float, twist))
        # This refuses NaN, too.
        if not all(abs(number) <= FASTEST for number in checked):
            raise ValueError(f"{checked}: each number must be from {-FASTEST:g} to {FASTEST:g}")
        if checked.y and not self._sideways:
            raise ValueError(f"{checked}: a {kind_of(self.name)} does not move sideways")
        return checked

    def _checked_messages(
        self, deeds: Any, requests: Any, answers: Any
    ) -> tuple[list[Deed], list[tuple[str, Request]], list[tuple[Heard, Answer]]]:
        """Return deeds, requests and answers as their bytes give them back: of plain types only."""
        deeds = _listed("deeds", deeds)
        requests = _listed("requests", requests)
        answers = _listed("answers", answers)
        _refuse_more("deeds", len(deeds), limits.MOST_DEEDS)
        _refuse_more("requests", len(requests), limits.MOST_REQUESTS)
        own_deeds = [_of_kind(deed, Deed) for deed in deeds]
        own_requests = [(to, _of_kind(self._custom(body), Request)) for to, body in requests]
        own_answers = []
        for heard, body in answers:
            own_body = _of_kind(self._custom(body), Answer)
            own_answers.append(Given(heard.sender, heard.tick, heard.number, own_body))
        packed = _packed(
            (own_deeds, Written(own_requests, own_answers)), "its deeds and messages take"
        )
        unpacked: tuple[list[Deed], Written] = unpack(packed, tuple[list[Deed], Written])
        sound_deeds, letters = unpacked
        self._refuse_addresses(letters.requests)
        _refuse_depth([body for _, body in letters.requests])
        _refuse_depth([body for *_, body in letters.answers])
        sound_answers = []
        for (heard, _), (to, tick, number, body) in zip(answers, letters.answers, strict=True):
            sound_answers.append((Heard(to, tick, number, heard.body), body))
        return sound_deeds, letters.requests, sound_answers

    def _refuse_addresses(self, requests: Sequence[tuple[str, Request]]) -> None:
        """Raise ValueError for requests without a recipient, or too many to one agent."""
        for to, count in Counter(to for to, _ in requests).items():
            if to not in self._names:
                raise ValueError(f"a request to {printable(to)!r}: no agent has that name")
            _refuse_more(f"requests to {to}", count, limits.MOST_TO_ONE)

    def _typed(self, mail: Mail) -> Mail:
        """Return mail with messages of the agent's own types. A request that does not fit is left
        out.
        """
        if not self._messages:
            return mail
        requests = []
        for heard in mail.requests:
            body = self._of_type(heard.sender, heard.body)
            if body is not None:
                requests.append(heard._replace(body=body))
        replies = []
        for reply in mail.replies:
            request = self._of_type(self.name, reply.request)
            body = self._of_type(reply.sender, reply.body)
            replies.append(reply._replace(request=request, body=body))
        return Mail(requests, replies)

    def _of_type(self, sender: str, body: Any) -> Any:
        """Return a message as the agent's own type of its name; None, and a warning, if it does not
        fit.
        """
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
    """Asks a copy of an agent, as it was made, what the agent was asked, and compares the two
    answers.
    """

    def __init__(self, name: str, agent: Agent) -> None:
        self._name = name
        self._made = _copy_of(agent)
        self._is_logged = False

    def compare(self, tick: int, action: Any, ask: Callable[[Agent], Any]) -> None:
        """Let `ask` ask a fresh copy, and compare its answer with the agent's action.

        If it answers otherwise, log the first difference, once, and let the action's state be
        `broken`.
        """
        try:
            repeated = ask(_copy_of(self._made))
        except MISTAKES as error:
            reraise_ctrl_c(error)
            words = f"its answer: an action, then, asked again, {type(error).__name__}: {error}"
        else:
            words = difference(action, repeated, "its answer")
        # The guard itself refuses what is no action.
        if words and isinstance(action, Action):
            if not self._is_logged:
                log.error("%s is not repeatable, tick %d: %s", self._name, tick, words)
            self._is_logged = True
            action.state = "broken"


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
    """Return the types of messages that an agent names. Raises TypeError if they are none."""
    types = getattr(agent, "Messages", ())
    are_messages = isinstance(types, tuple) and all(
        isinstance(type_, type) and issubclass(type_, AgentMessage) for type_ in types
    )
    if not are_messages:
        raise TypeError(
            f"Messages must be a tuple of classes that are derived from AgentMessage, not {types!r}"
        )
    return types


def _packed_or_none(memory: Any) -> bytes | None:
    if memory is None:
        return None
    return pack(memory)


def _packed(data: Any, subject: str) -> bytes:
    """Return the bytes of some data. Raises ValueError if they are too many, with its subject."""
    packed = pack(data)
    if len(packed) > limits.LARGEST_MEMORY:
        raise ValueError(f"{subject} {len(packed)} bytes; at most {limits.LARGEST_MEMORY}")
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


# What `pack` raises.
NOT_PLAIN = (TypeError, OverflowError, UnicodeError)
SURVIVES = (
    "numbers, texts, bytes, lists, dicts, or a msgspec.Struct that the agent's `Memory` names"
)
READ_ONLY = (
    "What an agent is given is read-only. "
    "To change ranges, take a copy: scan = observation.scan.copy()"
)


# What Python, numpy and msgspec say if something read-only is changed.
_OF_ARRAYS = ("read-only", "WRITEABLE")
_OF_OBJECTS = (
    "immutable type",
    "can't set attribute",
    "no setter",
    "cannot assign",
    "mappingproxy",
)


def _advise(error: BaseException) -> None:
    """Add to an error what to do, if an agent has tried to change what is read-only."""
    words: tuple[str, ...] = ()
    if isinstance(error, ValueError):
        words = _OF_ARRAYS
    elif isinstance(error, AttributeError | TypeError):
        words = _OF_OBJECTS
    text = text_of(error)
    if any(word in text for word in words):
        error.add_note(READ_ONLY)


def _checked_state(state: Any) -> State | None:
    """Return a state of plain type. Raises ValueError for one that does not exist."""
    if state is None:
        return None
    plain = _plain_text(state) if isinstance(state, str) else ""
    if plain not in STATES:
        raise ValueError(f"state {state!r}: must be one of {', '.join(STATES)}")
    return plain


def _for_people(doing: Any, waits_for: Any) -> tuple[str, str]:
    """Return the texts that people read, printable. Raises TypeError for what is no text."""
    if not (isinstance(doing, str) and isinstance(waits_for, str)):
        raise TypeError(f"doing {doing!r}, waits_for {waits_for!r}: both must be text")
    return printable(_plain_text(doing)), printable(_plain_text(waits_for))


def _plain_text(text: str) -> str:
    """Return a text as a `str`: a class derived from it may have methods of its own."""
    return "".join([text])


def _listed(name: str, messages: Any) -> Sequence[Any]:
    if not isinstance(messages, list | tuple):
        raise TypeError(f"{name} {type(messages).__name__}: must be a list")
    return messages


def _of_kind(message: Any, type_: Any) -> Any:
    if not isinstance(message, type_):
        known = "a message of orchard/contract/messages.py"
        raise TypeError(f"{message!r} is neither {known} nor of a type in the agent's `Messages`")
    return message


def _refuse_depth(messages: Sequence[Request | Answer]) -> None:
    most = limits.MOST_LEVELS
    for message in messages:
        if isinstance(message, CustomMessage) and not _is_shallow(message.fields, most):
            fault = f"lists and maps are nested more than {most} levels deep"
            raise ValueError(f"{message.name}: {fault}")


def _is_shallow(data: Any, levels: int) -> bool:
    """Whether lists and maps in some data are within each other at most so many times."""
    parts: Iterable[Any] = ()
    if isinstance(data, dict):
        parts = chain(data, data.values())
    elif isinstance(data, list | tuple):
        parts = data
    return levels > 0 and all(_is_shallow(part, levels - 1) for part in parts)


def _refuse_more(name: str, count: int, most: int) -> None:
    if count > most:
        raise ValueError(f"{count} {name} in one tick; at most {most}")


def place_in_agent(frame: FrameType | None) -> str:
    """Return the file and line of an agent's own code, below its guard; '' if the frame is not in
    an agent.
    """
    frames = traceback.extract_stack(frame)
    own = (__file__, plugins.__file__)
    guards = [i for i, frame in enumerate(frames) if frame.filename == __file__]
    if not guards:
        return ""
    for of_agent in frames[guards[-1] :]:
        if of_agent.filename not in own:
            return f", in {of_agent.filename}, line {of_agent.lineno}"
    return ""
