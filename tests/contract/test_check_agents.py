"""Agents must be repeatable: `--check-agents` names those that are not, and a memory that its bytes
do not give back is refused.
"""

import enum
import math
import re
from collections import defaultdict

import msgspec
import pytest
import unrepeatable
from command_line import orchard, scenario_file
from local_runs import SMALL, driven_by, local_hash, played

from orchard.contract.agent import Action
from orchard.local import Local


def with_picker(class_):
    """Return the small scenario with a class of `unrepeatable` as picker_01."""
    return SMALL.model_copy(update={"agents": {"picker_01": f"unrepeatable.{class_}"}})


def checked(class_, ticks=6):
    """Run with `--check-agents` for some ticks."""
    return played(Local(with_picker(class_), check_agents=True), ticks)


# A class of `unrepeatable`, and what is said of it: the tick, the place in its answer that
# differed, and both values.
UNREPEATABLE = [
    ("Clockwork", r"tick \d: its answer\.twist: Twist"),
    ("Chancy", r"tick 0: its answer\.twist: Twist\(x=0\.\d+, .*\), then Twist"),
    ("Unseeded", r"tick 0: its answer\.twist"),
    ("Counting", r"tick 1: its answer\.twist: Twist\(x=0\.02, .*\), then Twist\(x=0\.01"),
    ("Latch", r"tick 4: its answer\.twist: Twist\(x=0\.0, .*\), then Twist\(x=0\.25"),
    ("Shared", r"tick 0: its answer\.twist"),
    ("Diary", r"tick 1: its answer\.memory\['asked'\]\[0\]: 2, then 1"),
    ("Tired", r"tick 0: its answer: an action, then, asked again, RuntimeError: asked again"),
]


@pytest.mark.parametrize(("class_", "words"), UNREPEATABLE)
def test_what_is_not_repeatable_is_logged_once_with_its_place(class_, words, caplog, monkeypatch):
    monkeypatch.setattr(unrepeatable, "SHARED", {"count": 0})
    local = checked(class_)
    (record,) = caplog.records
    assert re.match(f"picker_01 is not repeatable, {words}", record.getMessage())
    assert local.actions["picker_01"].state == "broken"


@pytest.mark.parametrize("class_", ["Tidy", "OwnPicker"])
def test_what_is_repeatable_runs_as_without_the_check(class_, caplog):
    local = checked(class_, 40)
    assert not caplog.records
    assert local.engine.hash == local_hash(with_picker(class_), 40)


def test_an_agent_that_local_mode_is_given_is_checked_too(caplog):
    played(Local(SMALL, check_agents=True), 2, picker_02=unrepeatable.Counting(None, "picker_02"))
    assert "picker_02 is not repeatable, tick 1: its answer.twist" in caplog.text


@pytest.mark.parametrize(
    ("mode", "tick", "seconds"), [("local", "1", 1), ("lockstep", "1", 1), ("realtime", r"\d+", 3)]
)
def test_the_command_line_checks_agents_and_exits_with_1(mode, tick, seconds, tmp_path):
    """In realtime a busy host may miss the first ticks."""
    path = scenario_file(tmp_path, with_picker("Counting"))
    done = orchard(
        path,
        "--check-agents",
        "--mode",
        mode,
        "--hosts",
        1,
        "--duration",
        seconds,
        "--record",
        "none",
        code=1,
    )
    output = done.stdout + done.stderr
    assert re.search(f"picker_01 is not repeatable, tick {tick}: its answer.twist: ", output), (
        output
    )
    assert re.search(f"broken: picker_01, since tick {tick}", output), output


class Note(msgspec.Struct):
    """A struct that an agent remembers."""

    text: str = ""
    seen: object = None


class Colour(enum.IntEnum):
    GREEN = 1


class Keeper:
    """Returns these memories in turn, the last one for ever, and notes which memories it gets."""

    def __init__(self, *memories, type_=dict):
        self.memories = memories
        self.Memory = type_
        self.got = []

    def tick(self, observation, mail, memory):
        self.got.append(memory)
        return Action(memory=self.memories[min(observation.tick, len(self.memories) - 1)])


