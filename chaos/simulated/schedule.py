"""One schedule: a run, its faults by a seed, and the verdict on it."""

import tempfile
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random

from chaos.simulated.bare_client import NAMES
from chaos.simulated.clients import RUN, Client, let_act
from chaos.simulated.launcher import Launcher
from chaos.simulated.link import DOWN, UP
from chaos.simulated.network import Network
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan, draw
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
from chaos.simulated.verdict import Verdict, judge, leave_limit
from orchard.field.geometry import STILL
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.distributed import agent_names, start_hosts
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest
from orchard.net.endpoints import BusError
from orchard.server.snapshots import last
from orchard.sim.engine import Engine
from orchard.sim.snapshot import Snapshot
from orchard.wire.keys import PHYSICS

NO_EXECUTOR = Executor()  # of clients, which write nothing
USER_SECONDS = 2.0  # that a user takes to continue a run
LOOK_SECONDS = 0.2  # between two looks at what runs
SPEED = 5.0  # of a realtime run: simulated seconds a second
STAND_TICKS = 20
STAND_SECONDS = 0.8  # after which the robots of a silent host stand, in realtime
TICK_SECONDS = 2 * TIME_STEP / SPEED  # within which a tick follows, in realtime
LIMIT = 300.0  # s of virtual time within which each schedule ends


