"""The built-in dispatch policies: what they decide, whole harvests with them, early carriers, and
policies that make mistakes.
"""

import re
from functools import cache

import numpy as np
import pytest
from command_line import orchard, scenario_file
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import local_hash, start_afresh
from msgspec.structs import replace
from patience import PATIENCE
from stage import Stage, Standing, empty_orchard

from orchard import (
    Assignment,
    BinReport,
    CarrierReport,
    Local,
    Scenario,
    ScenarioError,
    draw,
    lay_out,
)
from orchard.behaviour.catalogue import check_plugins
from orchard.behaviour.dispatcher import Dispatcher, checked
from orchard.contract.agent import Heard, Mail, Reply, without_body
from orchard.contract.messages import CarrierQuery, CarrierStatus, Fetch
from orchard.dispatch.policies import LEAVING, dispatch_of
from orchard.dispatch.policy import Dispatch
from orchard.field.scenario import DISPATCH_POLICIES
from orchard.plans import route
from orchard.plans.forecast import Forecast
from orchard.sim.lookahead import CheckedHolds, IgnoredHolds


def policy(name: str) -> Dispatch:
    return dispatch_of(lay_out(empty_orchard(dispatch=name)))


def decide(
    name: str, bins: list[BinReport], carriers: list[CarrierReport]
) -> list[tuple[str, str]]:
    made = policy(name)
    return [tuple(one) for one in made.assign(1000, bins, carriers, made.Memory())]


NEAR = BinReport(
    "bin_01",
    1,
    "east",
    "picker_01",
    since=900,
    metres=30.0,
    seconds_to_full=0.0,
    seconds_to_reach=34.0,
)
FAR = BinReport(
    "bin_02",
    9,
    "east",
    "picker_02",
    since=950,
    metres=75.0,
    seconds_to_full=0.0,
    seconds_to_reach=79.0,
)
FILLING = BinReport(
    "bin_03",
    12,
    "east",
    "picker_03",
    since=960,
    metres=90.0,
    seconds_to_full=60.0,
    seconds_to_reach=94.0,
)
UNRIPE = BinReport(
    "bin_04",
    3,
    "east",
    "picker_04",
    since=960,
    metres=40.0,
    seconds_to_full=300.0,
    seconds_to_reach=44.0,
)
HEAD = CarrierReport("carrier_02", "", True, 0.0)
BUSY = CarrierReport("carrier_03", "bin_09", False, 0.0)
DECISIONS = {
    "nearest": ["bin_01", "bin_02"],
    "longest-waiting": ["bin_01", "bin_02"],
    "farthest-first": ["bin_02", "bin_01"],
    "assignment": ["bin_01"],
    "predictive": ["bin_02", "bin_01"],
    "predictive-farthest": ["bin_02", "bin_01"],
    "rolling": ["bin_02", "bin_01"],
}


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_the_preferred_bin_gets_the_only_free_carrier(name):
    assert decide(name, [NEAR, FAR], [HEAD, BUSY]) == [(DECISIONS[name][0], "carrier_02")]


EXAMPLES = {
    "farthest-first": "FarthestFirst",
    "longest-waiting": "LongestWaiting",
    "assignment": "NearestBins",
}


def test_each_policy_that_leaves_has_an_example():
    assert sorted(EXAMPLES) == sorted(LEAVING)


REPORTS = st.lists(
    st.builds(
        BinReport,
        name=st.sampled_from(["bin_01", "bin_02", "bin_03", "bin_04", "bin_05"]),
        lane=st.just(1),
        side=st.just("east"),
        picker=st.just("picker_01"),
        since=st.integers(0, 3),
        metres=st.sampled_from([30.0, 45.0, 75.0]),
        seconds_to_full=st.just(0.0),
        seconds_to_reach=st.just(34.0),
    ),
    unique_by=lambda report: report.name,
)


@pytest.mark.parametrize("name", EXAMPLES)
@given(bins=REPORTS, ways=st.lists(st.sampled_from([0.0, 2e-15, 0.5]), max_size=4))
def test_an_example_decides_as_the_policy_that_leaves(name, bins, ways):
    carriers = [CarrierReport(f"carrier_{k:02d}", "", True, way) for k, way in enumerate(ways)]
    example = f"examples.policies.{EXAMPLES[name]}"
    assert decide(example, bins, carriers) == decide(name, bins, carriers)


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_a_run_says_if_its_policy_leaves(name, tmp_path):
    """A policy that leaves warns, and works: the run ends well."""
    path = scenario_file(tmp_path, empty_orchard(dispatch=name))
    done = orchard(path, "--mode", "local", "--record", "none", "--duration", "1")
    words = f"dispatch = {name}: this policy will not be in version 2.0"
    assert (words in done.stderr) == (name in LEAVING)
    assert "hash" in done.stdout


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_each_bin_gets_a_carrier_and_busy_ones_none(name):
    orders = decide(name, [NEAR, FAR], [BUSY, CarrierReport("carrier_01", "", True, 0.5), HEAD])
    assert {bin_name for bin_name, _ in orders} == {"bin_01", "bin_02"}
    assert {carrier for _, carrier in orders} == {"carrier_01", "carrier_02"}


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_heads_of_two_lines_go_by_name_despite_rounding(name):
    """One of the carriers stands 2e-15 m behind the head of its line."""
    assert decide(name, [NEAR], [HEAD, CarrierReport("carrier_01", "", True, 2e-15)]) == [
        ("bin_01", "carrier_01")
    ]


