"""Policies that cheat, and what happens to each: docs/benchmark.md lists them.

A policy of a user runs in a process of its own, `PolicyProcess`, which must not know what the seed
draws: speeds, failures, people. Each class of tests/support/cheating_policies.py tries to find it,
and raises `Found` with what it has found.
"""

import os
import re
import selectors
import sys
import time
from dataclasses import replace

import pytest

from orchard.behaviour.dispatcher import PolicyFault
from orchard.discrete.harvest import DiscreteHarvest
from orchard.dispatch.policies import dispatch_of
from orchard.dispatch.policy import BinReport
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.study.benchmark.asked import (
    AskingStopped,
    Limits,
    PolicyProcess,
    PolicyRefused,
    TooSlow,
)
from orchard.study.benchmark.confined import can_hide, can_keep_signals_in
from orchard.study.benchmark.instances import instances
from orchard.study.benchmark.play import Played, play
from orchard.study.benchmark.scores import Harvests, ShorterThanProven
from orchard.study.benchmark.seen import HiddenFromPolicy, layout_seen, nothing_drawn

# Limits that no policy reaches on a busy machine, s.
PATIENT = Limits(decision_seconds=120.0, begin_seconds=300.0)
# Everything that the seed can draw is drawn.
DRAWN = with_changes(
    Scenario(
        rows=4,
        pickers=2,
        carriers=2,
        picking_speed=0.1,
        seed=8_675_309,
        picking={"spread": {"distribution": "lognormal", "cv": 0.3}},
        carrying={"failure": {"mean_between": 300.0, "mean_repair": 60.0}},
    ),
    people={"workers": 2, "visitors": 0},
)


def played(policy: str, scenario: Scenario = DRAWN, limits: Limits = PATIENT) -> Played:
    """Let a policy of cheating_policies decide a harvest, in a process of its own."""
    with PolicyProcess(f"cheating_policies.{policy}", limits) as process:
        is_early = process.begin(scenario)
        harvest = play(lay_out(scenario), is_early, process.orders)
        process.end()
        return harvest


@pytest.mark.parametrize(
    ("cheat", "said"),
    [
        ("SeedReader", r"HiddenFromPolicy: layout\.scenario\.seed is hidden from a policy"),
        ("SeedReaderWithDefault", r"HiddenFromPolicy: layout\.scenario\.seed is hidden"),
        ("DumpReader", r"Found: \(0, \{'distribution': 'none', .*\{'workers': 0, 'visitors': 0\}"),
        ("ModuleReader", r"Found: \['tiny-train'\]"),
    ],
)
def test_a_class_that_asks_for_what_is_drawn_is_refused(cheat, said):
    """What a dump shows is what nobody has drawn; the names of public orchards are public."""
    with pytest.raises(PolicyRefused, match=rf"cannot be used: {said}.*cheating_policies\.py, l"):
        played(cheat)


def test_a_version_that_cannot_be_read_is_refused():
    wanted = r"cannot be used: its `version` cannot be read: Found: no version"
    with pytest.raises(PolicyRefused, match=wanted):
        played("Unversioned")


@pytest.mark.parametrize(
    ("cheat", "said"),
    [
        ("FailureReader", r"HiddenFromPolicy: layout\.scenario\.carrying\.failure is hidden from"),
        ("SpeedReader", r"Found: \[0\.1\]"),
        ("GuestReader", r"Found: \['bin', 'carrier', 'picker', 'tractor'\]"),
        ("StackClimber", r"Found: \(False, False\)"),
        ("ArgumentReader", r"Found: \(\[\], \[\]\)"),
        ("Raiser", r"Found: nothing"),
        ("Exiter", r"it ended its process, with code 0"),
        ("Crasher", r"it ended its process, with code -11"),
        ("Inventor", r"assigns carrier carrier_99, which is not available; available: carrier_"),
        ("Forger", r"its process wrote no answer of a policy"),
        ("Flooder", r"its answer has 2147483647 bytes; at most 100000"),
        ("Boaster", r"assigns bin b+\.\.\."),
        ("Glutton", r"OSError: \[Errno 12\] Cannot allocate memory"),
        ("Forker", r"(assigns bin bin_\d+, which is not available|an answer before it was asked)"),
        ("Ahead", r"it gave an answer before it was asked"),
        ("LimitRaiser", r"ValueError: not allowed to raise maximum limit"),
        ("NumberMaker", r"TypeError: assign returned nan; it must return a list of Assignment"),
        ("OrderOfNumbers", r"ValueError: the dispatch policy assigns bin nan, which is not av"),
    ],
)
def test_a_cheat_in_a_decision_ends_with_its_name(cheat, said):
    """Each message says which policy, at which tick, and what it did."""
    wanted = rf"dispatch policy cheating_policies\.{cheat}, tick \d+: .*{said}"
    with pytest.raises(PolicyFault, match=wanted):
        played(cheat)