# A memory that its bytes do not give back, its type, and what is said of it.
CHANGED = [
    ({"seen": {3}}, dict, "memory['seen']: set {3}, then list [3]"),
    ({"a": [1, {"b": (1, 2)}]}, dict, "memory['a'][1]['b']: tuple (1, 2), then list [1, 2]"),
    ({"plan": [Note()]}, dict, "memory['plan'][0]: Note Note(text='', seen=None), then dict"),
    (Note(seen={3}), Note, "memory.seen: set {3}, then list [3]"),
    ({"of": defaultdict(int)}, dict, "memory['of']: defaultdict"),
    ({"of": Colour.GREEN}, dict, "memory['of']: Colour <Colour.GREEN: 1>, then int 1"),
    (
        {"a": [{"b": object()}]},
        dict,
        "memory['a'][0]['b']: Encoding objects of type object is unsupported",
    ),
    ({"a": 2**70}, dict, "memory['a']: can't serialize ints"),
    (
        {"a": "one"},
        dict[str, float],
        "its memory does not fit its `Memory`, dict[str, float]: Expected `float`, got `str`",
    ),
    (5, dict, "its memory does not fit its `Memory`"),
]


@pytest.mark.parametrize(("memory", "type_", "place"), CHANGED)
def test_a_memory_that_differs_after_a_kill_is_refused(memory, type_, place, caplog):
    keeper = Keeper(memory, type_=type_)
    local = played(SMALL, 2, picker_01=keeper)
    assert local.actions["picker_01"].state == "broken"
    assert keeper.got == [None, None]
    (record,) = caplog.records
    words = (
        r"^picker_01 raised an error at tick 0; it stands.\n  Keeper \(.*, line"
        rf" \d+\):\n(.|\n)*{re.escape(place)}"
    )
    assert re.search(words, record.getMessage())


# A memory that its bytes give back, and its type.
KEPT = [
    ({"a": math.nan, "b": math.inf, "c": None, "d": b"x"}, dict),
    ({1: [True]}, dict),
    ({"a": 1}, dict[str, float]),
    ({1, 2}, set[int]),
    ((1, "x"), tuple[int, str]),
    (Note(seen=[1]), Note),
]


@pytest.mark.parametrize(("memory", "type_"), KEPT)
def test_a_memory_that_its_bytes_give_back_is_kept(memory, type_):
    assert (
        played(SMALL, 3, picker_01=Keeper(memory, type_=type_)).actions["picker_01"].state
        != "broken"
    )


def test_a_memory_of_the_same_bytes_and_another_type_is_refused():
    local = played(SMALL, 2, picker_01=Keeper({"a": [1]}, {"a": (1,)}))
    assert local.actions["picker_01"].state == "broken"
    assert local.memories["picker_01"] == {"a": [1]}


class Careless:
    """Changes its memory in place from its second tick on, and puts a set into it: an error."""

    Memory = dict

    def tick(self, observation, mail, memory):
        if memory is not None:
            memory["n"] += 1
            memory["seen"] = {3}
        return Action(memory=memory or {"n": 0})


def test_what_an_agent_changes_before_its_error_does_not_count():
    assert played(SMALL, 5, picker_01=Careless()).memories["picker_01"] == {"n": 0}


def test_a_memory_is_refused_over_the_network_as_in_local_mode(fleet):
    collecting = driven_by(picker_01="Collector")
    fleet.physics(collecting, "--duration", "1")
    host = fleet.host()
    code, out, _ = fleet.world.end()
    assert code == 1, "an agent is broken"
    assert f"hash {local_hash(collecting, 10)}" in out
    assert re.search(
        r"picker_01 raised an error at tick 0(.|\n)*memory\['seen'\]: set \{'picker_01'\}, then"
        r" list",
        host.end()[2],
    )
