"""The dispatch policies: what they decide, whole harvests with them, and carriers sent early."""

import re
from functools import cache

import numpy as np
import pytest
from command_line import orchard, scenario_file
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import start_afresh
from msgspec.structs import replace
from patience import PATIENCE
from stage import Stage, empty_orchard, small_orchard

from orchard import (
    Assignment,
    BinReport,
    CarrierReport,
    Local,
    Scenario,
    ScenarioError,
    lay_out,
)
from orchard.behaviour.catalogue import check_plugins
from orchard.behaviour.dispatcher import Dispatcher, checked
from orchard.contract.agent import Heard, Mail, Reply, without_body
from orchard.contract.messages import CarrierQuery, CarrierStatus, Fetch
from orchard.dispatch.policies import LEAVING, dispatch_of
from orchard.dispatch.policy import Dispatch
from orchard.field.scenario import DISPATCH_POLICIES
from orchard.sim.lookahead import IgnoredHolds


def policy(name: str) -> Dispatch:
    """Return the policy of this name, for a small orchard."""
    return dispatch_of(lay_out(empty_orchard(dispatch=name)))


def decide(
    name: str, bins: list[BinReport], carriers: list[CarrierReport]
) -> list[tuple[str, str]]:
    """Return what a policy without a memory decides at tick 1000: (bin, carrier) of each order."""
    dispatch = policy(name)
    return [tuple(order) for order in dispatch.assign(1000, bins, carriers, dispatch.Memory())]


# Reports of bins, as policies get them. `since`: the tick at which the bin began to report.
# `metres`: from the queue. `seconds_to_reach`: that a carrier needs until it is there.
#
# A full bin near the queue, and one far from it.
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
# A bin that will be full before a carrier is there, and one that will not.
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
# A carrier at the head of its line, and one at work.
HEAD = CarrierReport("carrier_02", job="", is_next=True, metres=0.0)
BUSY = CarrierReport("carrier_03", job="bin_09", is_next=False, metres=0.0)
# Of NEAR and FAR, the bins that each policy serves, first the one that it prefers.
DECISIONS = {
    "nearest": ["bin_01", "bin_02"],
    "longest-waiting": ["bin_01", "bin_02"],
    "farthest-first": ["bin_02", "bin_01"],
    # It decides for all carriers together. With one, the nearest bin gets it.
    "assignment": ["bin_01"],
    "predictive": ["bin_02", "bin_01"],
    "predictive-farthest": ["bin_02", "bin_01"],
    "rolling": ["bin_02", "bin_01"],
}


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_the_preferred_bin_gets_the_only_free_carrier(name):
    assert decide(name, [NEAR, FAR], [HEAD, BUSY]) == [(DECISIONS[name][0], "carrier_02")]


# The policies that leave in version 2.0, and the class of examples/policies.py for each.
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
@given(bins=REPORTS, metres=st.lists(st.sampled_from([0.0, 2e-15, 0.5]), max_size=4))
def test_an_example_decides_as_the_policy_that_leaves(name, bins, metres):
    """`metres`: how far each carrier stands behind the head of its line."""
    carriers = [
        CarrierReport(f"carrier_{number:02d}", "", True, behind)
        for number, behind in enumerate(metres)
    ]
    example = f"examples.policies.{EXAMPLES[name]}"
    assert decide(example, bins, carriers) == decide(name, bins, carriers)


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_a_run_says_if_its_policy_leaves(name, tmp_path):
    """A policy that leaves warns, and works: the run ends well."""
    path = scenario_file(tmp_path, empty_orchard(dispatch=name))
    done = orchard(path, "--mode", "local", "--record", "none", "--duration", "1")
    words = f"dispatch = {name}: this policy will not be in version 2.0"
    assert (words in done.stderr) == (name in LEAVING)
    assert "hash" in done.stdout, "the run ends well"


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
    predictive = policy("predictive")
    memory = predictive.Memory()
    now = 1000
    near = replace(NEAR, since=1000)
    served = ""
    while served != NEAR.name:
        assert now < 2000, "the near bin is left out"
        far = replace(FAR, since=now)
        [(served, _)] = predictive.assign(now, [near, far], [HEAD], memory)
        # In 20 s the far bin is fetched, and its picker fills the next one.
        now += 200


