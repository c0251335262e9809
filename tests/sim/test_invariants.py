"""The invariants: each one that a test breaks is named.

An invariant holds at every tick of a run, such as that what is picked is in bins or delivered. A
violation is a line that says which one is broken, and where. A run from any tick on, with stops in
it, breaks none. World arrays have a row for each body, in the order of `world.index`.
"""

from typing import Any

import numpy as np
import pytest
from command_line import PATH, python
from drawn_scenarios import SCENARIOS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stage import empty_orchard

from orchard.contract.events import Event
from orchard.contract.messages import pack, unpack
from orchard.field.kinds import KINDS
from orchard.field.layout import lay_out
from orchard.field.scenario import People, Scenario
from orchard.local import Local
from orchard.sim.invariants import Invariants
from orchard.sim.physics import step
from orchard.sim.snapshot import Snapshot
from orchard.sim.state_times import StateTimes
from orchard.sim.world import NONE, World


@pytest.fixture
def world() -> World:
    return World(lay_out(empty_orchard(people=People(workers=1, visitors=0))))


@pytest.fixture
def checker(world) -> Invariants:
    return Invariants(world)


def after(checker: Invariants, world: World, *events: Event) -> list[str]:
    """Let a checker see a step with these events. Return all violations."""
    checker.update(world, step(world, np.zeros_like(world.twist), []) + list(events))
    return checker.violations


def happens(what: str, who: str, whom: str = "", detail: str = "") -> Event:
    return Event(0, what, who, whom, detail)


def couple(world: World, robot: str, bin_: str) -> None:
    """Couple a bin to a robot."""
    world.coupled[world.index[robot]] = world.index[bin_]
    world.coupled[world.index[bin_]] = world.index[robot]


def test_an_orchard_in_order_violates_nothing(checker, world):
    assert after(checker, world) == []
    assert checker.end(world, finished=True) == []


