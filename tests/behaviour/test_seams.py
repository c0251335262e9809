"""The seams of the program: the classes and functions of a user that a scenario can name besides
agents. They are a policy, a rule for rows, a route, and agents without a body, with messages and
steps of their own.

Each example of examples/seams/ runs in local mode and in lockstep with the same hash. Faulty ones
stand below, named as `test_seams.Raising`.
"""

from functools import cache

import pytest
from local_runs import start_afresh

from orchard import (
    Assignment,
    BinReport,
    Block,
    CarrierReport,
    Local,
    OneWay,
    Scenario,
    ScenarioError,
    Step,
    lay_out,
)
from orchard.behaviour.catalogue import check_plugins
from orchard.contract.messages import CustomMessage
from orchard.field.scenario import check
from orchard.plans.steps import Haul
from orchard.report.bounds import Bounds
from orchard.report.plan import orchard_plan

EXAMPLES = {
    "dispatch": {"dispatch": "examples.seams.farthest_first.FarthestFirst"},
    "early dispatch": {"dispatch": "examples.seams.in_time.InTime"},
    "rows": {"rows_to_pickers": "examples.seams.from_the_east.from_the_east"},
    "route": {"route": "examples.seams.signalled_route.SignalledRoute"},
    "agents and messages": {
        "agents": {"picker": "examples.seams.bin_counter.CountingPicker"},
        "agents_without_body": {"counter": "examples.seams.bin_counter.Counter"},
    },
}
# 50 s, in which bins call, and carriers are under way.
TICKS = 500


