"""A memory that its bytes do not give back is refused in the tick in which it is returned, with the agent and the place in it."""

import enum
import math
import re
from collections import defaultdict

import msgspec
import pytest
from local_runs import SMALL, local_hash

from orchard.contract.agent import Action
from orchard.local import Local


class Note(msgspec.Struct):
    text: str = ""
    seen: object = None


class Colour(enum.IntEnum):
    GREEN = 1


class Keeper:
    """Returns these memories in turn, the last one for ever, and notes those that it gets."""

    def __init__(self, *memories, type_=dict):
        self.memories, self.Memory, self.got = memories, type_, []

    def tick(self, observation, mail, memory):
        self.got.append(memory)
        return Action(memory=self.memories[min(observation.tick, len(self.memories) - 1)])


def played(keeper, ticks=1):
    local = Local(SMALL)
    local.play("picker_01", keeper)
    for _ in range(ticks):
        local.tick()
    return local


@pytest.mark.parametrize(
    ("memory", "type_", "place"),
    [
        ({"seen": {3}}, dict, "memory['seen']: set {3}, then list [3]"),
        ({"a": [1, {"b": (1, 2)}]}, dict, "memory['a'][1]['b']: tuple (1, 2), then list [1, 2]"),
        ({"plan": [Note()]}, dict, "memory['plan'][0]: Note Note(text='', seen=None), then dict"),
        (Note(seen={3}), Note, "memory.seen: set {3}, then list [3]"),
        ({"of": defaultdict(int)}, dict, "memory['of']: defaultdict"),
        ({"of": Colour.GREEN}, dict, "memory['of']: Colour <Colour.GREEN: 1>, then int 1"),
        ({"a": [{"b": object()}]}, dict, "memory['a'][0]['b']: Encoding objects of type object is unsupported"),
        ({"a": 2**70}, dict, "memory['a']: can't serialize ints"),
        ({"a": "one"}, dict[str, float], "its memory does not fit its `Memory`, dict[str, float]: Expected `float`, got `str`"),
        (5, dict, "its memory does not fit its `Memory`"),
    ],
)
def test_a_memory_that_is_another_after_a_kill_is_refused_at_once(memory, type_, place, caplog):
    keeper = Keeper(memory, type_=type_)
    local = played(keeper, 2)
    assert local.actions["picker_01"].state == "broken"
    assert keeper.got == [None, None]
    (record,) = caplog.records
    assert re.search(rf"^picker_01 raised an error at tick 0(.|\n)*{re.escape(place)}", record.getMessage())


@pytest.mark.parametrize(
    ("memory", "type_"),
    [
        ({"a": math.nan, "b": math.inf, "c": None, "d": b"x"}, dict), ({1: [True]}, dict), ({"a": 1}, dict[str, float]),
        ({1, 2}, set[int]), ((1, "x"), tuple[int, str]), (Note(seen=[1]), Note),
    ],
)  # fmt: skip
def test_a_memory_that_its_bytes_give_back_is_kept(memory, type_):
    assert played(Keeper(memory, type_=type_), 3).actions["picker_01"].state != "broken"


def test_a_memory_with_the_same_bytes_and_another_type_is_refused_too():
    local = played(Keeper({"a": [1]}, {"a": (1,)}), 2)
    assert local.actions["picker_01"].state == "broken"
    assert local.memories["picker_01"] == {"a": [1]}


class Careless:
    """Changes its memory in place, and then raises an error."""

    Memory = dict

    def tick(self, observation, mail, memory):
        if memory is not None:
            memory["n"] += 1
            memory["seen"] = {3}
        return Action(memory=memory or {"n": 0})


def test_what_an_agent_changes_before_its_error_does_not_count():
    assert played(Careless(), 5).memories["picker_01"] == {"n": 0}


def test_a_memory_is_refused_over_the_network_as_in_local_mode(fleet):
    collecting = SMALL.model_copy(update={"agents": {"picker_01": "own_agents.Collector"}})
    fleet.physics(collecting, "--duration", "1")
    host = fleet.host()
    code, out, _ = fleet.world.end()
    assert code == 1, "an agent is broken"
    assert f"hash {local_hash(collecting, 10)}" in out
    assert re.search(r"picker_01 raised an error at tick 0(.|\n)*memory\['seen'\]: set \{'picker_01'\}, then list", host.end()[2])
