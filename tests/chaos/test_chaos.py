"""The parts of the soak of real processes, `python -m chaos`.

Its trials (runs with faults) follow from the seed; its relay passes bytes on, and cuts links; its
fuzzer makes messages that belong to no run; its oracle compares a run with local mode; its report
tells all.
"""

import itertools
import socket
import threading
from random import Random

import pytest
from typer.testing import CliRunner

from chaos import schedule
from chaos.__main__ import app
from chaos.baseline import Baseline, scenario
from chaos.disk import Disk
from chaos.endurance import Endurance, MemorySample, MemorySeries
from chaos.fault_injection import Execution, Recovery, time_limit
from chaos.fuzzer import mutated
from chaos.harvest import flip_bit
from chaos.mistakes import EVERY, MISTAKES
from chaos.network import Network
from chaos.oracle import judge
from chaos.relay import Relay
from chaos.report import Results, markdown
from chaos.schedule import Fault, most_deaths, trial
from orchard.contract.messages import pack
from orchard.launch.supervisor import DEATHS, free_port
from orchard.local import Local
from orchard.net.endpoints import BusError, check_free
from orchard.net.refusals import Refused, read_message
from orchard.sim.kernels.cache import DIGEST, KernelFiles
from orchard.wire.messages import Clock, Stamp

# The id of a run, as a run makes one.
RUN = "5f0c2a9e4b7d4c11"
# Enough that each fault and each combination of a few is among them.
TRIALS = [trial(1, number) for number in range(300)]


def test_the_same_seed_and_number_do_the_same_and_others_do_not():
    assert [trial(1, number) for number in range(300)] == TRIALS
    assert len({drawn.faults for drawn in TRIALS}) == len(TRIALS)
    assert trial(2, 0).faults != TRIALS[0].faults


def test_faults_come_while_the_run_goes_on_in_order():
    for drawn in TRIALS:
        ticks = [fault.tick for fault in drawn.faults]
        assert ticks == sorted(ticks)
        assert ticks[0] > 0
        # A whole harvest takes 550 s at least.
        assert ticks[-1] < 10 * (drawn.seconds or 550)


def test_no_process_is_killed_as_often_as_makes_it_be_given_up():
    assert schedule.MOST_DEATHS < DEATHS
    assert max(most_deaths(drawn.faults) for drawn in TRIALS) == schedule.MOST_DEATHS
    # Both faults of a host may hit the same one, and a kill of all processes is a death of it, too:
    # three deaths.
    targets = (schedule.HOST, schedule.HOST, schedule.ALL, schedule.LOGGER)
    assert most_deaths([Fault(9, schedule.KILL, target, 0.0, 0) for target in targets]) == 3
    signals = (schedule.KILL, schedule.TERMINATE, schedule.INTERRUPT)
    assert most_deaths([Fault(9, kind, schedule.HOST, 0.0, 0) for kind in signals]) == 3
    # A torn cache costs one death of physics, and a port that is taken four.
    at_physics = (schedule.TORN, schedule.PORT)
    assert most_deaths([Fault(9, kind, schedule.NOTHING, 0.0, 0) for kind in at_physics]) == 5


def test_faults_hit_only_what_is_there():
    for drawn in TRIALS:
        targets = {fault.target for fault in drawn.faults}
        assert drawn.is_recorded or schedule.LOGGER not in targets
        assert drawn.is_routed or not targets & {schedule.ROUTER, schedule.LINK, schedule.LINKS}
        # With a router of its own, physics has no port that could be taken.
        if drawn.is_routed:
            assert schedule.PORT not in {fault.kind for fault in drawn.faults}


def test_in_ten_minutes_there_is_everything():
    few = TRIALS[:30]
    assert {fault.name for drawn in few for fault in drawn.faults} == {
        fault.name for drawn in TRIALS for fault in drawn.faults
    }
    assert {drawn.mode for drawn in few} == {"lockstep", "realtime"}
    assert any(drawn.seconds is None for drawn in few)
    assert any(fault.kind == schedule.BYTES for drawn in few for fault in drawn.faults)


def is_over(end):
    """Whether a socket is closed from the other side."""
    try:
        return end.recv(1) == b""
    except ConnectionResetError:
        return True


