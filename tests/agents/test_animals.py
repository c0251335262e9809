"""The behaviour of dogs and cats."""

from itertools import pairwise

import pytest
from msgspec.structs import replace
from quiet_orchards import one_guest

from orchard.agents.walker import Animal
from orchard.contract.agent import Mail
from orchard.field.layout import lay_out
from orchard.field.scenario import Animals, Scenario
from orchard.local import Local


@pytest.mark.parametrize("kind", ["dog", "cat"])
def test_animals_change_their_mind_every_three_seconds_and_keep_it_until_then(kind):
    stage = one_guest(kind, 0.0, 20.0)
    speeds = []
    for _ in range(600):
        stage.tick()
        speeds.append(stage.local.memories[f"{kind}_01"].speed)
    changes = [i for i in range(1, 600) if speeds[i] != speeds[i - 1]]
    assert [later - one for one, later in pairwise(changes)] == [30] * (len(changes) - 1)
    assert len(changes) >= 19 and len(set(speeds)) == len(changes) + 1
    assert all(0 <= speed <= 3 for speed in speeds)


def test_animals_do_not_change_their_minds_in_the_same_tick():
    layout = lay_out(Scenario(animals=Animals(dogs=10, cats=10)))
    phases = {Animal(layout, name).phase for name in layout.names if name.startswith(("dog", "cat"))}
    assert len(phases) > 8
    assert phases <= set(range(30))


def test_animals_change_their_mind_although_they_do_not_see_every_tick():
    """As in realtime, where ticks may be left out."""
    seen = one_guest("dog", 0.0, 20.0).local.engine.observe()["dog_01"]
    dog = Animal(Local(Scenario()).engine.layout, "dog_01")
    memory = dog.tick(seen, Mail(), None).memory
    minds, start = [], 60 - dog.phase
    for tick in (start - 1, start + 1, start + 29, start + 31):
        memory = dog.tick(replace(seen, tick=tick), Mail(), memory).memory
        minds.append(memory.speed)
    assert minds[0] != minds[1] == minds[2] != minds[3]
