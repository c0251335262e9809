"""The guard of an agent: `Guard` calls a user's agent, and checks what it returns.

Whatever the agent returns or raises, only this agent is broken; and what its guard passes, physics
accepts and a person can read. Hypothesis draws actions: right ones (`sound`) in which at most one
field is replaced by something odd (`slips`).
"""

import asyncio
import math
import re
import signal
from enum import StrEnum

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import SMALL, local_hash, played
from msgspec.structs import replace

from orchard.behaviour.catalogue import AGENTS, guarded
from orchard.behaviour.picker import Picker
from orchard.contract import messages
from orchard.contract.agent import Action, Heard, Mail, without_body
from orchard.contract.guard import Guard
from orchard.contract.mail import digest_of, given_by
from orchard.contract.messages import CustomMessage, Uncouple, Where, pack
from orchard.dispatch.ranking import Nearest
from orchard.field.geometry import Twist
from orchard.field.kinds import kind_of
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.net.refusals import read_message
from orchard.wire.codec import report_of, velocities_of
from orchard.wire.messages import Answered, Letter, Letters, Velocities

NAMES = ["carrier_01", "picker_01", "picker_02", "traffic"]
RUN = "run1"


class Doing:
    """An agent that returns one action, or raises one error."""

    Memory = dict

    def __init__(self, action):
        self.action = action

    def tick(self, observation, mail, memory):
        if isinstance(self.action, BaseException):
            raise self.action
        return self.action


class Agreeable:
    """A value that says that it is equal to everything, and 0, and empty: checks by == pass it."""

    __eq__ = lambda self, other: True  # noqa: E731
    __ne__ = lambda self, other: False  # noqa: E731
    __hash__ = lambda self: 0  # noqa: E731
    __len__ = lambda self: 0  # noqa: E731
    __iter__ = lambda self: iter(())  # noqa: E731
    __float__ = lambda self: 0.0  # noqa: E731


class Sly(str):
    """A text that pretends to be short and printable."""

    __slots__ = ()
    __len__ = lambda self: 3  # noqa: E731
    __str__ = isprintable = lambda self: True


class Word(StrEnum):
    """A text of a type of the user's."""

    PICKING = "picking"


def nested(levels, make=lambda inner: [inner]):
    """Return 0 within so many levels of what `make` makes of an inner level."""
    data = make(0)
    for _ in range(levels):
        data = make(data)
    return data