class Schedule:
    """A plan that is carried out."""

    def __init__(self, plan: Plan, folder: Path, is_traced: bool = False) -> None:
        self.plan = plan
        scheduler = Scheduler()
        network = Network(scheduler, str(plan.seed), plan.delays)
        network.is_traced = is_traced
        self.world = World(scheduler, network, Random(f"world {plan.seed}"), folder)
        network.late = plan.late
        self.elsewhere = SimulatedSupervisor(self.world)  # of another machine
        self.inflicted: list[tuple[float, Fault]] = []  # (s, fault)
        self.progress = Progress(plan)
        self.complaints: list[str] = []
        self._clients: list[Task] = []
        self._faults_left = sorted(plan.faults, key=lambda fault: fault.tick)

    def run(self) -> Verdict:
        """Carry it out, and judge it."""
        with self.world.entered():
            if self.plan.has_router:
                self.world.network.start_router(ROUTER)
            self._start()
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
        plan, folder = self.plan, self.world.folder
        names, left = (
            agent_names(Scenario(**plan.scenario)),
            [NAMES[plan.mode]] * plan.has_bare_client,
        )
        options = HarvestOptions(
            mode=plan.mode,  # type: ignore[arg-type]
            speed=SPEED if plan.mode == "realtime" else None,
            hosts=plan.hosts,
            patience=plan.patience,
            duration=plan.ticks * TIME_STEP,
            progress="json",
            connect=Network.ENDPOINT if plan.has_router else None,
            without=names if plan.is_elsewhere else left or None,
        )
        recording = folder / "run.rrd" if plan.has_logger else None
        self.run_py = Launcher(
            self.world,
            RunRequest(
                options, Scenario(**plan.scenario), recording, folder / "snapshots", resumed
            ),
        )
        if plan.has_bare_client:
            self.elsewhere.start(spec_of_bare_client(plan.mode))
        if plan.is_elsewhere:
            credentials, names = Credentials(options), [name for name in names if name not in left]
            start_hosts(
                self.elsewhere, Network.ENDPOINT, credentials.shares(names, names), credentials
            )

    def _look(self) -> None:
        """Start again what has died elsewhere, and look how far the run is."""
        if self.run_py.code is None and self.over_at is None:
            self.elsewhere.watch()
            self.progress.look(self.world)
            self._look_at_tables()
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
            self.inflicted.append((self.world.scheduler.now, fault))
            self.world.scheduler.after(
                USER_SECONDS, lambda: self._start(last(self.world.folder / "snapshots", RUN))
            )

    # -- faults

    @property
    def _tick(self) -> int:
        """The tick that physics has come to; -1 before the first one."""
        return -1 if self.world.engine is None else self.world.engine.tick

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
        self.inflicted.append((self.world.scheduler.now, fault))
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
            case "freeze" | "think":
                (process.freeze if fault.what == "freeze" else process.think)()
                self.world.scheduler.after(fault.seconds, process.thaw)
                stands_after = STAND_SECONDS + self.plan.delays.slow
                lasts = (
                    fault.seconds > stands_after + TICK_SECONDS
                )  # else the next fault may stop it, which has a look of its own
                if (
                    lasts and self.plan.mode == "realtime" and not self.plan.has("lie")
                ):  # who lies in the name of a host drives its robots
                    self.world.scheduler.after(
                        stands_after, partial(self._look_at_robots, process, self._tick)
                    )
            case "cut":
                network.cut(fault.who, fault.seconds)
            case "silence":
                network.silence(fault.who, fault.seconds)
            case "silence up":
                network.silence(fault.who, fault.seconds, (UP,))
            case "silence down":
                network.silence(fault.who, fault.seconds, (DOWN,))
            case "full disk":
                self.world.is_disk_full = True
                self.world.scheduler.after(fault.seconds, self._empty_disk)
            case "torn snapshot":
                self._tear()
                process.kill()

    def _connect_client(self, fault: Fault) -> None:
        name = f"client_{len(self._clients) + 1}"
        inbox = VirtualInbox(self.world.scheduler)

        def body() -> None:
            with (
                suppress(BusError),
                self.world.network.client_session(name, task, inbox, NO_EXECUTOR) as bus,
            ):
                let_act(fault.what, Client(bus, Random(f"{name} {self.plan.seed}"), fault.seconds))

        task = self.world.scheduler.spawn(name, body)
        inbox.read_by(task)
        self._clients.append(task)

    def _empty_disk(self) -> None:
        self.world.is_disk_full = False

    def _look_at_robots(self, process: SimulatedProcess, tick: int) -> None:
        """In realtime, the robots of a host that has not answered since a tick stand in the next tick."""
        if (engine := self.world.engine) is not None and engine.tick > tick + STAND_TICKS:
            self.world.scheduler.after(
                TICK_SECONDS, partial(self._look_again, process, engine, engine.tick)
            )

    def _look_again(self, process: SimulatedProcess, engine: Engine, tick: int) -> None:
        """Where no tick has followed, the run does not go on: physics is killed or frozen, or has ended."""
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
        files = sorted((self.world.folder / "snapshots").glob("tick-*.snapshot"))
        if files:
            content = files[-1].read_bytes()
            files[-1].write_bytes(content[: self.world.random.randrange(len(content))])

    # -- what may be expected

    def has_just_suffered(self, seconds: float) -> bool:
        """Whether a fault has lasted into so many seconds before the end of the run."""
        over_at = self.world.scheduler.now if self.over_at is None else self.over_at
        return any(
            at + seconds + (fault.seconds if fault.who != CLIENT else 0.0) >= over_at
            for at, fault in self.inflicted
        )


def carry_out(plan: Plan, is_traced: bool = False) -> Verdict:
    """Carry out a plan, in a folder of its own."""
    with tempfile.TemporaryDirectory(
        dir="/dev/shm" if Path("/dev/shm").is_dir() else None
    ) as folder:
        return Schedule(plan, Path(folder), is_traced).run()


def complaints_of(seed: int) -> list[str]:
    """Return what did not hold in the schedule of a seed."""
    return carry_out(draw(seed)).complaints


def shrink(plan: Plan) -> Plan:
    """Return a plan with fewer faults and ticks that fails in the same way."""
    what = _kind_of(carry_out(plan))
    is_smaller = True
    while is_smaller:
        is_smaller = False
        fewer = [
            replace(plan, faults=plan.faults[:at] + plan.faults[at + 1 :])
            for at in range(len(plan.faults))
        ]
        shorter = [replace(plan, ticks=plan.ticks // 2)] if plan.ticks > 10 else []
        for smaller in [*fewer, *shorter]:
            if _kind_of(carry_out(smaller)) == what:
                plan, is_smaller = smaller, True
                break
    return plan


def _kind_of(verdict: Verdict) -> str:
    return verdict.complaints[0].partition(":")[0] if verdict.complaints else ""