def scenario(**named) -> Scenario:
    """Return a small scenario that names the user's own classes."""
    alone = {"people": {"workers": 1, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
    return Scenario(rows=4, pickers=2, carriers=2, row_length=20.0, **alone, **named)


def run(local: Local, ticks: int = 12_000) -> Local:
    """Let a run go on until a tick, or until its harvest is over."""
    while not local.engine.over and local.engine.tick < ticks:
        local.tick()
    return local


@cache
def harvested(name: str) -> tuple[str, Local]:
    """Harvest with an example in local mode. Return its hash after TICKS, and the whole run."""
    harvest = run(Local(scenario(**EXAMPLES[name])), TICKS)
    early_hash = harvest.engine.hash
    return early_hash, run(harvest)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_has_the_local_hash_in_lockstep(name, fleet):
    fleet.physics(scenario(**EXAMPLES[name]), "--duration", str(TICKS / 10))
    fleet.share(2)
    assert fleet.end() == harvested(name)[0]


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_harvests_all_rows(name):
    _, local = harvested(name)
    assert local.engine.over
    assert local.engine.world.delivered == 4
    assert not [agent for agent, action in local.actions.items() if action.state == "broken"]


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_agent_can_be_started_afresh_from_its_bytes(name):
    local = Local(scenario(**EXAMPLES[name]))
    while local.engine.tick < TICKS:
        local.tick()
        if local.engine.tick % 240 == 0:
            start_afresh(local)
    assert local.engine.hash == harvested(name)[0]


def test_the_farthest_bin_is_fetched_first_by_that_policy():
    policy = Local(scenario(**EXAMPLES["dispatch"])).agents["dispatch"].agent.policy
    bins = [
        BinReport(f"bin_0{lane}", lane, "east", f"picker_0{lane}", since=0, metres=10.0 * lane)
        for lane in (1, 2)
    ]
    carriers = [CarrierReport("carrier_01", job="", is_next=True, metres=0.0)]
    assert policy.assign(0, bins, carriers, policy.Memory()) == [Assignment("bin_02", "carrier_01")]


def test_nearest_harvests_alike_through_the_dispatcher():
    local = run(Local(scenario(dispatch="orchard.dispatch.ranking.Nearest")))
    assert local.engine.over
    assert local.engine.world.delivered == 4


def test_rows_follow_the_rule_that_is_named():
    """A rule may return a Block for each picker, or only the numbers of its rows."""
    blocks = lay_out(Scenario(rows=4, pickers=2, **EXAMPLES["rows"])).blocks
    assert blocks == {"picker_01": Block((1, 2), "east"), "picker_02": Block((3, 4), "east")}
    assert lay_out(Scenario(rows=4, pickers=2, rows_to_pickers="test_seams.plain_rows")).blocks[
        "picker_02"
    ] == Block((4,), "west")


def test_bounds_and_drawings_follow_the_route_that_is_named():
    ours = lay_out(scenario())
    theirs = lay_out(scenario(route="test_seams.WiderLoop"))
    assert Bounds(theirs).cycle_seconds > Bounds(ours).cycle_seconds + 1.0
    assert orchard_plan(theirs) != orchard_plan(ours)


def test_an_answer_of_an_own_type_arrives_as_that_type():
    """A `Counter` asks each picker every 20 ticks for its progress, a type of its own."""
    local = run(Local(scenario(**EXAMPLES["agents and messages"])), 21)
    assert set(local.memories["counter"]) == {"picker_01", "picker_02"}
    (_, request), *_ = local.post.written[20]["picker_01"].requests
    assert request == CustomMessage("progress", {"steps": 2})


# -- what the tests name: one that works, WiderLoop, and many that do not


def from_the_middle(first, last, metres):
    """Let a bin begin in the middle of what is left of a row: an order may name an end only."""
    return (first + last) / 2


class WiderLoop(OneWay):
    """A route whose loop around the bottom is 2 m further south than that of `OneWay`. Metres."""

    F_BOTTOM = 5.5
    D_BOTTOM = 7.6


class Raising:
    def __init__(self, layout):
        raise LookupError("no map")


class WithoutArguments:
    Memory = dict


class Forgetful:
    Memory = dict

    def __init__(self, layout):
        pass


class Detour(Step, frozen=True):
    def act(self, robot):
        return True


class Wait(Detour, frozen=True):
    """A step that has the name of a built-in one."""


class Unregistered(OneWay):
    """A route with a step that it does not list."""

    def go_home(self, carrier):
        return [Detour(), *super().go_home(carrier)]


class Nested(OneWay):
    """A route whose own step is inside `Confirmed`: the wait to which a refused job falls back."""

    Steps = [Detour]  # noqa: RUF012

    def wait_in_queue(self):
        return [Detour(), *super().wait_in_queue()]


class SameName(OneWay):
    Steps = (Wait,)


class Failing(OneWay):
    def go_to_bay(self, lane, side):
        raise LookupError("no road")


class StaysHere(OneWay):
    """A route whose carriers never go to the load-out."""

    def fetch(self, carrier, lane, side, picker, full_bin):
        job = super().fetch(carrier, lane, side, picker, full_bin)
        return [step for step in job if not isinstance(step, Haul)]


class NoSuchQueue(OneWay):
    QUEUE = "nowhere"


def no_rows(scenario):
    return None


def plain_rows(scenario):
    return {"picker_01": [1, 2, 3], "picker_02": [4]}


def from_the_north(scenario):
    return {"picker_01": Block((1, 2)), "picker_02": Block((3, 4), start="north")}


def upwards(scenario):
    return {"picker_01": Block((1, 2)), "picker_02": Block((4, 3), start="east")}


def odd_and_even(scenario):
    return {"picker_01": (1, 3), "picker_02": (2, 4)}


def one_row_each(scenario):
    return {"picker_01": (1,), "picker_02": (2,)}


def between_rows(scenario):
    return {"picker_01": (1.4, 2), "picker_02": (3, 4)}


def rows_as_texts(scenario):
    return {"picker_01": "12", "picker_02": "34"}


# What a scenario names, and words of the error.
UNUSABLE = [
    ({"dispatch": "nowhere.Mine"}, "dispatch = nowhere.Mine: cannot be used: ModuleNotFoundError"),
    ({"dispatch": "test_seams.Raising"}, r"LookupError: no map \(.*test_seams.py, line \d+"),
    ({"dispatch": "test_seams.Forgetful"}, r"it has no assign \(.*test_seams.py, line \d+"),
    (
        {"dispatch": "test_seams.WithoutArguments"},
        r"; the program calls it with \(layout\) \(.*test_seams.py, line \d+",
    ),
    ({"route": "test_seams.Forgetful"}, "must be a class that is derived from OneWay"),
    ({"route": "test_seams.Unregistered"}, "Detour is not in `Steps`"),
    ({"route": "test_seams.SameName"}, "Wait"),
    ({"route": "test_seams.Nested"}, "Detour is not in `Steps`, or is within a step"),
    ({"route": "test_seams.Failing"}, r"LookupError: no road \(.*test_seams.py, line \d+"),
    ({"route": "test_seams.NoSuchQueue"}, "its QUEUE is 'nowhere'; must be one-way or two-way"),
    (
        {"route": "test_seams.StaysHere", "load_out": {"seconds_away": 60.0}},
        "load_out has no effect: fetch returns no step Haul",
    ),
    (
        {"rows_to_pickers": "test_seams.no_rows"},
        r"it returned None; .* with the keys picker_01, picker_02 \(.*test_seams.py, line \d+",
    ),
    ({"rows_to_pickers": "test_seams.odd_and_even"}, "must be neighbours"),
    ({"rows_to_pickers": "test_seams.upwards"}, "in their order from north to south"),
    (
        {"rows_to_pickers": "test_seams.from_the_north"},
        "starts at the end 'west' or 'east', and not picker_02 at 'north'",
    ),
    ({"rows_to_pickers": "test_seams.one_row_each"}, "each row of 1 to 4 must go to one picker"),
    ({"rows_to_pickers": "test_seams.between_rows"}, r"the row 1\.4; rows are whole numbers"),
    ({"rows_to_pickers": "test_seams.rows_as_texts"}, "the row '1'; rows are whole numbers"),
    ({"rows_to_pickers": "test_seams.nothing"}, "no attribute 'nothing'"),
    ({"order_in_row": "test_seams.nothing", "metres_per_bin": 10.0}, "no attribute 'nothing'"),
    (
        {"order_in_row": "test_seams.from_the_middle", "metres_per_bin": 6.0},
        (
            r"order_in_row.*it returned -25.5 for 6 m of x = -35.5 to -15.5; must be -35.5 or"
            r" -21.5.*\(.*test_seams.py, line \d+"
        ),
    ),
]


@pytest.mark.parametrize(("named", "why"), UNUSABLE)
def test_what_cannot_be_used_is_named_before_the_run(named, why):
    with pytest.raises(ScenarioError, match=why):
        check_plugins(lay_out(scenario(**named)))


@pytest.mark.parametrize(
    "name", ["picker_x", "traffic", "traffic_2", "dispatch", "physics", "Weather", "a b"]
)
def test_a_further_agent_needs_a_name_of_its_own(name):
    with pytest.raises(ScenarioError, match=name):
        check({"agents_without_body": {name: "a.B"}})