@pytest.mark.parametrize(
    ("name", "first"), [("predictive", "bin_02"), ("predictive-farthest", "bin_03")]
)
def test_an_early_policy_sends_only_for_what_is_due(name, first):
    assert decide(name, [UNRIPE], [HEAD]) == []
    assert decide(name, [NEAR, FAR, FILLING, UNRIPE], [HEAD]) == [(first, "carrier_02")]


def test_predictive_serves_a_near_bin_beside_a_busy_far_one():
    """If the farthest full bin always came first, the near one would be left out for ever."""
    made = policy("predictive")
    memory = made.Memory()
    now = 1000
    waits = replace(NEAR, since=1000)
    served = ""
    while served != NEAR.name:
        assert now < 2000, "the near bin is left out"
        [(served, _)] = made.assign(now, [waits, replace(FAR, since=now)], [HEAD], memory)
        now += 200  # the far bin is fetched, and its picker fills the next one


def test_predictive_knows_since_when_a_bin_is_full():
    made = policy("predictive")
    memory = made.Memory()
    soon = replace(FILLING, seconds_to_full=20.0)
    later = replace(FILLING, name="bin_05", seconds_to_full=40.0)
    assert made.assign(1000, [soon, later], [], memory) == []
    full = [replace(later, seconds_to_full=0.0), replace(soon, seconds_to_full=0.0)]
    assert [order.bin for order in made.assign(1500, full, [HEAD], memory)] == [soon.name]
    again = replace(soon, since=1600, seconds_to_full=0.0)  # a later call of the same bin
    assert [order.bin for order in made.assign(1700, [again, full[0]], [HEAD], memory)] == [
        later.name
    ]


BINS = st.lists(
    st.builds(
        BinReport,
        st.integers(1, 30).map("bin_{:02d}".format),
        st.integers(1, 20),
        st.sampled_from(["east", "west"]),
        st.just("picker_01"),
        st.integers(0, 10**6),
        st.floats(0.0, 500.0),
        st.floats(0.0, 1e6),
        st.floats(0.0, 500.0),
    ),
    unique_by=lambda report: report.name,
    max_size=20,
)
CARRIERS = st.lists(
    st.builds(
        CarrierReport,
        st.integers(1, 40).map("carrier_{:02d}".format),
        st.just(""),
        st.booleans(),
        st.floats(0.0, 60.0),
    ),
    unique_by=lambda report: report.name,
    max_size=20,
)


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
@settings(max_examples=40)
@given(BINS, CARRIERS, st.randoms(use_true_random=False))
def test_a_policy_assigns_only_what_is_there_and_never_twice(name, bins, carriers, random):
    orders = decide(name, bins, carriers)
    assert {bin_name for bin_name, _ in orders} <= {report.name for report in bins}
    assert {carrier for _, carrier in orders} <= {
        carrier.name for carrier in carriers if carrier.is_next
    }
    assert all(len(set(names)) == len(orders) for names in zip(*orders, strict=True))
    random.shuffle(bins), random.shuffle(carriers)
    assert decide(name, bins, carriers) == orders


def test_a_policy_whose_package_is_missing_names_the_package():
    with pytest.raises(
        ScenarioError,
        match=(
            r"dispatch = own_policies.Lacking: cannot be used: .*No module named 'no_such_package'"
        ),
    ):
        check_plugins(lay_out(empty_orchard(dispatch="own_policies.Lacking")))


NO_SOURCE = "\0"  # Python does not say in which file it has found this
UNREADABLE = {
    "with_null.Mine": ({"with_null.py": NO_SOURCE}, r"with_null\.py"),
    "null_folder.mine.Mine": (
        {"null_folder/__init__.py": NO_SOURCE, "null_folder/mine.py": "class Mine: pass"},
        r"null_folder/__init__\.py",
    ),
    "null_module.mine.Mine": (
        {"null_module/__init__.py": "", "null_module/mine.py": NO_SOURCE},
        r"null_module/mine\.py",
    ),
    "imports_null.Mine": (
        {"imported_null.py": NO_SOURCE, "imports_null.py": "import imported_null"},
        r"imports_null\.py, line 1",
    ),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_a_policy_in_a_file_with_a_null_byte_is_told_with_it(name, tmp_path, monkeypatch):
    files, told = UNREADABLE[name]
    for file, text in files.items():
        path = tmp_path / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ScenarioError, match=rf"cannot be used: .*null bytes \({tmp_path}/{told}\)"):
        check_plugins(lay_out(empty_orchard(dispatch=name)))