@pytest.fixture
def link():
    """Give a relay, and the near and the far end of a connection through it."""
    with socket.create_server(("127.0.0.1", 0)) as server, Relay(server.getsockname()[1]) as relay:
        near = socket.create_connection(("127.0.0.1", relay.port), 10.0)
        far, _ = server.accept()
        far.settimeout(10.0)
        with near, far:
            near.sendall(b"hello")
            assert far.recv(5) == b"hello"
            yield relay, near, far


def test_a_relay_passes_everything_on_both_ways(link):
    _, near, far = link
    far.sendall(b"and back")
    assert near.recv(8) == b"and back"


def test_a_link_that_is_cut_is_cut_for_both(link):
    relay, near, far = link
    relay.cut(None)
    for end in (near, far):
        assert is_over(end)


def test_a_link_that_is_stalled_loses_nothing(link):
    """It keeps what is sent until it is healed."""
    relay, near, far = link
    relay.stall(17)
    near.sendall(b"later")
    far.settimeout(0.2)
    with pytest.raises(TimeoutError):
        far.recv(5)
    relay.heal()
    far.settimeout(10.0)
    assert far.recv(5) == b"later"


def test_a_relay_whose_router_is_away_hangs_up():
    with (
        Relay(free_port()) as relay,
        socket.create_connection(("127.0.0.1", relay.port), 10.0) as near,
    ):
        assert is_over(near)


def test_no_nonsense_is_of_the_run():
    clock = pack(Clock(RUN, 12, Stamp(1, 2)))
    """Each is refused: not one could change a run."""
    chance = Random(1)
    for _ in range(2000):
        with pytest.raises(Refused):
            read_message(mutated(chance, clock, RUN), Clock, RUN)


def test_a_full_disk_takes_nothing_until_it_is_cleared(tmp_path):
    disk = Disk(tmp_path)
    assert not disk.fill(), "the machine's own disk is never filled"
    disk.mount()
    if not disk.is_there:
        pytest.skip("this machine mounts no disk for a test")
    try:
        assert disk.fill()
        with pytest.raises(OSError, match="No space left"):
            (tmp_path / "snapshot").write_bytes(b"x")
        disk.clear()
        (tmp_path / "snapshot").write_bytes(b"x")
    finally:
        disk.unmount()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("chance", [0, 1234567, 2**32 - 1])
def test_a_flipped_bit_makes_a_kernel_unusable(tmp_path, chance):
    files = KernelFiles(tmp_path)
    files.keep("a.nbc", bytes(999))
    flip_bit(tmp_path / "a.nbc", chance)
    assert (tmp_path / "a.nbc").stat().st_size == DIGEST + 999
    assert files.load("a.nbc") is None


def test_a_port_that_is_taken_is_free_again_when_it_is_let_go():
    with Network(False) as network:
        with network.take_port():
            assert network.take_port() is None
            with pytest.raises(BusError):
                check_free(network.endpoint)
        check_free(network.endpoint)


@pytest.fixture(scope="module")
def wanted():
    """Return what a run of 60 s must come to."""
    return Baseline().result(scenario(1), 600)


def summary(wanted, **changes):
    """Return the summary of a good run, with these changes."""
    valid = {
        "ticks": 600,
        "hash": wanted.hash,
        "bins_delivered": wanted.bins,
        "rows_picked": wanted.rows,
    }
    known = {
        "messages_refused": {"malformed": 3},
        "violations": [],
        "broken_agents": [],
        "finished": False,
    }
    return valid | known | changes


# A trial of each kind. A mistaken one has an agent that makes mistakes.
LOCKSTEP = next(drawn for drawn in TRIALS if drawn.mode == "lockstep" and not drawn.is_mistaken)
REALTIME = next(
    drawn
    for drawn in TRIALS
    if drawn.mode == "realtime" and drawn.seconds is None and not drawn.is_mistaken
)
MISTAKEN = next(drawn for drawn in TRIALS if drawn.mode == "lockstep" and drawn.is_mistaken)


def execution(exit_code=0):
    """Return how a run of 600 ticks with two faults went. It went on 1 s and 3 s after them."""
    return Execution(
        ["kill physics", "kill physics"],
        [Recovery("kill physics", 1.0), Recovery("kill physics", 3.0)],
        exit_code,
        600,
        99.0,
    )


def test_a_run_that_came_to_what_local_mode_does_is_good(wanted):
    verdict = judge(LOCKSTEP, execution(), summary(wanted), wanted)
    assert verdict.complaints == []
    assert verdict.refused == 3


