"""One schedule: a run, its faults by a seed, and the verdict on it."""

import tempfile
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random

from chaos.simulated.bare_client import NAMES
from chaos.simulated.clients import KEYS, RUN, Client, let_act
from chaos.simulated.link import DOWN, UP
from chaos.simulated.network import Network
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan, draw
from chaos.simulated.processes import (
    SPEC_OF_LOGGER,
    SimulatedProcess,
    SimulatedSupervisor,
    World,
    spec_of_bare_client,
    spec_of_host,
    spec_of_physics,
)
from chaos.simulated.progress import Progress
from chaos.simulated.scheduler import PassingInbox, Scheduler, Task, VirtualInbox
from chaos.simulated.verdict import LEAVE_LIMIT, Verdict, judge
from orchard.field.geometry import STILL
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.distributed import THINK_SECONDS
from orchard.net.bus import Alive, Item, Sample
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.server.options import RunOptions
from orchard.server.run import read_end
from orchard.wire.keys import LOGGER, PHYSICS
from orchard.wire.messages import RESET, End

NO_EXECUTOR = Executor()  # of clients, which write nothing
USER_SECONDS = 2.0  # that a user takes to continue a run
LOOK_SECONDS = 0.2  # between two looks of run.py at its processes
SPEED = 5.0  # of a realtime run: simulated seconds a second
STAND_TICKS = 20
STAND_SECONDS = 0.8  # after which the robots of a silent host stand, in realtime
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
        self.supervisor = self.elsewhere = SimulatedSupervisor(self.world, "")  # of run.py, and of the machine with the hosts
        self.is_over = False
        self.over_at: float | None = None  # s: when the run was over
        self.inflicted: list[tuple[float, Fault]] = []  # (s, fault)
        self.has_died_after_the_end = False  # physics: its hosts have heard the end, and do not come back
        self.progress = Progress(plan)
        self.complaints: list[str] = []
        self._is_ending = False  # run.py is gone, and its processes end
        self._ended_at: float | None = None  # s: when they had all ended
        self._clients: list[Task] = []
        self._faults_left = sorted(plan.faults, key=lambda fault: fault.tick)

    def run(self) -> Verdict:
        """Carry it out, and judge it."""
        with self.world.entered():
            if self.plan.has_router:
                self.world.network.start_router(ROUTER)
            self._start()
            self.world.scheduler.after(LOOK_SECONDS, self._look)
            self._plan_faults()
            while not self.is_over and self.world.scheduler.step(LIMIT):
                self._plan_faults()
            verdict = judge(self)
            for process in self.world.processes.values():
                process.kill()
            for client in self._clients:
                client.kill()
        return verdict

    # -- what run.py does

    def _start(self, resume: bool = False) -> None:
        plan, folder = self.plan, self.world.folder
        options = RunOptions(
            scenario=Scenario(**plan.scenario).model_dump(),
            run=RUN,
            connect=Network.ENDPOINT if plan.has_router else None,
            mode=plan.mode,  # type: ignore[arg-type]
            speed=SPEED if plan.mode == "realtime" else None,
            patience=plan.patience,
            duration=plan.ticks * TIME_STEP,
            snapshots=str(folder / "snapshots"),
            snapshot_every=0.5,
            result=str(folder / "end"),
            recorded=plan.has_logger,
            resume=resume,
        )
        self._listen()
        names = sorted(set(lay_out(Scenario(**plan.scenario)).agents) - ({NAMES[plan.mode]} if plan.has_bare_client else set()))
        self.supervisor = SimulatedSupervisor(self.world, RUN)
        self.elsewhere = SimulatedSupervisor(self.world, RUN) if plan.is_elsewhere else self.supervisor
        self.supervisor.start(spec_of_physics(options))
        if plan.has_logger:
            self.supervisor.start(SPEC_OF_LOGGER)
        if plan.has_bare_client:
            self.elsewhere.start(spec_of_bare_client(plan.mode))
        for number in range(plan.hosts):
            self.elsewhere.start(spec_of_host(f"agents_{number}", names[number :: plan.hosts]))

    def _listen(self) -> None:
        """Open the session of run.py."""
        network = self.world.network
        for session in [session for session in network.sessions if session.name == RUN_PY]:
            network.end(session)
        self._ending = Ending(lambda: self.world.scheduler.now)
        session = network.open(RUN_PY, PassingInbox(self.world.scheduler, self._hear))
        session.subscribe(KEYS.of("end"))
        session.watch(KEYS.of("alive", PHYSICS, RUN))

    def _look(self) -> None:
        """Restart what has died, until physics is over; then wait for the others."""
        scheduler, supervisor = self.world.scheduler, self.supervisor
        is_any_left = supervisor.is_any_left() or self.elsewhere.is_any_left()
        if self._is_ending:
            if not is_any_left and self._ended_at is None:
                self._ended_at = scheduler.now
            if self._ended_at is not None and scheduler.now >= self._ended_at + USER_SECONDS:
                self._is_ending, self._ended_at = False, None
                self._start(resume=True)
        elif self.over_at is not None:
            if scheduler.now > self.over_at + THINK_SECONDS:
                supervisor.kill(PHYSICS)
            self.is_over = not is_any_left or scheduler.now > self.over_at + LEAVE_LIMIT
        elif supervisor.is_over(PHYSICS) or PHYSICS in supervisor.given_up:
            self._let_go()
        else:
            supervisor.watch()
            self.elsewhere.watch()
            self.progress.look(self.world)
        scheduler.after(LOOK_SECONDS, self._look)

    def _let_go(self) -> None:
        """Let the processes end: the run is over."""
        self.over_at = self.world.scheduler.now
        self.supervisor.terminate(*(name for name in self.supervisor.running if name.startswith("agents")))
        if not self.world.network.has_token(KEYS.of("alive", LOGGER, RUN)):
            self.supervisor.kill(LOGGER)

    def _hear(self, item: Item) -> None:
        """Hear of the end, as run.py does."""
        if isinstance(item, Alive):
            self._ending.track(item.up)
        elif isinstance(item, Sample):
            with suppress(Refused):
                if (end := read_message(item.payload, End, RUN)).why != RESET:
                    self._ending.hear(end)
        is_here = self.over_at is None and not self._is_ending and self.supervisor.exit_code(PHYSICS) is None
        if is_here and self._ending.end is not None:
            self._let_go()

    def _die(self) -> None:
        """End as run.py does by SIGKILL: the lines of all processes close. A moment later, a user continues the run."""
        if not self._is_ending and self.over_at is None and not self.supervisor.is_over(PHYSICS):
            self._is_ending = True
            self.supervisor.terminate(*self.supervisor.running)

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
            self.world.network.after_messages(fault.who, fault.message, partial(self._inflict, fault), fault.who != PHYSICS)
        else:
            self._inflict(fault)

    def _inflict(self, fault: Fault) -> None:
        self.inflicted.append((self.world.scheduler.now, fault))
        self.has_died_after_the_end |= fault.who == PHYSICS and read_end(self.world.folder / "end", RUN) is not None
        self.world.network.trace(f"fault: {fault}")
        if fault.who == RUN_PY:
            self._die()
        elif fault.who == CLIENT:
            self._connect_client(fault)
        elif fault.who == ROUTER:
            self.world.network.end_router(ROUTER, self.world.random.random())
            self.world.scheduler.after(max(1.0, fault.seconds), partial(self.world.network.start_router, ROUTER))
        elif (process := self._process(fault.who)) is not None:
            self._hurt(fault, process)

    def _process(self, name: str) -> SimulatedProcess | None:
        """Return a process, if it runs."""
        running = self.supervisor.running.get(name) or self.elsewhere.running.get(name)
        return None if running is None or running.popen.poll() is not None else running.popen  # type: ignore[return-value]

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
                if self.plan.mode == "realtime":
                    after = partial(self._look_at_robots, process, self._tick)
                    self.world.scheduler.after(STAND_SECONDS + self.plan.delays.slow, after)
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
            with suppress(BusError), self.world.network.client_session(name, task, inbox, NO_EXECUTOR) as bus:
                let_act(fault.what, Client(bus, Random(f"{name} {self.plan.seed}"), fault.seconds))

        task = self.world.scheduler.spawn(name, body)
        inbox.read_by(task)
        self._clients.append(task)

    def _empty_disk(self) -> None:
        self.world.is_disk_full = False

    def _look_at_robots(self, process: SimulatedProcess, tick: int) -> None:
        """In realtime, the robots of a host that has not answered since a tick stand, if the run goes on."""
        engine = self.world.engine
        if engine is not None and process.is_stopped and engine.tick > tick + STAND_TICKS:
            moving = [name for name in process.spec.agents if name in engine.actions and engine.actions[name].twist != STILL]
            self.complaints += [f"{name} drives on, though its host is silent" for name in moving[:1]]

    def _tear(self) -> None:
        files = sorted((self.world.folder / "snapshots").glob("tick-*.snapshot"))
        if files:
            content = files[-1].read_bytes()
            files[-1].write_bytes(content[: self.world.random.randrange(len(content))])

    # -- what may be expected

    def has_just_suffered(self, seconds: float) -> bool:
        """Whether a fault has lasted into so many seconds before the end of the run."""
        over_at = self.world.scheduler.now if self.over_at is None else self.over_at
        return any(at + seconds + (fault.seconds if fault.who != CLIENT else 0.0) >= over_at for at, fault in self.inflicted)


def carry_out(plan: Plan, is_traced: bool = False) -> Verdict:
    """Carry out a plan, in a folder of its own."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
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
        fewer = [replace(plan, faults=plan.faults[:at] + plan.faults[at + 1 :]) for at in range(len(plan.faults))]
        shorter = [replace(plan, ticks=plan.ticks // 2)] if plan.ticks > 10 else []
        for smaller in [*fewer, *shorter]:
            if _kind_of(carry_out(smaller)) == what:
                plan, is_smaller = smaller, True
                break
    return plan


def _kind_of(verdict: Verdict) -> str:
    return verdict.complaints[0].partition(":")[0] if verdict.complaints else ""