def small(name: str, **changes) -> Scenario:
    return empty_orchard(**{"rows": 4, "pickers": 2, "carriers": 2, "dispatch": name, **changes})


@cache
def harvested(name: str) -> Stage:
    stage = Stage(small(name, row_length=20.0), is_hashed=True)
    stage.run_to_the_end()
    return stage


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_a_harvest_with_each_policy_is_complete(name):
    stage = harvested(name)
    assert (stage.world.delivered, stage.account.figures()["broken_agents"]) == (4, [])
    stage.assert_no_collisions()


def test_early_carriers_make_the_harvest_shorter():
    assert (
        harvested("predictive").seconds
        < harvested("farthest-first").seconds
        < harvested("nearest").seconds
    )


@pytest.mark.parametrize("name", ["farthest-first", "predictive", "rolling"])
def test_agents_started_afresh_at_every_tick_harvest_alike(name):
    whole = harvested(name)
    local = Local(small(name, row_length=20.0), holds=IgnoredHolds)
    while not local.engine.over:
        if local.engine.tick % 25 == 1:
            start_afresh(local)
        local.tick()
    assert local.engine.hash == whole.local.engine.hash


def test_no_agent_of_an_early_harvest_holds_too_long(caplog):
    local_hash(small("predictive", rows=3, picking_speed=0.7), 2500, holds=CheckedHolds)
    assert "holds wrongly" not in caplog.text


def too_early() -> Stage:
    return Stage(small("own_policies.AtOnce", rows=3, pickers=2, carriers=2, picking_speed=0.5))


def test_an_early_carrier_holds_until_the_bin_is_left():
    stage = too_early()
    hold = stage.world.layout.lane(1).y + route.OneWay.HOLD
    stage.run_until(lambda: stage.pose("carrier_01")[1] < hold + 1e-6, 100)
    stage.run(20)
    stage.assert_at("carrier_01", y=hold, heading="SOUTH")
    assert stage.local.actions["carrier_01"].waits_for == stage.bin_of("picker_01"), (
        "it says for which bin it waits"
    )
    stage.run_until(lambda: not stage.bin_of("picker_01"), 120)
    stage.assert_at("carrier_01", y=hold)
    stage.run_to_the_end()
    assert stage.world.delivered == 3


def test_without_that_hold_the_early_carrier_shuts_the_picker_in(monkeypatch):
    monkeypatch.setattr(route, "_once_left", lambda approach, full_bin, place: approach)
    stage = too_early()
    stage.run(400)
    assert stage.world.delivered == 0
    assert stage.local.actions["picker_01"].waits_for == "carrier_01"
    assert stage.local.actions["carrier_01"].waits_for == "picker_01"


def test_a_picker_that_stays_in_its_row_jams_with_its_bin_named(soon_jammed):
    """A carrier has left for the bin, and waits for a picker that never comes."""
    stage = Stage(small("predictive", rows=3))
    stage.run_until(
        lambda: any(getattr(memory, "job", None) for memory in stage.local.memories.values()), 100
    )
    waited_for = next(
        memory.job for memory in stage.local.memories.values() if getattr(memory, "job", None)
    )
    stage.local.agents[waited_for.picker] = Standing()
    stage.local.engine.wake([waited_for.picker])
    stage.run_until(lambda: bool(stage.account.jam), 3000)
    assert any(f"waits for {waited_for.bin}" in line for line in stage.account.jam), (
        stage.account.jam
    )
    assert stage.local.engine.violations() == []


def test_a_forecast_comes_true():
    """From the time at which the picker faces its row, also while it still drives up to it; in the
    first row and in the next one.
    """
    stage = Stage(small("predictive", picking_speed=0.5))
    forecast = Forecast(stage.world.layout)
    rows = []
    while len(rows) < 2:
        foretold = []
        fruit = ""
        while not (fruit and stage.is_full(fruit)):
            stage.tick()
            fruit = stage.bin_of("picker_01")
            seen = stage.local.engine.observe()[fruit] if fruit else None
            if seen is not None and (ripening := forecast.of(seen, seen.hitch, 0.5)):
                foretold.append((ripening.lane, ripening.side, stage.seconds + ripening.seconds))
        rows.append({where[:2] for where in foretold})
        assert len(foretold) > 1300
        assert all(abs(when - stage.seconds) < 0.25 for _, _, when in foretold)
        stage.run_until(lambda: not stage.bin_of("picker_01"))
    assert rows == [{(1, "east")}, {(2, "west")}]