# Exit code, what differs in the summary, and the promise that is broken. None: it was ended.
BROKEN = [
    (0, {"hash": "another"}, "hashes changed"),
    (0, {"rows_picked": -1}, "bins lost"),
    (1, {"violations": ["bin_01 is nowhere"]}, "invariants broken"),
    (0, {"ticks": 599}, "runs that did not finish"),
    (1, {}, "runs that did not finish"),
    (None, {}, "runs that did not finish"),
]


@pytest.mark.parametrize(("exit_code", "changes", "broken"), BROKEN)
def test_whatever_is_broken_is_counted_and_told(wanted, exit_code, changes, broken):
    verdict = judge(LOCKSTEP, execution(exit_code), summary(wanted, **changes), wanted)
    results = Results(1, "today", [verdict])
    assert dict(results.promises())[broken] == 1
    assert verdict.complaints
    assert not results.is_good


def test_an_agent_that_makes_mistakes_is_broken_and_no_other(wanted):
    broken = summary(wanted, broken_agents=["cat_01, since tick 0"])
    assert judge(MISTAKEN, execution(1), broken, wanted).complaints == []
    assert judge(MISTAKEN, execution(0), summary(wanted), wanted).complaints == [
        "broken agents: none"
    ]
    assert judge(LOCKSTEP, execution(1), broken, wanted).complaints == ["broken agents: cat_01"]


def test_each_mistake_is_refused_but_that_in_a_text():
    """cat_01 makes a mistake every EVERY ticks. A text with odd letters is only made printable."""
    local = Local(scenario(1, True))
    states = []
    for _ in range(EVERY * len(MISTAKES)):
        local.tick()
        states.append(local.actions["cat_01"].state)
    assert states[::EVERY] == ["broken"] * (len(MISTAKES) - 1) + [states[-1]]
    assert states.count("broken") == len(MISTAKES) - 1


def test_a_whole_harvest_in_realtime_must_deliver_every_bin(wanted):
    """The orchard has 3 bins. In realtime there is no hash to compare."""
    complete = judge(REALTIME, execution(), summary(wanted, finished=True, bins_delivered=3), None)
    lacking = judge(REALTIME, execution(), summary(wanted, finished=True, bins_delivered=2), None)
    assert complete.bins_lost == 0
    assert lacking.bins_lost == 1
    assert complete.complaints == []
    assert lacking.complaints != []


def test_every_run_has_a_time_limit():
    assert all(0 < time_limit(drawn) < 900 for drawn in TRIALS)


def memory(megabytes, handles):
    """Return the samples of a process, 5,000 ticks apart."""
    return MemorySeries(
        "physics",
        [
            MemorySample(5000 * i, float(m), h)
            for i, (m, h) in enumerate(zip(megabytes, handles, strict=True))
        ],
    )


def test_flat_is_neither_a_leak_of_memory_nor_of_handles():
    """Memory that goes up and down is flat; a rise of 3 MB each time, or one handle, is not."""
    assert memory([100, 101, 100, 101], [9, 10, 9, 9]).is_flat
    assert not memory([100, 103, 106, 109], [9, 9, 9, 9]).is_flat
    assert not memory([100, 100, 100, 100], [9, 9, 10, 10]).is_flat


def test_the_report_has_the_median_and_the_worst_of_each_fault(wanted):
    """Both kills of physics recovered, after 1 s and 3 s: the median is 2 s. Memory is in MB."""
    results = Results(5, "today", [judge(LOCKSTEP, execution(), summary(wanted), wanted)], 60.0)
    results.endurance = Endurance(
        100_000, [memory([100, 101, 100, 101], [9, 9, 9, 9])], {"lockstep": 600.0}
    )
    text = markdown(results)
    assert "| kill physics, lockstep | 2 | 2 | 2.00 | 3.00 |" in text
    assert "| bins lost | 0 |" in text
    assert "seed 5" in text
    assert "| physics | 100.0 | 101.0 |" in text


def test_the_command_line_names_what_it_does_not_know():
    done = CliRunner().invoke(app, ["--only", "-1"])
    assert done.exit_code == 2
    assert "--only" in done.output


def test_a_relay_has_no_thread_when_it_is_closed():
    before = threading.active_count()
    with Relay(free_port()):
        assert threading.active_count() == before + 1
    assert threading.active_count() == before


def test_trials_are_told_apart_by_their_numbers():
    assert len({str(drawn) for drawn in itertools.islice(TRIALS, 50)}) == 50
