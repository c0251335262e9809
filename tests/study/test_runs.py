"""One run: the figures of both models, the clock, and errors with their place.

The fast model is the event model, and the full one is the simulator.
"""

import re
import subprocess
import sys
from math import inf
from pathlib import Path

import pytest

import orchard
from orchard.field.scenario import Scenario, with_changes
from orchard.local import Local
from orchard.study.runs import DECIDING, PlannedRun, RunFailed, do

# Until when a run may take, on the clock of the machine, s.
NO_DEADLINE = inf
IS_OVER = 0.0
SCENARIO = Scenario(
    rows=3,
    row_length=60.0,
    people={"workers": 0, "visitors": 0},
    animals={"dogs": 0, "cats": 0},
    weeds=0,
)


def test_both_models_tell_nearly_the_same():
    """The harvests are equally long within 4 %; keys differ, so a store keeps both."""
    fast = do(PlannedRun(SCENARIO, "fast"), NO_DEADLINE)
    full = do(PlannedRun(SCENARIO, "full"), NO_DEADLINE)
    assert (fast.ended, fast.bins, full.ended, full.bins) == ("harvested", 3, "harvested", 3)
    assert fast.sim_seconds == pytest.approx(full.sim_seconds, rel=0.04)
    assert (fast.bound_bins_per_hour, fast.bottleneck) == (
        full.bound_bins_per_hour,
        full.bottleneck,
    )
    assert fast.key != full.key and fast.scenario == full.scenario


def test_a_full_run_that_takes_too_long_is_given_up():
    assert do(PlannedRun(SCENARIO, "full"), IS_OVER) is None


def test_a_run_without_its_hash_is_the_same_run():
    hashed = Local(SCENARIO)
    bare = Local(SCENARIO, is_hashed=False)
    for _ in range(200):
        assert hashed.tick() == bare.tick()
    assert hashed.engine.world.pose.tolist() == bare.engine.world.pose.tolist()
    assert len(hashed.engine.hash) == 64 and bare.engine.hash == ""


@pytest.mark.parametrize("error", [LookupError("no such bin"), SystemExit(0)])
def test_an_error_in_a_run_does_not_end_the_program(error, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr("orchard.study.runs._fast", fail)
    with pytest.raises(
        RunFailed, match=rf"seed 1, fast model, rolling: {type(error).__name__}: {error}"
    ):
        do(PlannedRun(SCENARIO, "fast"), NO_DEADLINE)


# A faulty policy of tests/support/own_policies.py, and what is told of it.
WRONG_POLICIES = [
    ("Raising", "LookupError: no such bin here"),
    ("Inventing", "ValueError: the dispatch policy assigns bin bin_77, which is not available; .*"),
    ("Silent", "TypeError: assign returned None; .*"),
    ("Leaving", "SystemExit: 0"),
    ("Hoarding", "ValueError: the policy's memory takes 20009 bytes; at most 16384"),
]


@pytest.mark.parametrize("horizon", ["harvest", "long"])
@pytest.mark.parametrize(("policy", "words"), WRONG_POLICIES)
def test_what_is_wrong_with_a_policy_is_told_with_its_place(policy, words, horizon):
    """The place is a line of the user's own file, and not of a library."""
    fault = (
        rf"dispatch policy own_policies\.{policy}, tick \d+: {words} \([^()]*own_policies\.py, line"
        r" \d+\)$"
    )
    scenario = with_changes(SCENARIO, dispatch=f"own_policies.{policy}")
    with pytest.raises(RunFailed, match=fault):
        do(PlannedRun(scenario, "fast", horizon), NO_DEADLINE)


def test_a_full_run_tells_what_failed_in_an_own_policy():
    """In the simulator a policy that fails stops nothing: bins are served as with `nearest`."""
    scenario = with_changes(SCENARIO, dispatch="own_policies.Raising")
    record = do(PlannedRun(scenario, "full"), NO_DEADLINE)
    assert record.ended == "harvested"
    refused, broken = record.faults.splitlines()
    assert re.fullmatch(r"refused decisions of the dispatch policy: [1-9]\d*", refused)
    assert broken.startswith("dispatch, since tick ")


# Packages that a run loads, and that only show, read, keep or change what it gives.
AROUND_A_RUN = {"fork", "terminal", "view", "wire"}


def test_stored_runs_are_of_each_package_that_decides_a_run():
    """A stored run is used again while the code of the packages in DECIDING is the same."""
    code = "import sys, orchard.local, orchard.report.long_run, orchard.event_model.kernel.entry"
    program = [sys.executable, "-c", f"{code}; print(*sys.modules)"]
    loaded = subprocess.run(program, capture_output=True, check=True, text=True)
    parts = [name.split(".") for name in loaded.stdout.split()]
    packages = {part[1] for part in parts if part[0] == "orchard" and len(part) > 2}
    assert {"behaviour", "event_model", "sim"} <= packages
    assert packages - AROUND_A_RUN <= set(DECIDING)
    root = Path(orchard.__file__).parent
    assert [name for name in DECIDING if not (root / name / "__init__.py").exists()] == []
