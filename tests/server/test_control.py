"""A run that is paused, stepped and played; and what arrives within a tick.

A client that may control a run sets its state (`set_simulation_state`), lets it do some steps while
it is paused (`step_simulation`), or lets it begin again (`reset_simulation`). A run that has not
begun, because agents are missing, is `stopped`.
"""

import time

import calling_agents
import msgpack
import pyarrow.parquet as pq
import pytest
from fleet import wait_for
from local_runs import SMALL, TICKS, TOY
from patience import PATIENCE
from recorded_messages import KEYS, RUN, Clock, Run, roster

from orchard.contract.messages import pack
from orchard.field.layout import lay_out
from orchard.field.scenario import with_changes
from orchard.local import Local
from orchard.net.bus import Inbox, Sample
from orchard.server.barriers import LockstepBarrier
from orchard.server.control import Pacer, RunClock
from orchard.server.loop import RunLoop
from orchard.server.options import RunOptions
from orchard.sim.engine import Engine
from orchard.tables.tables import Tables
from orchard.wire.messages import Angular, Linear, Odometry, Velocity, read

# The small orchard with errors of sensors, so that another seed gives another run.
ERRING = with_changes(
    SMALL,
    **{"sensors.gnss.white": 0.01, "sensors.gnss.bias": 0.02, "sensors.odometry.heading": 0.01},
)


def test_the_clock_stands_while_the_run_is_paused():
    """A pause of 50 s between 1 s and 2 s of playing is not counted. A second pause changes
    nothing.
    """
    wall = Clock()
    clock = RunClock(wall)
    begun = clock()
    wall.now += 1.0
    clock.pause()
    wall.now += 50.0
    assert clock() - begun == 1.0
    assert clock.is_paused
    clock.pause()
    clock.play()
    wall.now += 2.0
    assert clock() - begun == 3.0
    assert not clock.is_paused


def test_the_clock_stands_again_after_so_many_steps():
    clock = RunClock(Clock())
    clock.pause()
    clock.play(2)
    states = []
    for _ in range(3):
        states.append(clock.is_paused)
        clock.count_step()
    assert states == [False, False, True]


def test_a_pause_makes_no_agent_late_and_no_tick():
    """An agent may take 15 s to answer, and the next tick is due after 0.1 s. A pause of 100 s
    takes nothing of either.
    """
    wall = Clock()
    clock = RunClock(wall)
    barrier = LockstepBarrier(roster(("picker_01", "a")), clock)
    pacer = Pacer(1.0, clock)
    barrier.open(0)
    pacer.begin()
    clock.pause()
    wall.now += 100.0
    assert barrier.deadline - clock() == pytest.approx(15.0)
    clock.play()
    assert pacer.wait() == pytest.approx(0.1)


class Late(Inbox):
    """An inbox at which a velocity arrives while physics waits until the next tick is due.

    Waiting takes virtual time. The velocity comes once, at tick `tick` or later.
    """

    def __init__(self, engine: Engine, tick: int, clock: Clock) -> None:
        super().__init__()
        self._engine = engine
        self._from = tick
        self._clock = clock
        # The tick at which the velocity came; -1: it has not come.
        self.at = -1

    def take(self, seconds: float = 0.0, enough: int = 1):
        tick = self._engine.tick
        if self.at < 0 and tick >= self._from and seconds > 0.0:
            self.at = tick
            return Sample(
                KEYS.of("velocity", "picker_01"),
                pack(Velocity(RUN, tick, Linear(0.5), Angular(0.0))),
            )
        self._clock.now += seconds
        return super().take(0.0, enough)


@pytest.mark.parametrize("mode", ["realtime", "lockstep"])
def test_a_velocity_before_the_next_due_tick_counts_in_this(mode):
    """No session owns an agent. So the step of a tick is done at once, and physics waits until the
    next tick is due: the velocity that comes meanwhile drives from the next pose on.
    """
    run = Run(SMALL, RUN, 20)
    bus = run.physics.bus
    engine = Engine.begin(SMALL)
    bus.clock = Clock()
    names = list(engine.layout.agents)
    physics = RunLoop(
        bus, KEYS, engine, RunOptions(run=RUN, mode=mode, speed=4.0, duration=2.0, absent=names)
    )
    bus.inbox = Late(engine, 3, bus.clock)
    poses = {}

    def see(key: str, payload: bytes) -> None:
        if key == KEYS.of("pose", "picker_01"):
            pose = read(payload, Odometry)
            poses[pose.tick] = pose.twist.linear.x

    run.net.on_put = see
    physics.play(lambda: None)
    assert poses[bus.inbox.at] == 0.0
    assert poses[bus.inbox.at + 1] == 0.5


def asked(someone, what: str, **fields):
    """Let a client ask physics for something. Return the tick and the state of the run after it.

    A question without fields has an empty payload, as docs/protocol.md wants it.
    """
    payload = b""
    if fields:
        payload = msgpack.packb({"run": someone.run} | fields)
    (reply,) = someone.ask(f"orchard/{what}", payload)
    return reply["tick"], reply["state"]


def test_a_run_is_paused_before_it_begins_stepped_and_played(fleet, undisturbed):
    fleet.physics(SMALL, "--duration", str(TICKS / 10))
    someone = fleet.client()
    clock = someone.hear("orchard/clock")
    assert asked(someone, "simulation_state") == (0, "stopped")
    assert asked(someone, "set_simulation_state", state="paused") == (0, "paused")
    fleet.share(2, TOY)
    for _ in range(3):
        assert wait_for(clock, lambda message: True)["tick"] == 0, (
            "it stands, and is told again and again"
        )
    for n in (1, 2, 10):
        tick, state = asked(someone, "step_simulation", steps=n)
        assert state == "paused"
    steps_done = 1 + 2 + 10
    assert tick == steps_done
    assert asked(someone, "simulation_state") == (steps_done, "paused")
    assert asked(someone, "set_simulation_state", state="playing") == (steps_done, "playing")
    assert fleet.end() == undisturbed