def test_no_object_of_a_policys_process_has_the_seed():
    with pytest.raises(PolicyFault) as caught:
        played("Collector")
    assert re.search(r"Found: \(False, \[", str(caught.value))
    assert str(DRAWN.seed) not in str(caught.value)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems ask no capability")
def test_a_policy_opens_neither_memory_nor_environment_above():
    """Of the processes above its own it lists each whose memory or environment it can open.

    It may look into the process that forked it, which knows no more than it does, and not into the
    benchmark. The shell from which the benchmark was started is no part of the benchmark.
    """
    with pytest.raises(PolicyFault) as caught:
        played("MemoryReader")
    found = re.search(r"Found: (\[.*?\])", str(caught.value))[1]
    benchmark = f"'{_name_of(os.getpid())}', 'mem', False"
    assert benchmark not in found


def test_a_table_of_answers_knows_public_orchards_only():
    """A policy may know the best schedules of public orchards by heart. That cannot be prevented,
    so the command says which orchards are public.
    """
    public = instances()["load-out-test"]
    seconds = played("Librarian", public.whole_scenario).seconds
    assert seconds == pytest.approx(public.draws[0].best.seconds)
    with pytest.raises(PolicyRefused, match="Found: no such orchard"):
        played("Librarian", DRAWN)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such rights")
def test_a_program_that_a_policy_starts_has_no_rights():
    """Root's programs begin with all rights, those to look into others too, unless they are given
    up for good.
    """
    with pytest.raises(PolicyFault, match=r"Found: .*Permission denied: '/proc/\d+/mem'"):
        played("MemoryReaderAnew")


@pytest.mark.skipif(not can_hide(), reason="this system cannot hide files")
def test_a_policy_cannot_read_the_secret(tmp_path, monkeypatch):
    """The command line of the benchmark names its file, so every policy knows where it is."""
    secret = tmp_path / "secret.txt"
    secret.write_text("of the organiser")
    (tmp_path / "beside.txt").write_text("of anybody")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    limits = replace(PATIENT, hidden=(str(secret),))
    with pytest.raises(PolicyRefused, match=r"Found: \['of anybody', 'refused'\]"):
        played("SecretReader", limits=limits)


@pytest.mark.skipif(not can_keep_signals_in(), reason="this system cannot keep signals in")
def test_a_policy_cannot_stop_the_benchmark():
    """While the benchmark is stopped (SIGSTOP) it does not look at the clock, and the policy could
    think for longer.
    """
    wanted = r"Stopper, tick \d+: PermissionError: .*Operation not permitted"
    with pytest.raises(PolicyFault, match=wanted):
        played("Stopper")


def test_an_answer_that_was_read_late_is_too_slow(monkeypatch):
    """The benchmark itself may have been stopped while it waited for the answer.

    Here the clock jumps by 1,000 s in that time, and the answer is there.
    """
    late = []
    monotonic = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: monotonic() + 1000.0 * len(late))

    class StoppedSelector(selectors.DefaultSelector):
        def select(self, timeout=None):
            late.append(1)
            return super().select(PATIENT.decision_seconds)

    with PolicyProcess("cheating_policies.Honest", PATIENT) as process:
        process.begin(DRAWN)
        monkeypatch.setattr(selectors, "DefaultSelector", StoppedSelector)
        monkeypatch.setattr(process, "_has_written", lambda: False)
        with pytest.raises(TooSlow, match=r"tick 1: it took more than 120 s for a decision"):
            process.orders(1, [], [])


def _name_of(pid: int) -> str:
    """Return the name of a process, as Linux has it."""
    with open(f"/proc/{pid}/comm", encoding="utf-8") as file:
        return file.read().strip()


@pytest.mark.parametrize("cheat", ["Patcher", "Printer"])
def test_what_a_policy_changes_or_prints_changes_nothing(cheat):
    """A patch of the model stays in its process, and nobody reads what it prints as an answer."""
    assert played(cheat) == played("Honest")