TEXTS = ["", "\ud800", "\x1b[2J", "a\nb", "x" * 70, "picker_01\n", Sly("\x07" * 900)]
NUMBERS = [2**53, 2**60, 2**64, True, math.nan, 101, -0.0]
# Values that are too large, too deep, or of a type that no message may have.
MONSTERS = [
    b"x" * 40_000,
    {1, 2},
    nested(40),
    nested(200),
    nested(60, lambda x: {"a": x}),
    {nested(60, lambda x: (x,)): 1},
    object,
]
# What agents may return at the places of texts, numbers, names, and so on: right or wrong.
texts = st.text(st.characters(codec=None), max_size=220) | st.sampled_from(TEXTS)
numbers = (
    st.integers() | st.integers(-3, 20) | st.floats() | st.booleans() | st.sampled_from(NUMBERS)
)
leaves = (
    st.none()
    | numbers
    | texts
    | st.binary(max_size=40)
    | st.builds(Agreeable)
    | st.sampled_from(list(Word))
    | st.complex_numbers()
)
anything = st.recursive(
    leaves | st.sampled_from(MONSTERS),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.tuples(inner, inner)
        | st.dictionaries(texts | st.integers(), inner, max_size=3)
    ),
    max_leaves=6,
)
names = (
    st.sampled_from([*NAMES, "*", "worker_0$*", "picker_01/mail", "nobody_01", "", "**"])
    | texts
    | anything
)
deeds = st.sampled_from([messages.Couple("bin_01"), Uncouple(), messages.Flatten()]) | st.builds(
    messages.Couple, st.text(max_size=64)
)
requests = st.sampled_from(
    [
        messages.Call(1, "east", 0),
        messages.Come(1, "west", "picker_01"),
        Where(),
        CustomMessage("a", {"b": [1.5, {}]}),
    ]
)
answers = st.sampled_from(
    [messages.Yes(), messages.No("no"), messages.Offer(1.0, 2.0, 3.0), CustomMessage("a", {})]
) | st.builds(messages.No, st.text(max_size=200))
letters = st.lists(st.tuples(st.sampled_from(NAMES), requests), max_size=6)
heard = st.builds(Heard, st.sampled_from(NAMES), st.integers(0, 9), st.integers(0, 9), requests)
replies = st.lists(st.tuples(heard, answers), max_size=4)
odd = (
    st.builds(messages.Call, anything, names | st.sampled_from(["east", "east\n"]))
    | st.builds(messages.Come, st.integers(0, 5), st.just("east"), names)
    | st.builds(messages.Here, names)
    | st.builds(messages.Offer, numbers, numbers, numbers)
    | st.builds(messages.Places, st.lists(texts, max_size=3), st.lists(texts, max_size=3), anything)
    | st.builds(
        CustomMessage, texts | st.just("a"), st.dictionaries(texts, anything, max_size=3) | anything
    )
    | anything
)
# m/s or rad/s that the guard accepts.
speeds = st.floats(-100, 100)
memories = st.dictionaries(st.text(), st.integers(0, 9))
wild = st.sampled_from([0, 1, True, 101.0, -0.0, math.nan]) | anything
sound = st.builds(
    Action,
    st.builds(Twist, speeds, st.just(0.0), speeds),
    st.lists(deeds, max_size=3),
    letters,
    replies,
    memories,
    texts,
    st.sampled_from([None, "picking", Word.PICKING]),
    texts,
    st.integers(0, 2**53 - 1),
)
# Field of an action -> values that are often wrong there.
slips = {
    "twist": st.builds(Twist, speeds | wild, st.just(0.0) | wild, speeds | wild) | anything,
    "deeds": st.lists(deeds | odd, max_size=18) | st.lists(deeds, max_size=20) | anything,
    "requests": (
        st.builds(
            lambda some, one: [*some, one], letters, st.tuples(names, requests | odd) | anything
        )
        | letters.map(tuple)
        | anything
    ),
    "answers": (
        st.builds(
            lambda some, more: [*some, more],
            replies,
            st.tuples(heard | anything, answers | odd) | anything,
        )
        | anything
    ),
    "memory": anything,
    "doing": anything,
    "state": anything,
    "waits_for": anything,
    "steps_done": wild | st.sampled_from(NUMBERS),
}
# {field: value} of one slip.
slip = st.sampled_from(sorted(slips)).flatmap(
    lambda name: slips[name].map(lambda value: {name: value})
)
actions = (
    st.builds(lambda action, change: replace(action, **change), sound, slip | st.just({}))
    # What is no action at all.
    | anything
)


def of_the_guard(action, mail=None):
    """Return a guard, and what it passes of an action of picker_01 at tick 7."""
    guard = Guard("picker_01", Doing(action), NAMES)
    return guard, guard.tick(without_body("picker_01", 7), mail or Mail(), {"a": 1})


@given(actions)
@settings(max_examples=300)
def test_physics_accepts_whatever_the_guard_passes(wild):
    """Physics hears the same in lockstep as local mode does."""
    guard, action = of_the_guard(wild)
    report = report_of(action, digest_of(Mail()), guard.packed)
    payload = pack(Velocities(RUN, 7, "host1", {"picker_01": report}))
    velocities, faults = velocities_of(payload)
    assert not faults
    # Texts are compared, because nan is not equal to nan, and -0.0 is equal to 0.0.
    arrived = velocities.velocities["picker_01"]
    assert repr(arrived) == repr(report)
    assert repr(arrived.answers) == repr(given_by(action))
    names = ("twist", "deeds", "requests", "doing", "state", "waits_for", "steps_done", "hold")
    assert all(repr(getattr(arrived, name)) == repr(getattr(action, name)) for name in names)
    assert action.doing.isprintable()
    assert action.waits_for.isprintable()
    read_message(
        pack(Letters(RUN, 7, {"picker_01": messages.Written(arrived.requests, arrived.answers)})),
        Letters,
        RUN,
    )
    for number, (to, body) in enumerate(action.requests):
        assert to in NAMES
        read_message(pack(Letter(RUN, 7, "picker_01", number, body)), Letter, RUN)
    for to, body in action.answers:
        hash((to.sender, to.tick, to.number))
        read_message(pack(Answered(RUN, 7, body)), Answered, RUN)


