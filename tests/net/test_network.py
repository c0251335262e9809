"""The network breaks and mends: lockstep goes on with the hash of local mode, realtime goes on and finishes. Links, routers, relays."""

import queue
import time
from contextlib import suppress

import pytest
from fleet import until
from local_runs import SMALL, TICKS, TOY
from machines import machines, needs_machines, slowed, unplugged, within

from chaos.relay import Relay
from orchard.launch.supervisor import free_port

pytestmark = pytest.mark.processes

PACE = ("--speed", "5", "--duration", str(TICKS / 10))  # slow enough that a fault meets the run where it shall
PORT = 7447
LIVE = ("--mode", "realtime", "--speed", "2")
DOWN = 5.0  # s, for which links are down
MIDDLE = [f"tcp/192.168.{n}.10:{PORT}" for n in (1, 2, 3)]  # the router, as each guest finds it


def standstill(clock, seconds=DOWN):
    """Wait so long, and see that hardly a tick comes meanwhile."""
    deadline, ticks = time.monotonic() + seconds, 0
    while not clock.empty():
        clock.get()
    with suppress(queue.Empty):
        while True:
            clock.get(timeout=max(0.0, deadline - time.monotonic()))
            ticks += 1
    assert ticks < 10 * seconds, "five times as many would have come"


def going_on(clock, seconds=DOWN):
    """Wait so long in realtime, and see that the ticks come."""
    began = until(clock, lambda message: clock.empty())["tick"]
    until(clock, lambda message: message["tick"] >= began + 20 * seconds, 2 * seconds)


def over_three_machines(fleet, land, *arguments, agents=TOY):
    """A router in the middle; physics and a third of the agents on the first guest, a third on each of the others. Its clock."""
    middle, *guests = land
    fleet.router(f"tcp/0.0.0.0:{PORT}", before=within(middle))
    fleet.physics(SMALL, *arguments, "--connect", MIDDLE[0], before=within(guests[0]))
    for n, guest in enumerate(guests):
        fleet.host("--share", f"{n}/3", agents=agents, endpoint=MIDDLE[n], before=within(guest))
    return fleet.hear("orchard/clock", f"tcp/127.0.0.1:{PORT}", before=within(middle))


# -- links


@needs_machines
def test_links_that_are_down_for_five_seconds_change_nothing(fleet, undisturbed):
    """First that of a third of the agents, then that of physics; each time the sessions are given up and opened again."""
    with machines("a", "b", "c") as land:
        clock = over_three_machines(fleet, land, *PACE)
        for tick, guest in ((20, 2), (60, 1)):
            until(clock, lambda message, tick=tick: message["tick"] >= tick)
            with unplugged(land[0], guest):
                standstill(clock)
        assert fleet.end() == undisturbed


@needs_machines
@pytest.mark.soak
@pytest.mark.parametrize("seconds", [0.5, 2.0, 5.0, 10.0])
def test_soak_all_links_of_physics_that_is_the_router_are_down(fleet, undisturbed, seconds):
    with machines("a", "b", "c") as land:
        middle, *guests = land
        fleet.physics(SMALL, *PACE, "--listen", f"tcp/0.0.0.0:{PORT}", before=within(middle))
        for n, guest in enumerate(guests):
            fleet.host("--share", f"{n}/3", agents=TOY, endpoint=MIDDLE[n], before=within(guest))
        clock = fleet.hear("orchard/clock", f"tcp/127.0.0.1:{PORT}", before=within(middle))
        for tick in (5, 60):
            until(clock, lambda message, tick=tick: message["tick"] >= tick)
            with unplugged(middle, 1, 2, 3):
                standstill(clock, seconds)
        assert fleet.end() == undisturbed