@pytest.mark.parametrize("cheat", ["Sleeper", "Spinner"])
def test_a_decision_that_takes_too_long_ends_the_harvest(cheat):
    limits = Limits(decision_seconds=0.05, begin_seconds=300.0)
    wanted = rf"cheating_policies\.{cheat}, tick \d+: it took more than 0\.05 s for a decision"
    with pytest.raises(TooSlow, match=wanted):
        played(cheat, limits=limits)


# So many reports of bins that a pipe does not take the question with them.
MANY = [BinReport("bin_01", 1, "west", "picker_01", 0, 30.0)] * 5000


def test_a_policy_that_reads_no_question_is_too_slow():
    """Its pipe is full then: the benchmark must not wait for room in it for ever."""
    limits = Limits(decision_seconds=2.0, begin_seconds=300.0)
    with PolicyProcess("cheating_policies.Deaf", limits) as process:
        process.begin(DRAWN)
        assert process.orders(1, [], []) == []
        with pytest.raises(TooSlow, match=r"Deaf, tick 2: it took more than 2 s for a decision"):
            process.orders(2, MANY, [])


def test_a_benchmark_stops_while_no_question_is_read():
    """One Ctrl-C ends it, as it does while an answer is awaited."""
    asked = []
    with PolicyProcess("cheating_policies.Deaf", PATIENT, lambda: 2 in asked) as process:
        process.begin(DRAWN)
        assert process.orders(1, [], []) == []
        asked.append(2)
        with pytest.raises(AskingStopped):
            process.orders(2, MANY, [])


def test_a_policy_that_never_begins_has_no_score():
    limits = Limits(decision_seconds=120.0, begin_seconds=2.0)
    with pytest.raises(TooSlow, match=r"SlowStarter, tick 0: it took more than 2 s to begin"):
        played("SlowStarter", limits=limits)


def test_a_harvest_has_so_much_of_the_processor():
    limits = replace(PATIENT, processor_seconds=1)
    wanted = r"Worker, tick \d+: it took more than 1 s of the processor for one harvest"
    with pytest.raises(TooSlow, match=wanted):
        played("Worker", limits=limits)


def test_a_harvest_has_what_its_forked_processes_use():
    """The limit of the system is for each process; at the end all are counted together."""
    limits = replace(PATIENT, processor_seconds=2)
    wanted = r"Delegator, tick \d+: it took more than 2 s of the processor for one harvest"
    with pytest.raises(TooSlow, match=wanted):
        played("Delegator", limits=limits)


def test_a_policy_deaf_to_its_limit_is_ended():
    limits = replace(PATIENT, processor_seconds=1)
    with pytest.raises(PolicyFault, match=r"it ended its process, with code -9"):
        played("DeafWorker", limits=limits)


def test_no_harvest_knows_what_happened_in_another_one():
    with PolicyProcess("cheating_policies.Learner", PATIENT) as process:
        for seed in (1, 2):
            scenario = with_changes(DRAWN, seed=seed)
            is_early = process.begin(scenario)
            assert play(lay_out(scenario), is_early, process.orders).seconds is not None
            process.end()


def test_a_harvest_shorter_than_its_proof_is_an_error():
    words = {"orchard": "small-fast", "policy": "mine.Fast", "checked": []}
    assert Harvests(**words, proven=[9.0], seconds=[9.0]).score == 1.0
    with pytest.raises(ShorterThanProven, match=r"small-fast: a harvest with mine\.Fast took 8\.9"):
        Harvests(**words, proven=[9.0], seconds=[8.9])


@pytest.mark.parametrize(
    "name", ["small-failures-train", "small-batteries-test", "small-spread-train"]
)
@pytest.mark.parametrize("policy", ["rolling", "predictive-farthest"])
def test_built_in_policies_know_no_more_in_process(name, policy):
    """They run in the benchmark's process for speed, with the same result."""
    scenario = with_changes(instances()[name].whole_scenario, dispatch=policy)
    with PolicyProcess(policy, PATIENT) as process:
        is_early = process.begin(scenario)
        asked = play(lay_out(scenario), is_early, process.orders)
    assert asked.seconds == DiscreteHarvest(lay_out(scenario)).run().seconds


def test_a_seen_layout_gives_the_package_what_it_needs():
    layout = layout_seen(nothing_drawn(DRAWN))
    assert layout.picking_seconds(1, 10.0) == pytest.approx(100.0)
    assert dispatch_of(layout)
    with pytest.raises(HiddenFromPolicy, match=r"layout\.scenario\.picking\.spread is hidden"):
        _ = layout.scenario.picking.spread