# What is set in a new world, as array -> {place: value}, and the violation. A place or value may be
# the name of a body; "nobody" is NONE. `row_ends` has a row for each row of the orchard: the m that
# are picked from its west end and from its east end.
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "a bin that its robot does not have": (
        {"coupled": {"picker_01": "nobody"}},
        "bin_01 is not at one place: it is on picker_01, and coupled to no robot",
    ),
    "a robot on the bar of a robot": (
        {"coupled": {"bin_01": "nobody", "picker_01": "picker_02"}},
        "picker_01 is coupled to picker_02; a coupling needs a picker or carrier and a bin",
    ),
    "a person at a bin": (
        {"coupled": {"worker_01": "bin_01"}},
        "worker_01 is coupled to bin_01; a coupling needs a picker or carrier and a bin",
    ),
    "a metre that is picked into no bin": (
        {"row_ends": {(1, 0): 1.0}},
        "1.000 m are picked, but 0.000 m are in bins or delivered",
    ),
    "a row that is longer than a row": (
        {"row_ends": {(0, 0): 71.0}, "fill": {"bin_01": 70.0, "bin_02": 1.0}},
        "row 1 was picked for 0 m, and now for 71 m; this may only grow, to 70 m",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_named(checker, world, what):
    changes, words = WRONG[what]
    index = dict(world.index) | {"nobody": NONE}
    for array, values in changes.items():
        for at, value in values.items():
            getattr(world, array)[index.get(at, at)] = index.get(value, value)
    assert after(checker, world) == [f"tick 1: {words}"]


def test_a_delivery_that_no_carrier_made_is_named(checker, world):
    world.delivered += 1
    assert "tick 1: 1 bins count as delivered, but 0 were unloaded" in after(checker, world)


def test_a_bin_on_two_robots_is_named(checker, world):
    world.coupled[world.index["carrier_01"]] = world.index["bin_01"]
    violations = after(checker, world)
    assert (
        "tick 1: bin_01 is not at one place: it is on picker_01, and coupled to carrier_01 and"
        " picker_01" in violations
    )
    assert (
        "tick 1: bin_03 is not at one place: it is on carrier_01, and coupled to no robot"
        in violations
    )


def test_a_bin_that_is_unloaded_without_a_carrier_is_named(checker, world):
    world.bay_ticks[world.index["bin_01"]] = 7
    assert checker.end(world, finished=False) == [
        "tick 0: bin_01 is being unloaded, but is on no carrier"
    ]


@pytest.mark.parametrize("metres", [-0.5, 70.5])
def test_a_bin_that_holds_what_no_bin_can_is_named(checker, world, metres):
    world.fill[world.index["bin_01"]] = metres
    violations = after(checker, world)
    assert f"tick 1: bin_01 holds {metres:g} m; a bin holds 0 to 70 m" in violations
    assert f"tick 1: 0.000 m are picked, but {metres:.3f} m are in bins or delivered" in violations


def test_a_row_that_grows_back_is_named(checker, world):
    world.row_ends[1, 0] = world.fill[world.index["bin_01"]] = 1.0
    assert after(checker, world) == []
    world.row_ends[1, 0] = world.fill[world.index["bin_01"]] = 0.5
    assert after(checker, world) == [
        "tick 2: row 2 was picked for 1 m, and now for 0.5 m; this may only grow, to 70 m"
    ]


def test_a_row_that_is_picked_twice_is_named(checker, world):
    after(checker, world, happens("row picked", "picker_01", "bin_01", "row 1"))
    assert after(checker, world, happens("row picked", "picker_02", "bin_02", "row 1")) == [
        "tick 2: row 1 was picked a second time, by picker_02"
    ]


FULL = happens("bin full", "bin_01", "picker_01")
TAKEN = happens("coupled", "carrier_01", "bin_01")


# Events of a bin that calls: it is full, a carrier takes it, and another one again; it is unloaded
# on a carrier that did not take it.
TWICE = [
    FULL,
    TAKEN,
    happens("uncoupled", "carrier_01", "bin_01"),
    happens("coupled", "carrier_02", "bin_01"),
]
ELSEWHERE = [FULL, TAKEN, happens("unloaded", "bin_01", "carrier_02")]


EXCHANGES = [
    (TWICE, "bin_01 was taken twice for one call: by carrier_01, and then by carrier_02"),
    (ELSEWHERE, "bin_01 was unloaded on carrier_02, but carrier_01 had taken it"),
    ([FULL, TAKEN, FULL], "bin_01 is full again, but was not unloaded since it was last full"),
]


@pytest.mark.parametrize(("events", "words"), EXCHANGES, ids=["twice", "elsewhere", "full again"])
def test_a_call_that_does_not_end_in_one_exchange_is_named(checker, world, events, words):
    violations = after(checker, world, *events)
    assert f"tick 1: {words}" in violations
    # The world has counted no delivery, so an unloading is a second violation.
    assert len(violations) == (2 if events is ELSEWHERE else 1)


def test_a_call_that_is_open_when_the_harvest_is_over_is_named(checker, world):
    after(checker, world, FULL, happens("coupled", "picker_01", "bin_03"))
    assert checker.end(world, finished=False) == []
    assert checker.end(world, finished=True) == [
        "tick 1: the harvest is over, but bin_01's call did not end in an exchange"
    ]


def test_a_picker_that_got_no_empty_bin_is_named(checker, world):
    after(checker, world, FULL, TAKEN)
    world.delivered = 1
    after(checker, world, happens("unloaded", "bin_01", "carrier_01"))
    assert (
        "the harvest is over, but picker_01 got no empty bin for bin_01"
        in checker.end(world, finished=True)[-1]
    )


@pytest.mark.parametrize("other", ["picker_02", "worker_01", "bin_03"])
def test_a_body_in_another_is_named(checker, world, other):
    x, y, _ = world.pose[world.index[other]]
    world.pose[world.index["carrier_02"]] = x + 0.5, y, 0.3
    violations = checker.end(world, finished=False)
    assert any(
        "overlaps" in violation and "carrier_02" in violation and other in violation
        for violation in violations
    ), violations


def test_a_robot_in_a_tree_is_named(checker, world):
    """The first four walls are the fences; then come trunks and posts. A wall begins with x, y."""
    x, y = world.layout.walls[4, :2]
    world.pose[world.index["picker_01"], :2] = x, y
    assert (
        f"tick 0: picker_01 overlaps a fence, trunk or post, at ({x:.2f}, {y:.2f})"
        in checker.end(world, finished=False)
    )


def test_bodies_are_looked_at_once_a_second(checker, world):
    """Whether bodies overlap is looked at every ten ticks."""
    world.pose[world.index["carrier_02"], :2] = world.pose[world.index["picker_01"], :2]
    are_violated = [bool(after(checker, world)) for _ in range(10)]
    assert are_violated == [False] * 9 + [True]


def test_what_stays_wrong_is_told_once(checker, world):
    world.row_ends[1, 0] = 1.0
    assert len([after(checker, world) for _ in range(30)][-1]) == 1


def test_a_stopped_robot_that_moves_is_named(checker, world):
    i = world.index["picker_01"]
    world.stopped[i] = True
    world.twist[i, 0] = 0.5
    checker.update(world, [])
    assert "tick 0: picker_01 moves, but is stopped" in checker.violations
    assert (
        "tick 0: picker_01 is stopped, but bin_01, which is coupled to it, is not"
        in checker.violations
    )


def test_states_that_do_not_add_up_to_the_run_are_named(world):
    states = StateTimes(world)
    for _ in range(5):
        after(Invariants(world), world)
        states.update(world, {})
    assert states.faults(world) == []
    world.tick += 1
    assert "tick 6: picker_01's states add up to 5 ticks, the run to 6" in states.faults(world)


def test_states_go_on_from_data(world):
    """The counts of a second tick are left out, and go on from those of the first."""
    states = StateTimes(world)
    after(Invariants(world), world)
    states.update(world, {})
    after(Invariants(world), world)
    resumed = StateTimes(world, unpack(pack(states.counts), dict))
    assert resumed.faults(world) != [], "a tick was left out"
    resumed.update(world, {})
    assert resumed.faults(world) == []


WORDS = st.lists(
    st.sampled_from(["picker_01", "bin_01", "bin_03", "carrier", "carrier_01", "tractor"]),
    max_size=2,
)
RUN_TICKS = 1500
# Up to 100 ticks before the end, so that what is done shows.
ANY_TICK = st.integers(0, RUN_TICKS - 100)
SWITCHES = st.lists(st.tuples(ANY_TICK, st.booleans(), WORDS), max_size=8)


@settings(max_examples=8, suppress_health_check=[HealthCheck.too_slow])
@given(SCENARIOS, SWITCHES, ANY_TICK)
def test_no_run_violates_anything_whichever_robot_is_stopped(scenario, switches, begins):
    """`switches`: the tick, whether robots are stopped (True) or reset, and words for the robots.

    `begins`: the tick at which the run is resumed, and a second checker begins.
    """
    local = Local(scenario)
    for tick in range(RUN_TICKS):
        for due, is_stop, words in switches:
            if due == tick and is_stop:
                local.engine.stop(words)
            elif due == tick:
                local.engine.reset(words)
        if tick == begins:
            local = Local.resume(unpack(pack(local.snapshot()), Snapshot))
            late = Invariants(local.engine.world)
            states = StateTimes(local.engine.world)
        events = local.tick()
        if tick >= begins:
            late.update(local.engine.world, events)
            states.update(local.engine.world, local.actions)
    world = local.engine.world
    assert late.end(world, finished=False) == []
    assert local.engine.invariants.end(world, finished=False) == []
    assert states.faults(world) == []


def test_a_call_of_before_a_snapshot_is_known_after_it():
    local = Local(Scenario(rows=3))
    while not local.engine.invariants.known.calls:
        local.tick()
    resumed = Local.resume(local.snapshot())
    assert resumed.engine.invariants.known == local.engine.invariants.known
    assert resumed.engine.invariants.known.calls


# A program whose physics adds a centimetre to what is picked of a row, at each step.
SABOTAGE = """
import sys
import orchard.sim.engine, orchard.sim.physics
def step(world, twists, deeds):
    events = orchard.sim.physics.step(world, twists, deeds)
    world.row_ends[2, 0] += 0.01
    return events
orchard.sim.engine.step_world = step
"""


def test_a_violation_is_exit_code_1_and_in_the_summary(tmp_path):
    program = f"{SABOTAGE}from orchard.__main__ import main; main()"
    local = ("--mode", "local", "--rows", 3, "--duration", 2, "--record", "none")
    done = python(
        "-c", program, *local, "--summary", "summary.json", code=1, cwd=tmp_path, PYTHONPATH=PATH
    )
    assert "violated: tick 1: " in done.stderr
    assert "m are picked, but" in (tmp_path / "summary.json").read_text()


def test_a_violation_in_physics_is_exit_code_1(tmp_path):
    """Physics runs alone, for 2 s: all bodies are left without an agent."""
    kinds = [*KINDS, "traffic", "dispatch"]
    nobody_drives = [word for kind in kinds for word in ("--absent", kind)]
    program = "from orchard.processes.physics import main; sys.exit(main(sys.argv[1:]))"
    words = ("--duration", 2, *nobody_drives)
    done = python("-c", SABOTAGE + program, *words, code=1, cwd=tmp_path, PYTHONPATH=PATH)
    assert "violated: tick 1: " in done.stdout
