"""Real links break and mend, and lockstep goes on with the hash of local mode. `tests/chaos/test_schedules.py`: simulated ones."""

import queue

import pytest
from fleet import until
from local_runs import SMALL, TICKS, TOY
from machines import machines, needs_machines, slowed, unplugged, within

pytestmark = pytest.mark.processes

PACE = ("--speed", "5", "--duration", str(TICKS / 10))  # slow enough that a fault meets the run where it shall
PORT = 7447
DOWN = 5.0  # s, for which links are down
MIDDLE = [f"tcp/192.168.{n}.10:{PORT}" for n in (1, 2, 3)]  # the router, as each guest finds it


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
            with unplugged(middle, guest), pytest.raises(queue.Empty):
                until(clock, lambda message, tick=tick: message["tick"] >= tick + 10 * DOWN, DOWN)  # five times as many would have come
        assert fleet.end() == undisturbed


@needs_machines
def test_a_slow_link_changes_nothing(fleet, undisturbed):
    with machines("a") as (host, guest):
        slowed(host, 1, "rate", "8mbit", "burst", "16kb", "latency", "200ms")
        fleet.physics(SMALL, *PACE, "--listen", f"tcp/0.0.0.0:{PORT}", before=within(host))
        fleet.host("--share", "0/2", agents=TOY, endpoint=f"tcp/127.0.0.1:{PORT}", before=within(host))
        fleet.host("--share", "1/2", agents=TOY, endpoint=MIDDLE[0], before=within(guest))
        assert fleet.end() == undisturbed
