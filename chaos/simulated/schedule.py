"""One schedule: a run, and its faults by a seed. `chaos.simulated.trial` judges it."""

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, TypeVar

from chaos.simulated.bare_client import NAMES
from chaos.simulated.clients import RUN, Client, let_act
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
from orchard.sim.snapshot import SNAPSHOT, Snapshot, as_file, store
from orchard.wire.keys import PHYSICS

V = TypeVar("V")  # a verdict
NO_EXECUTOR = Executor()  # of clients, which write nothing
USER_SECONDS = 2.0  # that a user takes to continue a run
LOOK_SECONDS = 0.2  # between two looks at what runs
TABLE_LOOKS = 5  # looks of which one is at the tables of physics and hosts, which grow slowly
SPEED = 5.0  # of a realtime run: simulated seconds a second
STAND_TICKS = 20
SILENT_WAYS = {"silence": (UP, DOWN), "silence up": (UP,), "silence down": (DOWN,)}
STAND_SECONDS = 0.8  # after which the robots of a silent host stand, in realtime
TICK_SECONDS = 2 * TIME_STEP / SPEED  # within which a tick follows, in realtime
MAY_DRIVE = "lie", "claim", "repeat", "nonsense", "advise"  # clients that may drive a robot
LIMIT = 300.0  # s of virtual time within which each schedule ends
QUIT_SECONDS = 2.0  # between two requests to end a run that was reset and has lasted long enough
# what a user changes who forks a run: dotted path -> value
CHANGES: tuple[dict[str, Any], ...] = (
    {"seed": 11},
    {"dispatch": "longest-waiting"},
    {"picking_speed": 0.5},
)