def test_predictive_knows_since_when_a_bin_is_full():
    """The bin that was full first is served first, and a new call of a bin counts from its time.

    The policy remembers when bins will be full that it hears of. At tick 1,500 both are full.
    """
    predictive = policy("predictive")
    memory = predictive.Memory()

    def served(tick: int, bins: list[BinReport], carriers: list[CarrierReport]) -> list[str]:
        return [order.bin for order in predictive.assign(tick, bins, carriers, memory)]

    soon = replace(FILLING, seconds_to_full=20.0)
    later = replace(FILLING, name="bin_05", seconds_to_full=40.0)
    assert served(1000, [soon, later], []) == []

    full_soon = replace(soon, seconds_to_full=0.0)
    full_later = replace(later, seconds_to_full=0.0)
    assert served(1500, [full_later, full_soon], [HEAD]) == [soon.name]

    called_again = replace(full_soon, since=1600)
    assert served(1700, [called_again, full_later], [HEAD]) == [later.name]


BINS = st.lists(
    st.builds(
        BinReport,
        name=st.integers(1, 30).map("bin_{:02d}".format),
        lane=st.integers(1, 20),
        side=st.sampled_from(["east", "west"]),
        picker=st.just("picker_01"),
        since=st.integers(0, 10**6),
        metres=st.floats(0.0, 500.0),
        seconds_to_full=st.floats(0.0, 1e6),
        seconds_to_reach=st.floats(0.0, 500.0),
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
    served_bins = [bin_name for bin_name, _ in orders]
    sent_carriers = [carrier for _, carrier in orders]
    assert set(served_bins) <= {report.name for report in bins}
    assert set(sent_carriers) <= {carrier.name for carrier in carriers if carrier.is_next}
    assert len(set(served_bins)) == len(orders)
    assert len(set(sent_carriers)) == len(orders)

    # The order of the reports decides nothing.
    random.shuffle(bins)
    random.shuffle(carriers)
    assert decide(name, bins, carriers) == orders


def test_a_policy_whose_package_is_missing_names_the_package():
    error = r"dispatch = own_policies.Lacking: cannot be used: .*No module named 'no_such_package'"
    with pytest.raises(ScenarioError, match=error):
        check_plugins(lay_out(empty_orchard(dispatch="own_policies.Lacking")))


# A faulty policy of tests/support/own_policies.py, and what is said of it before a run.
UNUSABLE = {
    "NoMaker": r"its `Memory` must be a class, such as dict, and is 7",
    "Unmade": r"ValueError: no memory today",
    "Unkept": r"memory: Encoding objects of type Memory is unsupported\. Use numbers, .*Struct",
    "Named": r"its `assign` must be a method, and is 'nearest'",
    "NotEarly": r"its `early` must be True or False, and is 'no'",
    "Yielding": r"must return a list of Assignment\(bin, carrier\): use neither .* nor `yield`",
    "Awaited": r"must return a list of Assignment\(bin, carrier\): use neither `async def`",
}


@pytest.mark.parametrize("policy", UNUSABLE)
def test_a_policy_that_could_never_decide_is_refused(policy):
    """It is refused before the run, which would otherwise be one of `nearest`."""
    error = (
        rf"dispatch = own_policies\.{policy}: cannot be used: .*{UNUSABLE[policy]}"
        r".* \(.*own_policies\.py, line \d+\)"
    )
    with pytest.raises(ScenarioError, match=error):
        check_plugins(lay_out(empty_orchard(dispatch=f"own_policies.{policy}")))


# Python refuses a source with a null byte, and does not say in which file it has found it.
NO_SOURCE = "\0"
# A policy, the files of its module, and where the error says that the null byte is.
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
    files, place = UNREADABLE[name]
    for file, text in files.items():
        path = tmp_path / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    error = rf"cannot be used: .*null bytes \({tmp_path}/{place}\)"
    with pytest.raises(ScenarioError, match=error):
        check_plugins(lay_out(empty_orchard(dispatch=name)))


@cache
def harvested(name: str) -> Stage:
    """Return a small orchard that was harvested to the end with this policy."""
    stage = Stage(small_orchard(name, row_length=20.0), is_hashed=True)
    stage.run_to_the_end()
    return stage


@pytest.mark.parametrize("name", DISPATCH_POLICIES)
def test_a_harvest_with_each_policy_is_complete(name):
    stage = harvested(name)
    assert stage.world.delivered == 4
    assert stage.account.figures()["broken_agents"] == []
    stage.assert_no_collisions()


def test_early_carriers_make_the_harvest_shorter():
    """`predictive` sends carriers before bins are full; the other two do not."""
    assert (
        harvested("predictive").seconds
        < harvested("farthest-first").seconds
        < harvested("nearest").seconds
    )


@pytest.mark.parametrize("name", ["farthest-first", "predictive", "rolling"])
def test_agents_started_afresh_often_harvest_alike(name):
    """They are made anew from their memories at every 25th tick, and asked at each tick."""
    whole = harvested(name)
    local = Local(small_orchard(name, row_length=20.0), holds=IgnoredHolds)
    while not local.engine.over:
        if local.engine.tick % 25 == 1:
            start_afresh(local)
        local.tick()
    assert local.engine.hash == whole.local.engine.hash


# Policies of tests/support/own_policies.py, and what the log says of each.
MISTAKES = {
    "Raising": r"LookupError: no such bin here \(.*own_policies.py, line \d+\)",
    "Inventing": r"assigns bin bin_77, which is not available; .* \(.*own_policies.py, line \d+\)",
    "Overworking": r"assigns bin bin_0\d twice \(.*own_policies.py, line \d+\)",
    "Hoarding": r"the policy's memory takes 20009 bytes; at most 16384 \(.*own_policies.py",
    "Silent": (
        r"assign returned None; it must return a list of Assignment\(bin, carrier\)"
        r" \(.*own_policies.py"
    ),
    "Tupling": r"memory\['seen'\]: tuple \(\d+,\), then list \[\d+\]. Use numbers,",
    "Remembering": r"memory\['last'\]\[0\]: Encoding objects of type .* is unsupported. Use",
}


def test_a_carrier_with_two_answers_at_once_is_sent_to_one_bin():
    """In realtime an answer may be late, and come together with the answer to the next question."""
    dispatcher = Dispatcher(lay_out(Scenario(dispatch="nearest")), "dispatch")
    fetches = [
        Heard("bin_01", 0, 0, Fetch(1, "east", "picker_01", 0, 0.0)),
        Heard("bin_02", 0, 0, Fetch(2, "east", "picker_01", 0, 0.0)),
    ]
    memory = dispatcher.tick(without_body("dispatch", 1), Mail(fetches), None).memory
    free = CarrierStatus("", True, 5.0)
    answers = [Reply("carrier_01", 0, CarrierQuery(), free)] * 2
    memory = dispatcher.tick(without_body("dispatch", 2), Mail([], answers), memory).memory
    assert {name: booking.carrier for name, booking in memory.bookings.items()} == {
        "bin_01": "carrier_01"
    }
    assert memory.refused == 0


def test_names_in_a_decision_may_be_of_a_text_type_of_a_library():
    """The dispatcher keeps the names in its memory, which takes plain text only."""
    (order,) = checked([Assignment(np.str_("bin_01"), np.str_("carrier_02"))], [NEAR], [HEAD])
    assert type(order.bin) is str
    assert type(order.carrier) is str


@pytest.mark.parametrize("name", MISTAKES)
def test_the_mistake_of_a_policy_is_named_once_and_counted(name, caplog):
    stage = Stage(small_orchard(f"own_policies.{name}", rows=3, carriers=3))
    stage.run_until(lambda: stage.world.delivered == 1, 500)
    faults = [
        record.getMessage() for record in caplog.records if "dispatch policy" in record.getMessage()
    ]
    assert len(faults) == 1, "once in the log"
    assert re.search(MISTAKES[name], faults[0]), faults[0]
    figures = stage.account.figures()
    assert figures["orders_refused"] >= 1
    # A broken agent makes the exit code 1, but the harvest goes on.
    assert [line.split(",")[0] for line in figures["broken_agents"]] == ["dispatch"]
    assert stage.account.fault == ""


def test_a_mistake_may_end_the_harvest_in_lockstep_at_its_tick(fleet):
    """The scenario says that a refused order ends the run. It ends at the tick of local mode."""
    scenario = small_orchard("own_policies.Raising", rows=3, dispatch_errors="end")
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
