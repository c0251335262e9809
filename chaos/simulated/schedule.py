"""One schedule: it carries out a plan, which is a run with its faults.

It does what people do, too: it starts run.py, continues a run whose run.py was killed, and looks
whether what must hold at each moment holds. trial.py lets verdict.py judge it at the end.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, TypeVar

from chaos.simulated.bare_client import NAMES
from chaos.simulated.clients import RUN, Client, let_act
from chaos.simulated.damage import put_foreign, tear_newest, whole_snapshots
from chaos.simulated.harvest import harvest_of
from chaos.simulated.launcher import Launcher
from chaos.simulated.link import DOWN, UP
from chaos.simulated.lost import faults_of_lost
from chaos.simulated.network import Network
from chaos.simulated.observer import Observer
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan, leave_limit
from chaos.simulated.processes import (
    KILLED,
    SimulatedProcess,
    SimulatedSupervisor,
    World,
    spec_of_bare_client,
)
from chaos.simulated.progress import Progress
from chaos.simulated.scheduler import Scheduler, Task, VirtualInbox
from chaos.simulated.tables import grown
from orchard.field.geometry import STILL
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.fork.forked import forked
from orchard.launch.hosts import start_hosts
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest, agent_names
from orchard.net.endpoints import BusError
from orchard.server.snapshots import last
from orchard.sim.engine import Engine
from orchard.sim.snapshot import Snapshot, as_file, store
from orchard.wire.keys import PHYSICS

V = TypeVar("V")  # a verdict
# Clients write nothing, so they need no executor.
NO_EXECUTOR = Executor()
# s, virtual, as all times here: that a user takes to continue a run.
USER_SECONDS = 2.0
LOOK_SECONDS = 0.2  # s between two looks at what runs
# Of so many looks one is at the tables of physics and hosts, which grow slowly.
TABLE_LOOKS = 5
# Of a run in realtime: simulated seconds a second.
SPEED = 5.0
# s after which the robots of a silent host stand, in realtime: it is above commands.WATCHDOG.
STAND_SECONDS = 0.8
# Ticks that physics must have gone on by then. It does 40 in this time, if nothing holds it up.
STAND_TICKS = 20
# s within which a tick follows, in realtime: twice the time of a tick.
TICK_SECONDS = 2 * TIME_STEP / SPEED
# Kind of silence -> the directions of a link that it silences.
SILENT_WAYS = {"silence": (UP, DOWN), "silence up": (UP,), "silence down": (DOWN,)}
# Clients that may drive a robot.
MAY_DRIVE = ("lie", "claim", "repeat", "nonsense", "advise")
LIMIT = 300.0  # s within which each schedule ends
# s between two requests to end a run that was reset and has lasted long enough.
QUIT_SECONDS = 2.0
# What a user who forks a run changes: dotted path -> value.
CHANGES: tuple[dict[str, Any], ...] = (
    {"seed": 11},
    {"dispatch": "longest-waiting"},
    {"picking_speed": 0.5},
)


class Inflicted(NamedTuple):
    """A fault that has happened."""

    at: float  # s
    fault: Fault
    part: int  # the index of the part of the run, in `Course.parts`
    tick: int  # that physics had come to


class Schedule:
    """A plan that is carried out."""

    def __init__(self, plan: Plan, folder: Path, is_traced: bool = False) -> None:
        self.plan = plan
        scheduler = Scheduler()
        network = Network(scheduler, str(plan.seed), plan.delays)
        network.is_traced = is_traced
        self.world = World(scheduler, network, Random(f"world {plan.seed}"), folder)
        self.observer = Observer(plan.scene, network.census, lambda: scheduler.now)
        self.world.observer = self.observer
        network.late = plan.late
        network.tears = plan.tears
        # It starts what runs on another machine.
        self.elsewhere = SimulatedSupervisor(self.world)
        self.inflicted: list[Inflicted] = []
        self.snapshots = folder / "snapshots"
        self.tables = folder / "tables"
        self.clients: list[Client] = []
        # The ticks of all snapshots that were torn.
        self.torn: set[int] = set()
        # Whether the run was asked to end, because it was reset and would last too long.
        self.is_quit = False
        self._scenario: dict[str, Any] = plan.scenario
        self.progress = Progress(plan)
        self.complaints: list[str] = []
        self._clients: list[Task] = []
        # s: when the run may be asked to end again.
        self._quit_at = 0.0
        # What was wrong with lost sessions at the last look, and the tick of that look.
        self._lost: set[str] = set()
        self._lost_at = -1
        # How many looks there were.
        self._looks = 0
        # The faults that are still to come, in the order of their ticks.
        self._faults_left = sorted(plan.faults, key=lambda fault: fault.tick)

    def run(self, judge: Callable[["Schedule"], V]) -> V:
        """Carry it out, and judge it while its processes are still there."""
        with self.world.entered():
            if self.plan.has_router:
                self.world.network.start_router(ROUTER)
            begin = None
            if self.plan.begin:
                begin = self._keyframe()
            self._start(begin)
            self._look()
            self._plan_faults()
            while not self._is_over() and self.world.scheduler.step(LIMIT):
                if self._faults_left:
                    self._plan_faults()
            verdict = judge(self)
            for process in list(self.world.processes.values()):
                process.kill()
            for client in self._clients:
                client.kill()
        return verdict

    # -- what people do

    def _start(self, resumed: Snapshot | None = None) -> None:
        """Start run.py, and what runs on another machine. `resumed`: as in `RunRequest`."""
        plan = self.plan
        scenario = Scenario(**self._scenario)
        options = self._options(agent_names(scenario))
        recording = None
        if plan.has_logger:
            recording = self.world.folder / "run.rrd"
        request = RunRequest(options, scenario, recording, self.snapshots, resumed)
        self.run_py = Launcher(self.world, request)
        if plan.has_bare_client:
            self.elsewhere.start(spec_of_bare_client(plan.mode))
        if plan.is_elsewhere:
            credentials = Credentials(options)
            of_bare_client = self._names_of_bare_client
            names = [name for name in agent_names(scenario) if name not in of_bare_client]
            shares = credentials.shares(names, names)
            start_hosts(self.elsewhere, Network.ENDPOINT, shares, credentials)

    @property
    def _names_of_bare_client(self) -> list[str]:
        """The agents of the bare client, if there is one: no host runs them."""
        if self.plan.has_bare_client:
            return [NAMES[self.plan.mode]]
        return []

    def _options(self, names: list[str]) -> HarvestOptions:
        """Return the options of run.py. `names`: all agents."""
        plan = self.plan
        options = HarvestOptions(
            mode=plan.mode,  # type: ignore[arg-type]
            hosts=plan.hosts,
            patience=plan.patience,
            duration=plan.end * TIME_STEP,
            progress="json",
            without=self._names_of_bare_client or None,
        )
        if plan.is_elsewhere:
            options = replace(options, without=names)
        if plan.mode == "realtime":
            options = replace(options, speed=SPEED)
        if plan.has_router:
            options = replace(options, connect=Network.ENDPOINT)
        if plan.has_tables:
            options = replace(options, table=self.tables)
        return options

    def _keyframe(self) -> Snapshot:
        """Return the keyframe with which it begins, and keep it where physics looks for it."""
        begin = harvest_of(self.plan.scene).snapshot(self.plan.begin)
        self._put(begin)
        return begin

    def _put(self, begin: Snapshot) -> None:
        """Keep a snapshot as the only one of the run."""
        begin.run = RUN
        name, content = as_file(begin)
        self.world.stamp(store(name, content, self.snapshots, RUN))
        self.world.kept = [begin.tick]
        self.world.torn = set()

    def _look(self) -> None:
        """Start again what has died elsewhere, and look how far the run is."""
        if self.run_py.code is None and self.over_at is None:
            self.elsewhere.watch()
            self.progress.look(self.world)
            if self._looks % TABLE_LOOKS == 0:
                self._look_at_tables()
            self._look_at_lost()
            self._end_after_a_reset()
        self._looks += 1
        self.world.scheduler.after(LOOK_SECONDS, self._look)

    def _look_at_tables(self) -> None:
        """Complain about a table of physics, or of a host that runs, that has grown."""
        if self.world.engine is None or self.complaints:
            return
        agents = len(self.world.engine.layout.agents)
        owners: list[Any] = [self.world.loop]
        for process in self.world.processes.values():
            if process.code is None and process.hosts:
                owners.append(process.hosts[-1])
        for owner in owners:
            self.complaints += grown(owner, agents, self.plan.mode)

    def _look_at_lost(self) -> None:
        """Complain about what is wrong with lost sessions at two looks, and between them.

        The ticks of the looks are two or more apart: within a tick a session may be half lost.
        """
        loop = self.world.loop
        plan = self.plan
        if loop is None or plan.mode != "lockstep" or plan.has(*MAY_DRIVE) or self.complaints:
            return
        found: set[str] = set()
        if loop.run.has_begun:
            found = set(faults_of_lost(loop))
        tick = loop.run.engine.tick
        if tick > self._lost_at + 1:
            self.complaints += sorted(found & self._lost)
            self._lost = found
            self._lost_at = tick
        else:
            self._lost &= found

    def _end_after_a_reset(self) -> None:
        """End a run that was reset, when it has lasted as long as the plan says.

        Its duration counts from the first tick of the harvest, so it would last much longer.
        """
        now = self.world.scheduler.now
        is_late = self._is_reset and self._tick >= self.plan.ticks
        if self.plan.begin and is_late and now >= self._quit_at:
            self.is_quit = True
            self._quit_at = now + QUIT_SECONDS
            self._connect_client(Fault("quit", CLIENT, self._tick))

    @property
    def _is_reset(self) -> bool:
        """Whether the present part of the run began with its first tick, and not with a
        keyframe.
        """
        return bool(self.world.resets) and self.observer.course.is_reset

    @property
    def over_at(self) -> float | None:
        """When the run was over, s."""
        return self.run_py.over_at

    def _is_over(self) -> bool:
        """Whether run.py has ended, and what runs elsewhere too, or had the time for it."""
        if self.run_py.code in (None, KILLED) or self.over_at is None:
            return False
        is_time_over = self.world.scheduler.now > self.over_at + leave_limit(self.plan)
        return is_time_over or not self.elsewhere.is_any_left()

    def _kill_run_py(self, fault: Fault) -> None:
        """Kill run.py. The fault is noted when its run can go on."""
        if self.run_py.code is None:
            self.run_py.kill()
            self._go_on(fault)

    def _go_on(self, fault: Fault) -> None:
        """Continue the run whose run.py was killed, as soon as all processes have ended."""
        if any(process.code is None for process in self.world.processes.values()):
            self.world.scheduler.after(LOOK_SECONDS, partial(self._go_on, fault))
        else:
            self._note(fault)
            go_on = self._resume
            if fault.what == "fork":
                go_on = self._fork
            self.world.scheduler.after(USER_SECONDS, go_on)

    def _resume(self) -> None:
        """Let the run go on from its newest snapshot."""
        self._start(last(self.snapshots, RUN))

    def _fork(self) -> None:
        """Let the run go on with something changed, from its newest snapshot."""
        newest = last(self.snapshots, RUN)
        if newest is None:
            self._start()
            return
        random = self.world.random
        try:
            # A robot stands from then on, or none does.
            fork = forked(newest, random.choice(CHANGES), random.choice((["picker_01"], [])))
        except ScenarioError:
            # It may be too late for another policy; it never is for another seed.
            fork = forked(newest, CHANGES[0])
        self.snapshots = self.world.folder / f"snapshots of a fork at {self.world.scheduler.now}"
        self.tables = self.world.folder / f"tables of a fork at {self.world.scheduler.now}"
        self._scenario = fork.scenario
        self._put(fork)
        self.observer.course.fork(fork)
        self.progress.forget()
        self._start(fork)

    # -- faults

    @property
    def _tick(self) -> int:
        """The tick that physics has come to, from the beginning of the schedule, or from a reset.

        -1: it has not begun.
        """
        if self.world.engine is None:
            return -1
        if self._is_reset:
            return self.world.engine.tick
        return self.world.engine.tick - self.plan.begin

    def _note(self, fault: Fault) -> None:
        """Note that a fault has happened."""
        tick = self.plan.begin
        if self.world.engine is not None:
            tick = self.world.engine.tick
        part = len(self.observer.course.parts) - 1
        self.inflicted.append(Inflicted(self.world.scheduler.now, fault, part, tick))

    def _plan_faults(self) -> None:
        """Let each fault whose tick has come happen after its delay."""
        while self._faults_left and self._faults_left[0].tick <= self._tick:
            fault = self._faults_left.pop(0)
            self.world.scheduler.after(fault.delay, partial(self._prepare, fault))

    def _prepare(self, fault: Fault) -> None:
        """Let a fault happen now, or when its process has sent so many messages."""
        if fault.message:
            act = partial(self._inflict, fault)
            is_host = fault.who != PHYSICS
            self.world.network.after_messages(fault.who, fault.message, act, only_queries=is_host)
        else:
            self._inflict(fault)

    def _inflict(self, fault: Fault) -> None:
        """Let a fault happen."""
        self._note(fault)
        self.world.network.trace(f"fault: {fault}")
        if fault.who == RUN_PY:
            self._kill_run_py(fault)
        elif fault.who == CLIENT:
            self._connect_client(fault)
        elif fault.who == ROUTER:
            self._kill_router(fault)
        else:
            process = self.world.process(fault.who)
            if process is not None:
                self._hurt(fault, process)

    def _kill_router(self, fault: Fault) -> None:
        """Kill the router of its own, and start it again after a second or more."""
        network = self.world.network
        if network.has_router:
            network.end_router(ROUTER, self.world.random.random())
            self.world.scheduler.after(
                max(1.0, fault.seconds), partial(network.start_router, ROUTER)
            )

    def _hurt(self, fault: Fault, process: SimulatedProcess) -> None:
        """Let a fault happen to a process of the run."""
        network = self.world.network
        match fault.what:
            case "kill":
                process.kill()
            case "vanish":
                # Its machine has lost its power: the router does not hear that it is gone.
                network.silence(fault.who, fault.seconds)
                process.kill()
            case "freeze":
                process.freeze()
                self._thaw_later(fault, process)
            case "think":
                process.think()
                self._thaw_later(fault, process)
            case "cut":
                network.cut(fault.who, fault.seconds)
            case "silence" | "silence up" | "silence down":
                network.silence(fault.who, fault.seconds, SILENT_WAYS[fault.what])
            case "full disk":
                self.world.is_disk_full = True
                self.world.scheduler.after(fault.seconds, self._empty_disk)
            case "torn snapshot":
                self._tear()
                process.kill()
            case "foreign snapshot":
                put_foreign(self.world, self.snapshots, self.plan.scene)
                process.kill()

    def _thaw_later(self, fault: Fault, process: SimulatedProcess) -> None:
        """Let a process go on after a fault, and look whether its robots stand meanwhile."""
        self.world.scheduler.after(fault.seconds, process.thaw)
        stands_after = STAND_SECONDS + self.plan.delays.slow
        # A shorter fault is over before the looks.
        is_long = fault.seconds > stands_after + TICK_SECONDS
        # A client that lies in the name of a host drives the host's robots.
        if is_long and self.plan.mode == "realtime" and not self.plan.has("lie"):
            tick = 0
            if self.world.engine is not None:
                tick = self.world.engine.tick
            self.world.scheduler.after(stands_after, partial(self._look_at_robots, process, tick))

    def _connect_client(self, fault: Fault) -> None:
        """Start a client, which does what the fault says."""
        name = f"client_{len(self._clients) + 1}"
        inbox = VirtualInbox(self.world.scheduler)

        def body() -> None:
            with (
                suppress(BusError),
                self.world.network.client_session(name, task, inbox, NO_EXECUTOR) as bus,
            ):
                client = Client(bus, Random(f"{name} {self.plan.seed}"), fault.seconds)
                self.clients.append(client)
                let_act(fault.what, client)

        task = self.world.scheduler.spawn(name, body)
        inbox.read_by(task)
        self._clients.append(task)

    def _empty_disk(self) -> None:
        """End the fault "full disk"."""
        self.world.is_disk_full = False

    def _look_at_robots(self, process: SimulatedProcess, tick: int) -> None:
        """Look at the robots of a silent host a tick later, if the run has gone on.

        `tick`: that of the beginning of its silence. In realtime its robots must stand by then.
        """
        engine = self.world.engine
        if engine is not None and engine.tick > tick + STAND_TICKS:
            look_again = partial(self._look_again, process, engine, engine.tick)
            self.world.scheduler.after(TICK_SECONDS, look_again)

    def _look_again(self, process: SimulatedProcess, engine: Engine, tick: int) -> None:
        """Complain about a robot of a silent host that drives.

        If no tick has followed, the run does not go on: physics was killed or frozen, or has ended.
        """
        if not process.is_stopped or engine.tick <= tick:
            return
        for name in process.spec.agents:
            if name in engine.actions and engine.actions[name].twist != STILL:
                self.complaints.append(f"{name} drives on, though its host is silent")
                return

    def _tear(self) -> None:
        """Tear the newest snapshot.

        If no other one is whole, physics begins the run anew, from its first tick. So the last
        whole one is torn only if the run has begun there, and not from a keyframe or a reset.
        """
        has_begun_there = not self.plan.begin and not self.world.resets
        if has_begun_there or len(whole_snapshots(self.world)) > 1:
            self.torn |= tear_newest(self.world, self.snapshots)

    # -- what may be expected

    def has_just_suffered(self, seconds: float) -> bool:
        """Whether a fault has happened, or ended, in so many seconds before the end of the run."""
        over_at = self.over_at
        if over_at is None:
            over_at = self.world.scheduler.now
        for inflicted in self.inflicted:
            ended_at = inflicted.at
            if inflicted.fault.who != CLIENT:
                ended_at += inflicted.fault.seconds
            if ended_at + seconds >= over_at:
                return True
        return False