class Inflicted(NamedTuple):
    """A fault that has happened."""

    at: float  # s
    fault: Fault
    part: int  # of the run, see `Course`
    tick: int


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
        self.elsewhere = SimulatedSupervisor(self.world)  # of another machine
        self.inflicted: list[Inflicted] = []
        self.snapshots = folder / "snapshots"
        self.tables = folder / "tables"
        self.clients: list[Client] = []
        self.torn: set[int] = set()  # the ticks of all snapshots that were torn
        self.is_quit = False  # whether it was asked to end, because it was reset
        self._scenario: dict[str, Any] = plan.scenario
        self.progress = Progress(plan)
        self.complaints: list[str] = []
        self._clients: list[Task] = []
        self._quit_at = 0.0  # s: when it may be asked to end again
        self._lost: set[str] = set()  # what was wrong at the last look, after a session was lost
        self._lost_at = -1  # the tick of that look
        self._looks = 0
        self._faults_left = sorted(plan.faults, key=lambda fault: fault.tick)

    def run(self, judge: Callable[["Schedule"], V]) -> V:
        """Carry it out, and judge it while its processes are still there."""
        with self.world.entered():
            if self.plan.has_router:
                self.world.network.start_router(ROUTER)
            self._start(self._keyframe() if self.plan.begin else None)
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
        """Start run.py, and what runs on another machine."""
        plan = self.plan
        folder = self.world.folder
        scenario = Scenario(**self._scenario)
        names = agent_names(scenario)
        left = [NAMES[plan.mode]] * plan.has_bare_client
        options = HarvestOptions(
            mode=plan.mode,  # type: ignore[arg-type]
            speed=SPEED if plan.mode == "realtime" else None,
            hosts=plan.hosts,
            patience=plan.patience,
            duration=plan.end * TIME_STEP,
            progress="json",
            connect=Network.ENDPOINT if plan.has_router else None,
            without=names if plan.is_elsewhere else left or None,
            table=self.tables if plan.has_tables else None,
        )
        recording = folder / "run.rrd" if plan.has_logger else None
        self.run_py = Launcher(
            self.world,
            RunRequest(options, scenario, recording, self.snapshots, resumed),
        )
        if plan.has_bare_client:
            self.elsewhere.start(spec_of_bare_client(plan.mode))
        if plan.is_elsewhere:
            credentials = Credentials(options)
            names = [name for name in names if name not in left]
            start_hosts(
                self.elsewhere, Network.ENDPOINT, credentials.shares(names, names), credentials
            )

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
        """No table of physics or of a host that runs has grown."""
        if self.world.engine is not None and not self.complaints:
            hosts = [
                process.hosts[-1]
                for process in self.world.processes.values()
                if process.code is None and process.hosts
            ]
            agents = len(self.world.engine.layout.agents)
            self.complaints += [
                line
                for owner in (self.world.loop, *hosts)
                for line in grown(owner, agents, self.plan.mode)
            ]

    def _look_at_lost(self) -> None:
        """No session is lost by half, and no robot drives without one, for two looks of different
        ticks.
        """
        loop = self.world.loop
        plan = self.plan
        if loop is None or plan.mode != "lockstep" or plan.has(*MAY_DRIVE) or self.complaints:
            return
        found = set(faults_of_lost(loop)) if loop.run.has_begun else set()
        tick = loop.run.engine.tick
        if tick > self._lost_at + 1:
            self.complaints += sorted(found & self._lost)
            self._lost = found
            self._lost_at = tick
        else:
            self._lost &= found

    def _end_after_a_reset(self) -> None:
        """Let the run end that was reset, and has lasted as long as it would have without: its
        duration is that of a harvest.
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
        """Whether run.py has ended, and also what runs elsewhere, or that had the time for it."""
        if self.run_py.code in (None, KILLED) or self.over_at is None:
            return False
        return (
            not self.elsewhere.is_any_left()
            or self.world.scheduler.now > self.over_at + leave_limit(self.plan)
        )

    def _kill_run_py(self, fault: Fault) -> None:
        if self.run_py.code is None:
            self.run_py.kill()
            self._go_on(fault)

    def _go_on(self, fault: Fault) -> None:
        """Continue the run whose run.py was killed, as soon as all processes have ended."""
        if any(process.code is None for process in self.world.processes.values()):
            self.world.scheduler.after(LOOK_SECONDS, partial(self._go_on, fault))
        else:
            self._note(fault)
            go_on = self._fork if fault.what == "fork" else self._resume
            self.world.scheduler.after(USER_SECONDS, go_on)

    def _resume(self) -> None:
        self._start(last(self.snapshots, RUN))

    def _fork(self) -> None:
        """Let the run go on with something changed, from its newest snapshot."""
        newest = last(self.snapshots, RUN)
        if newest is None:
            self._start()
            return
        random = self.world.random
        try:
            fork = forked(newest, random.choice(CHANGES), random.choice((["picker_01"], [])))
        except ScenarioError:  # another policy may come too late
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
        """The tick that physics has come to, from the begin of the schedule, or from a reset; -1
        before the first one.
        """
        if self.world.engine is None:
            return -1
        return self.world.engine.tick - (0 if self._is_reset else self.plan.begin)

    def _note(self, fault: Fault) -> None:
        """Know that a fault has happened."""
        tick = self.plan.begin if self.world.engine is None else self.world.engine.tick
        part = len(self.observer.course.parts) - 1
        self.inflicted.append(Inflicted(self.world.scheduler.now, fault, part, tick))

    def _plan_faults(self) -> None:
        """Let each fault whose tick has come happen after its delay."""
        while self._faults_left and self._faults_left[0].tick <= self._tick:
            fault = self._faults_left.pop(0)
            self.world.scheduler.after(fault.delay, partial(self._prepare, fault))

    def _prepare(self, fault: Fault) -> None:
        if fault.message:
            self.world.network.after_messages(
                fault.who, fault.message, partial(self._inflict, fault), fault.who != PHYSICS
            )
        else:
            self._inflict(fault)

    def _inflict(self, fault: Fault) -> None:
        self._note(fault)
        self.world.network.trace(f"fault: {fault}")
        if fault.who == RUN_PY:
            self._kill_run_py(fault)
        elif fault.who == CLIENT:
            self._connect_client(fault)
        elif fault.who == ROUTER:
            self._kill_router(fault)
        elif (process := self.world.process(fault.who)) is not None:
            self._hurt(fault, process)

    def _kill_router(self, fault: Fault) -> None:
        network = self.world.network
        if network.has_router:
            network.end_router(ROUTER, self.world.random.random())
            self.world.scheduler.after(
                max(1.0, fault.seconds), partial(network.start_router, ROUTER)
            )

    def _hurt(self, fault: Fault, process: SimulatedProcess) -> None:
        network = self.world.network
        match fault.what:
            case "kill":
                process.kill()
            case "vanish":  # with its machine: the router does not hear that it is gone
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
                self._put_foreign()
                process.kill()

    def _thaw_later(self, fault: Fault, process: SimulatedProcess) -> None:
        """Let a process go on after a fault, and look whether its robots stand meanwhile."""
        self.world.scheduler.after(fault.seconds, process.thaw)
        stands_after = STAND_SECONDS + self.plan.delays.slow
        # After a short fault the next one may stop the process, which has a look of its own.
        is_long = fault.seconds > stands_after + TICK_SECONDS
        # A client that lies in the name of a host drives the host's robots.
        if is_long and self.plan.mode == "realtime" and not self.plan.has("lie"):
            tick = 0 if self.world.engine is None else self.world.engine.tick
            self.world.scheduler.after(stands_after, partial(self._look_at_robots, process, tick))

    def _connect_client(self, fault: Fault) -> None:
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
        self.world.is_disk_full = False

    def _look_at_robots(self, process: SimulatedProcess, tick: int) -> None:
        """In realtime, the robots of a host that has not answered since a tick stand in the next
        tick.
        """
        if (engine := self.world.engine) is not None and engine.tick > tick + STAND_TICKS:
            self.world.scheduler.after(
                TICK_SECONDS, partial(self._look_again, process, engine, engine.tick)
            )

    def _look_again(self, process: SimulatedProcess, engine: Engine, tick: int) -> None:
        """Where no tick has followed, the run does not go on: physics is killed or frozen, or has
        ended.
        """
        if process.is_stopped and engine.tick > tick:
            moving = [
                name
                for name in process.spec.agents
                if name in engine.actions and engine.actions[name].twist != STILL
            ]
            self.complaints += [
                f"{name} drives on, though its host is silent" for name in moving[:1]
            ]

    def _tear(self) -> None:
        """Tear the newest snapshot.

        If no other one is whole the run begins anew, as it was first: only where it has done so.
        """
        files = sorted(self.snapshots.glob(f"tick-*{SNAPSHOT}"))
        # The snapshot of a first tick, also that of a reset, outdates all others.
        kept = self.world.kept
        since = len(kept) - 1 - kept[::-1].index(0) if 0 in kept else 0
        whole = {tick for tick in kept[since:] if tick not in self.world.torn}
        has_begun_there = not self.plan.begin and not self.world.resets
        if files and (len(whole) > 1 or has_begun_there):
            content = files[-1].read_bytes()
            files[-1].write_bytes(content[: self.world.random.randrange(len(content))])
            self.world.stamp(files[-1])
            tick = int(files[-1].stem.removeprefix("tick-"))
            self.world.torn.add(tick)
            self.torn.add(tick)

    def _put_foreign(self) -> None:
        """Put a later snapshot of another run into the folder, as a user may who copies files."""
        harvest = harvest_of(self.plan.scene)
        foreign = harvest.snapshot(max(harvest.keyframes))
        foreign.run = "another"
        name, content = as_file(foreign)
        self.snapshots.mkdir(exist_ok=True)
        (self.snapshots / name).write_bytes(content)
        self.world.stamp(self.snapshots / name)

    # -- what may be expected

    def has_just_suffered(self, seconds: float) -> bool:
        """Whether a fault has lasted into so many seconds before the end of the run."""
        over_at = self.world.scheduler.now if self.over_at is None else self.over_at
        return any(
            one.at + seconds + (one.fault.seconds if one.fault.who != CLIENT else 0.0) >= over_at
            for one in self.inflicted
        )
