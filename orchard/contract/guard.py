"""The guard for agents that may be faulty.

It stands between an agent and the runner that asks it (orchard/net/runner.py, orchard/local.py). If
an agent of the user's raises an error, or returns what physics would refuse, the error is logged
with its place, the robot stands, and all other agents go on. orchard/contract/checks.py has the
checks of the parts of an action.
"""

import logging
import traceback
from collections import Counter
from collections.abc import Collection, Sequence
from types import FrameType
from typing import Any

import msgspec

from orchard.contract import agent as limits
from orchard.contract import checks, repetition
from orchard.contract.agent import (
    Action,
    Agent,
    Heard,
    Hold,
    Mail,
    Observation,
    says_holds,
    with_own_arrays,
)
from orchard.contract.checks import (
    SURVIVES,
    checked_state,
    listed,
    of_kind,
    own_messages,
    packed_memory,
    packed_or_none,
    packed_within_limit,
    refuse_depth,
    refuse_more,
    texts_for_people,
)
from orchard.contract.difference import difference
from orchard.contract.mail import copy_of
from orchard.contract.messages import (
    FASTEST,
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
from orchard.contract.repetition import Repetition
from orchard.field import plugins
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.plugins import MISTAKES, contained, reraise_ctrl_c, text_of
from orchard.field.problems import printable

log = logging.getLogger("orchard")

# The files of the functions that call the user's code.
CALLERS = (__file__, plugins.__file__)
READ_ONLY = (
    "What an agent is given is read-only. "
    "To change ranges, take a copy: scan = observation.scan.copy()"
)
# What numpy says if a read-only array is changed.
_OF_ARRAYS = ("read-only", "WRITEABLE")
# What Python and msgspec say if a read-only object is changed.
_OF_OBJECTS = (
    "immutable type",
    "can't set attribute",
    "no setter",
    "cannot assign",
    "mappingproxy",
)


class Guard:
    """Ticks an agent that may be faulty, and lets only an action pass that physics accepts.

    It also converts messages of the agent's own types.
    """

    def __init__(
        self, name: str, agent: Agent | None, names: Collection[str], trusted: bool = False
    ) -> None:
        """Guard an agent; None if it could not be made: then its robot stands.

        `names`: all agents of the orchard, to which it may send requests. `trusted`: the agent and
        all classes that it uses are built in. Then only its velocity and its recipients are
        checked, which may depend on what agents of the user's wrote to it. Tests check the rest.
        """
        self.name = name
        self.agent: Any = agent
        self.Memory = getattr(agent, "Memory", dict)
        self._names = names
        self._trusted = trusted
        # The memory in its last action.
        self._memory: Any = None
        # The same as msgpack; kept only if the agent is not trusted.
        self._packed: bytes | None = None
        # An agent without a body may say any velocity: it has no effect.
        self._sideways = kind_of(name) not in KINDS or KINDS[kind_of(name)].sideways
        self._messages = {type_of(message): message for message in own_messages(agent)}
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
                # The agent may have changed its memory before it raised the error.
                memory = self._unpacked_memory()
            action = _standing(memory)
        self._memory = action.memory
        return action

    def _log_error(self, tick: int) -> None:
        """Log the error that is handled, with its place in the user's file."""
        class_ = type(self.agent)
        # The three innermost calls, which are the user's.
        error = traceback.format_exc(limit=-3)
        lines = [
            f"{class_.__qualname__}{plugins.place_of_class(class_)}:",
            *error.splitlines(),
        ]
        # Each line is indented, so that none looks like one of the program's own.
        place = "\n".join(f"  {printable(line, 500)}" for line in lines)
        log.error("%s raised an error at tick %d; it stands.\n%s", self.name, tick, place)

    @property
    def packed(self) -> bytes | None:
        """The memory in its last action, as msgpack."""
        if self._trusted:
            return packed_or_none(self._memory)
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
        """Return what an agent of the user's does, checked. Raises what its mistakes raise."""
        # A memory that this guard did not return comes from a snapshot or from another process.
        comes_from_elsewhere = memory is not self._memory
        if comes_from_elsewhere:
            self._packed = packed_or_none(memory)
        if self.agent is None:
            return _standing(memory)
        action = self._checked(self._answer(observation, mail, memory))
        self._keep(action)
        return action

    def _answer(self, observation: Observation, mail: Mail, memory: Any) -> Any:
        """Return what an agent of the user's returns, not checked yet.

        It gets copies of arrays and mail: what it changes in them changes nothing for others.
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
        """Pack the memory of an action, and put in its place what its bytes give back.

        So the agent goes on in each tick as it would after a kill. Raises ValueError or TypeError
        if the memory that comes back is not the same.
        """
        memory = action.memory
        if memory is None:
            self._packed = None
            return
        packed = packed_memory(memory)
        try:
            action.memory = unpack(packed, self.Memory)
        except ValueError as error:
            text = f"its memory does not fit its `Memory`, {self.Memory}: {error}"
            raise TypeError(text) from None
        # `difference` compares types too, but it is slow. So it runs only if `==` finds a change,
        # or if the bytes are not those that this guard packed or was given last.
        if memory != action.memory or packed != self._packed:
            change = difference(memory, action.memory, "memory")
            if change:
                text = f"its memory would be another after a kill: {change}. Use {SURVIVES}"
                raise TypeError(text)
        self._packed = packed

    def _checked(self, action: Any) -> Action:
        """Return an action of the user's with plain data only. Raises TypeError or ValueError."""
        if not isinstance(action, Action):
            raise TypeError(f"tick returned {type(action).__name__}; it must return an Action")
        twist = self._checked_twist(action.twist)
        steps = action.steps_done
        if type(steps) is not int or not 0 <= steps <= limits.MOST_STEPS:
            raise ValueError(
                f"steps_done {steps!r}: must be a whole number from 0 to {limits.MOST_STEPS}"
            )
        checked = Action(
            twist, memory=action.memory, state=checked_state(action.state), steps_done=steps
        )
        checked.doing, checked.waits_for = texts_for_people(action.doing, action.waits_for)
        checked.hold = self._checked_hold(action.hold)
        # In most ticks there are none.
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
        """Return deeds, requests and answers as their bytes give them back: plain data only.

        Own messages of the agent become `CustomMessage`.
        """
        deeds = listed("deeds", deeds)
        requests = listed("requests", requests)
        answers = listed("answers", answers)
        refuse_more("deeds", len(deeds), limits.MOST_DEEDS)
        refuse_more("requests", len(requests), limits.MOST_REQUESTS)
        known_deeds = [of_kind(deed, Deed) for deed in deeds]
        known_requests = [(to, of_kind(self._custom(body), Request)) for to, body in requests]
        known_answers = []
        for heard, body in answers:
            known_body = of_kind(self._custom(body), Answer)
            known_answers.append(Given(heard.sender, heard.tick, heard.number, known_body))
        packed = packed_within_limit(
            (known_deeds, Written(known_requests, known_answers)), "its deeds and messages take"
        )
        unpacked: tuple[list[Deed], Written] = unpack(packed, tuple[list[Deed], Written])
        sound_deeds, letters = unpacked
        self._refuse_addresses(letters.requests)
        refuse_depth([body for _, body in letters.requests])
        refuse_depth([answer.body for answer in letters.answers])
        sound_answers = []
        for (heard, _), (to, tick, number, body) in zip(answers, letters.answers, strict=True):
            sound_answers.append((Heard(to, tick, number, heard.body), body))
        return sound_deeds, letters.requests, sound_answers

    def _refuse_addresses(self, requests: Sequence[tuple[str, Request]]) -> None:
        """Raise ValueError if a recipient does not exist, or would hear too many requests."""
        for to, count in Counter(to for to, _ in requests).items():
            if to not in self._names:
                raise ValueError(f"a request to {printable(to)!r}: no agent has that name")
            refuse_more(f"requests to {to}", count, limits.MOST_TO_ONE)

    def _typed(self, mail: Mail) -> Mail:
        """Return mail with messages of the agent's own types.

        A request that does not fit its type is left out. Of a reply that does not fit, the part is
        None.
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
        """Return a message as the agent's own type of its name.

        Log a warning and return None if it does not fit that type.
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
        """Return a message of the agent's own types as a `CustomMessage`, another as it is."""
        if type(body) not in self._messages.values():
            return body
        fields = msgspec.to_builtins(body, order="deterministic")
        return CustomMessage(fields.pop("type"), fields)


def _ask(agent: Any, observation: Observation, mail: Mail, memory: Any) -> Any:
    """Return what an agent answers.

    An agent may change settings of its thread, such as how numpy treats errors. They are set back.
    """
    return contained(agent.tick, with_own_arrays(observation), mail, memory)


def _standing(memory: Any) -> Action:
    """Return the action of a broken agent, which keeps the memory that it had."""
    return Action(memory=memory, doing="broken", state="broken")


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


def place_in_agent(frame: FrameType | None) -> str:
    """Return the place in the user's code that the program has called; '' if it has called none.

    `frame`: where the program is now. A policy of the user's is called by an agent of the program.
    So the first call in a file of the user's counts; without one, the first of the agent.
    """
    calls = _calls_by_program(frame)
    return place_in_own_code(frame) or _place_of_first(calls)


def place_in_own_code(frame: FrameType | None) -> str:
    """Return the same as `place_in_agent`, but '' for code of the program or of a library."""
    calls = _calls_by_program(frame)
    return _place_of_first([call for call in calls if plugins.is_own(call.filename)])


def _calls_by_program(frame: FrameType | None) -> list[traceback.FrameSummary]:
    """Return the calls, from the outermost, that a guard or `contained` has made; else none."""
    calls = traceback.extract_stack(frame)
    callers = [i for i, call in enumerate(calls) if call.filename in CALLERS]
    if not callers:
        return []
    helpers = (*CALLERS, checks.__file__, repetition.__file__)
    return [call for call in calls[callers[-1] :] if call.filename not in helpers]


def _place_of_first(calls: Sequence[traceback.FrameSummary]) -> str:
    """Return the place of the first of some calls, as ', in FILE, line N'; '' if there is none."""
    if not calls:
        return ""
    return f", in {calls[0].filename}, line {calls[0].lineno}"