def test_a_run_that_plays_does_no_single_steps(fleet):
    """It waits for its agents at tick 0, and would play at once: so it is refused to step."""
    fleet.physics(SMALL, "--duration", "3")
    someone = fleet.client()
    ends = someone.hear("orchard/end")
    assert asked(someone, "set_simulation_state", state="playing") == (0, "stopped")
    (error,) = someone.ask(
        "orchard/step_simulation", msgpack.packb({"run": someone.run, "steps": 3})
    )
    assert "not paused" in error
    fleet.share(1)
    fleet.end()
    end = ends.get()
    assert end["tick"] == 30
    assert end["summary"]["messages_refused"] == {"not paused": 1}


@pytest.mark.parametrize("state", ["paused", "playing"])
def test_quitting_ends_a_run_also_while_it_is_paused(fleet, state):
    fleet.physics(SMALL)
    someone = fleet.client()
    ends = someone.hear("orchard/end")
    clock = someone.hear("orchard/clock")
    fleet.share(1)
    wait_for(clock, lambda message: message["tick"] >= 4)
    tick, now = asked(someone, "set_simulation_state", state=state)
    assert now == state
    assert asked(someone, "set_simulation_state", state="quitting")[1] == "quitting"
    fleet.end()
    end = ends.get()
    assert end["why"] == "stopped"
    if state == "paused":
        assert end["tick"] == tick, "no tick passes"
    else:
        assert end["tick"] > tick


def test_the_end_of_a_run_ends_the_steps_of_a_query(fleet):
    fleet.physics(SMALL, "--duration", "3")
    someone = fleet.client()
    asked(someone, "set_simulation_state", state="paused")
    fleet.share(1)
    assert asked(someone, "step_simulation", steps=1000) == (30, "quitting")
    fleet.end()


def test_an_agent_silent_during_a_pause_is_not_missed(fleet):
    """Physics bears a silence of 0.2 s, and between two clocks of a pause 0.5 s pass.

    The client owns the agent `traffic`, and never answers for it.
    """
    others = []
    for name in lay_out(SMALL).agents:
        if name != "traffic":
            others += ["--absent", name]
    fleet.physics(SMALL, "--patience", "0.2", *others)
    someone = fleet.client()
    clock, lost = (someone.hear(f"orchard/{what}") for what in ("clock", "lost"))
    asked(someone, "set_simulation_state", state="paused")
    deadline = time.monotonic() + PATIENCE
    token = someone.declare("orchard/alive/traffic/silent")
    # Its token may come later.
    while someone.join("traffic", "silent")["refused"]:
        assert time.monotonic() < deadline
    for _ in range(4):
        wait_for(clock, lambda message: message["tick"] == 0)
    assert lost.empty()
    asked(someone, "set_simulation_state", state="playing")
    assert wait_for(lost, lambda message: True)["names"] == ["traffic"]
    someone.quit()
    token.undeclare()
    fleet.end()


@pytest.mark.parametrize("seed", [pytest.param(None, marks=pytest.mark.soak), 7])
def test_a_run_that_is_reset_begins_again(fleet, tmp_path, seed):
    """It is reset after 20 steps, with its own seed (None) or another one.

    Its hash and its tables are then those of a run in local mode: nothing of before is left.
    """
    fleet.physics(ERRING, "--duration", str(TICKS / 10), "--table", str(tmp_path / "reset"))
    someone = fleet.client()
    asked(someone, "set_simulation_state", state="paused")
    alive = someone.tokens("orchard/alive/physics/*/*")
    fleet.share(2, TOY)
    assert asked(someone, "step_simulation", steps=20) == (20, "paused")
    assert asked(someone, "reset_simulation", seed=seed) == (20, "paused")
    wait_for(alive, lambda up: not up)
    wait_for(alive, lambda up: up)
    (info,) = someone.ask("orchard/scenario")
    assert info["run"] == fleet.run
    assert info["tick"] == 0
    assert info["scenario"]["seed"] == ERRING.seed if seed is None else seed
    assert asked(someone, "simulation_state") == (0, "paused")
    asked(someone, "set_simulation_state", state="playing")
    scenario = ERRING if seed is None else ERRING.model_copy(update={"seed": seed})
    lines = [fleet.world.line() for _ in range(2)]
    assert lines[0].startswith("reset: tick 20"), lines
    assert fleet.end() == leave_tables(scenario, tmp_path / "local")
    # The rows of before the reset are gone.
    for name in ("bodies", "events", "messages", "calls", "exchanges"):
        local, after = (
            pq.read_table(tmp_path / folder / f"{name}.parquet") for folder in ("local", "reset")
        )
        assert after.equals(local, check_metadata=True), name


def leave_tables(scenario, folder) -> str:
    """Leave the tables of a run in local mode. Return its hash."""
    local = Local(scenario, calling_agents.cast(lay_out(scenario)))
    tables = Tables(folder, local.engine)
    while local.engine.tick < TICKS:
        events = local.tick()
        tables.update(local.engine, events, local.post.written[local.engine.tick - 1])
    tables.close()
    return local.engine.hash


def test_a_run_that_is_recorded_is_not_reset(fleet):
    fleet.physics(SMALL)
    someone = fleet.client()
    token = someone.declare("orchard/alive/logger/somebody")
    assert asked(someone, "simulation_state") == (0, "stopped")
    (error,) = someone.ask("orchard/reset_simulation", msgpack.packb({"run": someone.run}))
    assert "--record none" in error
    token.undeclare()
    someone.quit()
    fleet.end()