MISTAKES = {
    "Raising": r"LookupError: no such bin here \(.*own_policies.py, line \d+\)",
    "Inventing": r"assigns bin bin_77, which is not available; .* \(.*own_policies.py, line \d+\)",
    "Overworking": r"assigns bin bin_0\d twice \(.*own_policies.py, line \d+\)",
    "Hoarding": r"the policy's memory takes 20009 bytes; at most 16384 \(.*own_policies.py",
    "Silent": (
        r"assign returned None; it must return a list of Assignment\(bin, carrier\)"
        r" \(.*own_policies.py"
    ),
}


def test_a_carrier_with_two_answers_at_once_is_sent_to_one_bin():
    """A carrier whose answers to two questions come together is sent to one bin.

    As in realtime, where an answer may be late.
    """
    dispatcher = Dispatcher(lay_out(Scenario(dispatch="nearest")), "dispatch")
    fetches = [
        Heard(name, 0, 0, Fetch(lane, "east", "picker_01", 0, 0.0))
        for lane, name in enumerate(("bin_01", "bin_02"), 1)
    ]
    memory = dispatcher.tick(without_body("dispatch", 1), Mail(fetches), None).memory
    free = CarrierStatus("", True, 5.0)
    answers = [Reply("carrier_01", 0, CarrierQuery(), free) for _ in range(2)]
    memory = dispatcher.tick(without_body("dispatch", 2), Mail([], answers), memory).memory
    assert {name: booking.carrier for name, booking in memory.bookings.items()} == {
        "bin_01": "carrier_01"
    }
    assert memory.refused == 0


def test_names_in_a_decision_may_be_of_a_text_type_of_a_library():
    (order,) = checked([Assignment(np.str_("bin_01"), np.str_("carrier_02"))], [NEAR], [HEAD])
    assert [type(name) for name in order] == [
        str,
        str,
    ], "the dispatcher keeps them in its memory, which takes plain text only"


@pytest.mark.parametrize("name", MISTAKES)
def test_the_mistake_of_a_policy_is_named_once_and_counted(name, caplog):
    stage = Stage(small(f"own_policies.{name}", rows=3, carriers=3))
    stage.run_until(lambda: stage.world.delivered == 1, 500)
    faults = [
        record.getMessage() for record in caplog.records if "dispatch policy" in record.getMessage()
    ]
    assert len(faults) == 1, "once in the log"
    assert re.search(MISTAKES[name], faults[0]), faults[0]
    figures = stage.account.figures()
    assert figures["orders_refused"] >= 1
    assert [line.split(",")[0] for line in figures["broken_agents"]] == ["dispatch"], (
        "so the exit code is 1"
    )
    assert stage.account.fault == ""


def test_a_mistake_may_end_the_harvest_in_lockstep_at_its_tick(fleet):
    """A mistake ends the harvest if the scenario says so in lockstep at the same tick."""
    scenario = small("own_policies.Raising", rows=3, dispatch_errors="end")
    stage = Stage(scenario, is_hashed=True)
    stage.run_until(lambda: stage.account.fault == "refused", 200)
    assert stage.account.figures()["orders_refused"] == 1
    fleet.physics(scenario)
    fleet.share(1)
    code, out, _ = fleet.world.end(PATIENCE)
    assert code == 1
    assert re.search(
        rf"refused: tick {stage.world.tick}, .* hash {stage.local.engine.hash}", out
    ), out


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(40))
def test_soak_carriers_that_leave_too_early_never_lock(seed):
    """In random orchards some robots are stopped for a while; those that wait then go on."""

    def some(name: str, low: int, high: int) -> int:
        return low + int(draw(seed, f"early carriers, {name}", 0)[0] * (high + 1 - low))

    rows = some("rows", 3, 12)
    scenario = Scenario(
        rows=rows,
        pickers=some("pickers", 2, rows),
        carriers=some("carriers", 1, 20),
        picking_speed=some("speed", 3, 10) / 10,
        row_width=float(some("width", 5, 9)),
        seed=seed,
        dispatch=["own_policies.AtOnce", "predictive", "predictive-farthest"][some("policy", 0, 2)],
    )
    stage = Stage(scenario)
    for number in range(6):
        stage.run(some(f"go {number}", 10, 60))
        stage.local.engine.stop([f"picker_{some(f'picker {number}', 1, scenario.pickers):02d}"])
        stage.run(some(f"stand {number}", 5, 60))
        stage.local.engine.reset()
    stage.run_until(lambda: stage.local.engine.over or bool(stage.account.jam), 20_000)
    assert stage.account.jam == []
    assert stage.local.engine.violations() == []
    assert stage.world.delivered == rows