@pytest.mark.soak
@needs_machines
def test_in_realtime_robots_stand_while_their_link_is_down_and_drive_again(fleet):
    with machines("a") as (host, guest):
        fleet.physics(SMALL, *LIVE, "--duration", "30", "--listen", f"tcp/0.0.0.0:{PORT}", before=within(host))
        here = f"tcp/127.0.0.1:{PORT}"
        poses, clock = (fleet.hear(f"orchard/{key}", here, before=within(host)) for key in ("worker_01/pose", "clock"))
        fleet.host("--without", "worker_01", agents=TOY, endpoint=here, before=within(host))
        fleet.host("--only", "worker_01", agents="calling_agents:steady", endpoint=MIDDLE[0], before=within(guest))
        until(poses, is_at(0.5))
        with unplugged(host, 1):
            until(poses, is_at(0.0))
            going_on(clock)
            until(poses, lambda pose: poses.empty() and is_at(0.0)(pose))
        until(poses, is_at(0.5))
        fleet.end()


def is_at(speed):
    """Whether a pose is of a body that goes at that speed, m/s."""
    return lambda pose: pose["twist"]["linear"]["x"] == speed


@needs_machines
@pytest.mark.soak
@pytest.mark.parametrize("guest", [1, 2])
def test_soak_in_realtime_with_a_router_of_its_own_a_link_is_down(fleet, guest):
    """That of physics and of some agents, or that of other agents."""
    with machines("a", "b", "c") as land:
        clock = over_three_machines(fleet, land, *LIVE, "--duration", "40")
        poses = fleet.hear("orchard/worker_01/pose", f"tcp/127.0.0.1:{PORT}", before=within(land[0]))
        until(clock, lambda message: message["tick"] >= 20)
        with unplugged(land[0], guest):
            standstill(clock) if guest == 1 else going_on(clock)
        until(poses, lambda pose: poses.empty())
        until(poses, lambda pose: pose["twist"]["linear"]["x"] > 0.0)
        fleet.end()


@needs_machines
@pytest.mark.parametrize("bucket", [("rate", "8mbit", "burst", "16kb", "latency", "200ms")])
def test_a_slow_link_changes_nothing(fleet, undisturbed, bucket):
    with machines("a") as (host, guest):
        slowed(host, 1, *bucket)
        fleet.physics(SMALL, *PACE, "--listen", f"tcp/0.0.0.0:{PORT}", before=within(host))
        fleet.host("--share", "0/2", agents=TOY, endpoint=f"tcp/127.0.0.1:{PORT}", before=within(host))
        fleet.host("--share", "1/2", agents=TOY, endpoint=MIDDLE[0], before=within(guest))
        assert fleet.end() == undisturbed


# -- a relay


def relay(endpoint, **network):
    """A relay to this endpoint. Its chunks are small, so that connections also break in the middle of a message."""
    return Relay(int(endpoint.rpartition(":")[2]), chunk=4096, **network)


def physics_and_a_router(fleet, *arguments):
    """Physics, a client of a router of its own."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = fleet.router(endpoint)
    fleet.physics(SMALL, *arguments, "--connect", endpoint)
    return router


@pytest.mark.soak
def test_delays_and_connections_that_break_change_nothing(fleet, undisturbed):
    fleet.physics(SMALL, *PACE)
    with relay(fleet.endpoint, seed=1, max_delay=0.002, mean_life=100_000) as bad:
        fleet.host("--share", "0/2", agents=TOY)
        fleet.host("--share", "1/2", agents=TOY, endpoint=bad.endpoint)
        assert fleet.end() == undisturbed
        assert bad.cuts > 0


@pytest.mark.soak
@pytest.mark.parametrize("life", [50_000, 100_000, 500_000])
@pytest.mark.parametrize("seed", range(5))
def test_soak_delays_and_connections_that_break_change_nothing(fleet, undisturbed, seed, life):
    """Those of physics, and of all agents, to a router of its own."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fleet.router(endpoint)
    with relay(endpoint, seed=seed, max_delay=0.01, mean_life=life) as bad:
        fleet.physics(SMALL, *PACE, "--connect", bad.endpoint)
        fleet.share(2, TOY)
        assert fleet.end(120.0) == undisturbed
        assert bad.cuts > 0