# What an action has in place of its own fields, and what is said of it. None: no action at all.
TOO_MUCH = [
    ({"requests": [("carrier_01", Where())] * 60_000}, "60000 requests in one tick; at most 500"),
    ({"requests": [("traffic", Where())] * 9}, "9 requests to traffic in one tick; at most 8"),
    (
        {"requests": [("carrier_01", CustomMessage("a", {"b": "x" * 2_000_000}))]},
        r"its deeds and messages take 2000\d+ bytes; at most 32768",
    ),
    (
        {"requests": [("carrier_01", CustomMessage("a", {"b": nested(40)}))]},
        "a: lists and maps are nested more than 32 levels deep",
    ),
    ({"requests": [("carrier_01", messages.Call(1, "east\n", 0))]}, "matching regex"),
    ({"requests": [("*", Where())]}, r"a request to '\*': no agent has that name"),
    (
        {"requests": [("worker_0$*", Where())]},
        r"a request to 'worker_0\$\*': no agent has that name",
    ),
    (
        {"requests": [("carrier_01/mail", Where())]},
        "a request to 'carrier_01/mail': no agent has that name",
    ),
    ({"requests": [("carrier_1", Where())]}, "a request to 'carrier_1': no agent has that name"),
    ({"requests": None}, "requests NoneType: must be a list"),
    ({"requests": [("carrier_01", messages.Call(1, "north", 0))]}, "matching regex"),
    (
        {"requests": [("carrier_01", messages.Here("x" * 40_000))]},
        r"messages take \d+ bytes; at most 32768",
    ),
    ({"deeds": None}, "deeds NoneType: must be a list"),
    ({"deeds": [Uncouple()] * 17}, "17 deeds in one tick; at most 16"),
    ({"twist": Twist(0.0, 1.0)}, "a picker does not move sideways"),
    ({"doing": None}, "doing None.*both must be text"),
    ({"steps_done": -1}, "steps_done -1: must be a whole number from 0"),
    ({"steps_done": True}, "steps_done True: must be a whole number from 0 to 9007199254740991"),
    (
        {"steps_done": 2**60},
        "steps_done 1152921504606846976: must be a whole number from 0 to 9007199254740991",
    ),
    ({"memory": "\ud800"}, "surrogates not allowed"),
    ({"memory": object()}, "memory: Encoding objects of type object is unsupported"),
    ({"memory": b"x" * 300_000}, "its memory takes 300005 bytes; at most 32768"),
    (None, "tick returned NoneType; it must return an Action"),
]


@pytest.mark.parametrize(("slip", "words"), TOO_MUCH)
def test_what_is_too_much_is_told_with_limit_and_figure(slip, words, caplog):
    returned = None if slip is None else Action(**{"twist": Twist(x=1.0)} | slip)
    _, action = of_the_guard(returned)
    # It stands, and keeps the memory that it had.
    assert action.state == "broken"
    assert action.twist.x == 0.0
    assert action.memory == {"a": 1}
    assert len(caplog.text) < 3000, "a part of the megabytes of text is shown"
    (record,) = caplog.records
    assert record.getMessage().startswith("picker_01 raised an error at tick 7; it stands.")
    assert re.search(words, record.getMessage())


class Unheard(BaseException):
    """An error whose text cannot be had."""

    def __str__(self):
        raise KeyboardInterrupt


ERRORS = [
    KeyboardInterrupt("mine"),
    SystemExit(3),
    asyncio.CancelledError(),
    GeneratorExit(),
    Unheard(),
]


