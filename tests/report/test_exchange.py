"""The parts of an exchange of bins, beside the same exchanges in the discrete-event model."""

from collections import defaultdict
from itertools import pairwise

import pytest
from stage import empty_orchard

from orchard.agents.routes import route_of
from orchard.agents.steps import Deliver, FetchEmpty, LeaveBin, Say
from orchard.discrete.harvest import DiscreteHarvest
from orchard.discrete.robots import Robot
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP
from orchard.report.exchange import exchanges

ROUNDS = 6


@pytest.fixture
def done(monkeypatch):
    """Robot -> its steps, each with the times at which it began and ended, s."""
    steps, do = defaultdict(list), vars(Robot)["do"]

    def noted(robot, step):
        begun = robot.env.now
        yield from do.__get__(robot, Robot)(step)
        steps[robot.name].append((step, begun * TIME_STEP, robot.env.now * TIME_STEP))

    monkeypatch.setattr(Robot, "do", noted)
    return steps


BEGAN, ENDED = 1, 2
LEFT, CAME_OUT, HAS_BIN, PICKS = (LeaveBin, ENDED), (FetchEmpty, BEGAN), (FetchEmpty, ENDED), (Say, BEGAN)


def times(steps, kind, when):
    """The times at which steps of a kind began or ended, s; of `Say` only those that begin to pick a row."""
    return [one[when] for one in steps if isinstance(one[0], kind) and (kind is not Say or one[0].state == "picking")]


def long_run(**values):
    """Do a long harvest in the model. Return picker -> its exchanges."""
    layout = lay_out(empty_orchard(**values))
    rows = ROUNDS * max(len(block.rows) for block in layout.blocks.values())
    DiscreteHarvest(layout, rows).run()
    return {name: exchanges(route_of(layout), block, ROUNDS) for name, block in layout.blocks.items()}


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_a_carrier_that_is_always_wanted_needs_its_rounds_and_little_more(done, route):
    """What it needs more is the time until the next bin has called it."""
    each = {name: iter(some) for name, some in long_run(rows=4, pickers=2, carriers=1, route=route, dispatch="nearest").items()}
    came = [(next(each[step.picker]), begun) for step, begun, _ in done["carrier_01"] if isinstance(step, Deliver)]
    assert len(came) == 4 * ROUNDS
    late = [there - before - (one.cycle - one.approach + other.approach) for (one, before), (other, there) in pairwise(came)]
    assert min(late) == pytest.approx(0.5, abs=0.3)
    assert max(late) < 4.0


@pytest.mark.parametrize("route", ["one-way", "two-way"])
@pytest.mark.parametrize(("rows", "pickers"), [(4, 2), (3, 3)])
def test_a_picker_whose_carrier_came_early_needs_little_less_than_in_the_model(done, route, rows, pickers):
    """With a row for each picker it turns back into the row that it came from, where its carrier still is."""
    each = long_run(rows=rows, pickers=pickers, carriers=8, picking_speed=0.3, route=route)["picker_01"]
    left, came_out, has_bin, goes_on = (times(done["picker_01"], *what) for what in (LEFT, CAME_OUT, HAS_BIN, PICKS))
    ways = []
    for one, begun, out, bin_there, on in list(zip(each, left, came_out, has_bin, goes_on[1:], strict=False))[2:]:  # in the long run
        assert out - begun == pytest.approx(one.coming_out, abs=0.05)
        assert 0.0 < bin_there - begun - one.wait(early=True) < 1.0
        ways.append(on - bin_there - one.going_on)
    assert -0.05 < min(ways) < 0.5
