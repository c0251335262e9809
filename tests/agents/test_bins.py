"""The answers of bins."""

import pytest
from stage import Stage, empty_orchard

from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.messages import BinState, StateRequest
from orchard.field.scenario import NEAREST, People, Scenario
from orchard.local import Local


class Asker:
    """Asks bin_01 for its state at tick 0, and after its picker has left it full."""

    Memory = dict

    def __init__(self) -> None:
        self.answers: list = []

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        self.answers += [reply.body for reply in mail.replies]
        return Action(requests=[("bin_01", StateRequest())] if seen.tick in (0, 720) else [], memory=memory)


def test_bins_tell_whether_they_are_full_and_on_whom():
    asker = Asker()
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0), dispatch=NEAREST), worker_01=asker)
    stage.run(73)
    begun, left = asker.answers
    assert (begun.full, begun.coupled_to) == (False, "picker_01")
    assert begun.fill == pytest.approx(0.1), "asked at 0 s, heard at 0.1 s"
    assert left == BinState(full=True, fill=70.0, coupled_to="")


def test_a_bin_that_begins_without_a_memory_on_a_picker_that_has_begun_forecasts_by_the_mean_speed():
    """As in realtime, where a process that is killed early has given no memory yet."""
    local = Local(Scenario(rows=3, seed=3))
    while local.engine.tick < 150:
        local.tick()
    del local.memories["bin_01"]
    local.engine.wake(["bin_01"])
    local.tick()
    assert local.answers["bin_01"].state == "picking"