@pytest.mark.parametrize("error", [*ERRORS, BaseExceptionGroup("some", ERRORS)])
def test_whatever_an_agent_raises_breaks_only_this_agent(error):
    local = played(SMALL, 1, picker_01=Doing(error))
    assert local.actions["picker_01"].state == "broken"
    assert local.actions["picker_02"].state != "broken"


class Busy:
    """An agent that is at work when Ctrl-C comes."""

    Memory = dict

    def tick(self, observation, mail, memory):
        signal.raise_signal(signal.SIGINT)
        return Action()


def stop(number, frame):
    """Act as Ctrl-C does."""
    raise KeyboardInterrupt


@pytest.mark.parametrize("handler", [signal.default_int_handler, stop])
def test_ctrl_c_ends_the_program_whatever_agent_works(handler):
    # A shell starts a program in the background with SIGINT ignored.
    old = signal.signal(signal.SIGINT, handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Guard("picker_01", Busy(), NAMES).tick(without_body("picker_01", 7), Mail(), None)
    finally:
        signal.signal(signal.SIGINT, old)


# Scenarios in which all kinds of built-in agents and steps are at work.
HARVESTS = [
    {},
    {"dispatch": "nearest", "route": "two-way", "pickers": 3, "rows": 5},
    {
        "dispatch": "predictive-farthest",
        "picking": {"failure": {"mean_between": 60.0, "mean_repair": 20.0}},
        "sensors": {"gnss": {"white": 0.01, "bias": 0.02}},
    },
]


@pytest.mark.parametrize("changes", HARVESTS)
def test_built_in_agents_pass_the_guard_of_own_agents(changes, caplog):
    """So the checks may be left out for built-in agents."""
    scenario = Scenario(**{"rows": 3, "pickers": 2, "carriers": 2, "row_length": 20.0} | changes)
    layout = lay_out(scenario)
    agents = {
        name: Guard(name, AGENTS[kind_of(name)](layout, name), list(layout.agents))
        for name in layout.agents
    }
    # In 170 s a bin is unloaded, and its carrier drives back.
    assert local_hash(scenario, 1700, agents) == local_hash(scenario, 1700)
    assert not caplog.records


# What a built-in agent raises or returns, and what is said of it.
GOING_WRONG = [
    (ZeroDivisionError(), "ZeroDivisionError"),
    (Action(Twist(x=math.nan)), "each number must be from"),
    (Action(Twist(y=0.1)), "a picker does not move sideways"),
    (Action(requests=[("*", Where())]), r"a request to '\*': no agent has that name"),
]


@pytest.mark.parametrize(("action", "words"), GOING_WRONG)
def test_a_built_in_agent_gone_wrong_stands_and_keeps_memory(action, words, caplog):
    guard = Guard("picker_01", Doing(action), NAMES, trusted=True)
    action = guard.tick(without_body("picker_01", 7), Mail(), {"a": 1})
    assert action.state == "broken"
    assert action.memory == {"a": 1}
    assert re.search(words, caplog.text)


class NearestOfMine(Nearest):
    """A policy of the user's."""


class MyPicker(Picker):
    """A picker of the user's."""


# What a scenario names, the class of the agent, and whether no code of the user can have a part in
# what the agent returns.
TRUSTED = [
    ({}, Picker, True),
    ({}, MyPicker, False),
    ({"dispatch": f"{__name__}.NearestOfMine"}, Picker, False),
    ({"route": "examples.seams.signalled_route.SignalledRoute"}, Picker, False),
]


@pytest.mark.parametrize(("changes", "class_", "is_trusted"), TRUSTED)
def test_an_agent_of_a_built_in_policy_and_route_is_trusted(changes, class_, is_trusted):
    """A trusted agent may return what an agent of the user may not."""
    layout = lay_out(SMALL.model_copy(update=changes))
    agent = class_(layout, "picker_01")
    agent.tick = Doing(Action(doing=5)).tick
    action = guarded(layout, "picker_01", agent).tick(without_body("picker_01", 7), Mail(), None)
    assert (action.state != "broken") == is_trusted
