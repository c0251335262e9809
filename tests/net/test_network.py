"""Real links break and mend, and lockstep goes on with the hash of local mode. `tests/chaos/test_schedules.py`: simulated ones."""

import time

import pytest
from fleet import until
from local_runs import SMALL, TICKS, TOY
from machines import machines, needs_machines, slowed, unplugged, within

from chaos.relay import Relay
from orchard.launch.supervisor import free_port

pytestmark = pytest.mark.processes

PACE = ("--speed", "5", "--duration", str(TICKS / 10))  # slow enough that a fault meets the run where it shall
PORT = 7447
DOWN = 5.0  # s, for which links are down
MIDDLE = [f"tcp/192.168.{n}.10:{PORT}" for n in (1, 2, 3)]  # the router, as each guest finds it


# -- links


@needs_machines
def test_links_that_are_down_for_five_seconds_change_nothing(fleet, undisturbed):
    """First that of a third of the agents, then that of physics; each time the sessions are given up and opened again."""
    with machines("a", "b", "c") as (middle, *guests):
        fleet.router(f"tcp/0.0.0.0:{PORT}", before=within(middle))
        fleet.physics(SMALL, *PACE, "--connect", MIDDLE[0], before=within(guests[0]))
        for n, guest in enumerate(guests):
            fleet.host("--share", f"{n}/3", agents=TOY, endpoint=MIDDLE[n], before=within(guest))
        clock = fleet.hear("orchard/clock", f"tcp/127.0.0.1:{PORT}", before=within(middle))
        for tick, guest in ((20, 2), (60, 1)):
            until(clock, lambda message, tick=tick: message["tick"] >= tick)
            with unplugged(middle, guest):
                time.sleep(DOWN)
                assert clock.qsize() < 10 * DOWN, "five times as many would have come"
        assert fleet.end() == undisturbed


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