@pytest.mark.soak
@pytest.mark.parametrize("seconds", [1.0, 4.0])
def test_a_network_that_is_silent_for_a_while_changes_nothing(fleet, undisturbed, seconds):
    """Shorter than the lease, and longer."""
    fleet.physics(SMALL, *PACE)
    clock = fleet.client().hear("orchard/clock")
    with relay(fleet.endpoint) as bad:
        fleet.host("--share", "0/2", agents=TOY)
        fleet.host("--share", "1/2", agents=TOY, endpoint=bad.endpoint)
        until(clock, lambda message: message["tick"] >= 30)
        bad.stall(new=True)
        standstill(clock, seconds)
        bad.heal()
        assert fleet.end() == undisturbed


@pytest.mark.soak
def test_realtime_goes_on_whatever_a_relay_does(fleet):
    fleet.physics(SMALL, *LIVE, "--duration", "16")
    someone = fleet.client()
    clock, poses = someone.hear("orchard/clock"), someone.hear("orchard/worker_01/pose")
    with relay(fleet.endpoint, max_delay=0.005, mean_life=200_000) as bad:
        fleet.host("--without", "worker_01", agents=TOY, endpoint=bad.endpoint)
        fleet.host("--only", "worker_01", agents="calling_agents:steady", endpoint=bad.endpoint)
        until(clock, lambda message: message["tick"] >= 40)
        bad.stall(new=True)
        going_on(clock, 3.0)
        until(poses, lambda pose: poses.empty() and is_at(0.0)(pose))
        bad.heal()
        until(poses, is_at(0.5))
        bad.calm()  # a host that is cut off at the very end is told nothing of it
        fleet.end()
        assert bad.cuts > 0


def test_who_takes_over_from_one_whose_death_the_network_has_not_told_waits_for_it(fleet, undisturbed):
    """A machine that is cut off and loses its host: for physics that lives until its lease is over."""
    fleet.physics(SMALL, *PACE)
    clock = fleet.client().hear("orchard/clock")
    with relay(fleet.endpoint) as bad:
        fleet.host("--share", "0/2", agents=TOY)
        dead = fleet.host("--share", "1/2", agents=TOY, endpoint=bad.endpoint)
        until(clock, lambda message: message["tick"] >= 30)
        bad.stall(new=True)
        dead.kill()
        fleet.hosts.remove(dead)
        fleet.host("--share", "1/2", agents=TOY)
        assert fleet.end() == undisturbed


# -- routers


@pytest.mark.soak
def test_a_router_that_is_killed_twice_and_once_with_a_host_changes_nothing(fleet, undisturbed):
    router = physics_and_a_router(fleet, *PACE)
    fleet.share(2, TOY)
    for tick in (20, 70):
        until(fleet.client().hear("orchard/clock"), lambda message, tick=tick: message["tick"] >= tick)
        router.kill()
        if tick == 70:
            fleet.hosts.pop().kill()
            fleet.host("--share", "1/2", agents=TOY)
        router = fleet.router(fleet.endpoint)
    assert fleet.end() == undisturbed


@pytest.mark.soak
def test_in_realtime_a_router_that_is_killed_and_started_again_lets_the_robots_drive_again(fleet):
    router = physics_and_a_router(fleet, *LIVE, "--duration", "20")
    fleet.host("--without", "worker_01", agents=TOY)
    fleet.host("--only", "worker_01", agents="calling_agents:steady")
    until(fleet.client().hear("orchard/worker_01/pose"), is_at(0.5))
    router.kill()
    fleet.router(fleet.endpoint)
    until(fleet.client().hear("orchard/worker_01/pose"), is_at(0.5))
    fleet.end()


def test_physics_that_is_killed_behind_a_router_of_its_own_goes_on_to_the_same_hash(fleet, undisturbed, tmp_path):
    keeping = ("--snapshots", str(tmp_path / "snapshots"), "--snapshot-every", "0.2")
    physics_and_a_router(fleet, *PACE, *keeping)
    fleet.share(2, TOY)
    until(fleet.client().hear("orchard/clock"), lambda message: message["tick"] >= 40)
    fleet.world.kill()
    fleet.physics(SMALL, *PACE, *keeping, "--resume", "--run", fleet.run, "--connect", fleet.endpoint)
    assert fleet.end() == undisturbed
