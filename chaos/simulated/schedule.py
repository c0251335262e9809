"""One schedule: a run, its faults by a seed, and the verdict on it."""

import tempfile
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random

from chaos.simulated.clients import KEYS, RUN, Client, let_act
from chaos.simulated.link import DOWN, UP
from chaos.simulated.network import Network
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan, draw
from chaos.simulated.processes import SPEC_OF_LOGGER, SimulatedProcess, SimulatedSupervisor, World, spec_of_host, spec_of_physics
from chaos.simulated.scheduler import PassingInbox, Scheduler, VirtualInbox
from chaos.simulated.verdict import LEAVE_LIMIT, Verdict, judge
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.distributed import THINK_SECONDS
from orchard.net.bus import Alive, Item, Sample
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.server.options import RunOptions
from orchard.wire.keys import LOGGER, PHYSICS
from orchard.wire.messages import RESET, End

NO_EXECUTOR = Executor()  # of clients, which write nothing
USER_SECONDS = 2.0  # that a user takes to continue a run
LOOK_SECONDS = 0.2  # between two looks of run.py at its processes
LIMIT = 300.0  # s of virtual time within which each schedule ends


class Schedule:
    """A plan that is carried out."""

    def __init__(self, plan: Plan, folder: Path, is_traced: bool = False) -> None:
        self.plan = plan
        scheduler = Scheduler()
        network = Network(scheduler, str(plan.seed), plan.delays)
        network.is_traced = is_traced
        self.world = World(scheduler, network, Random(f"world {plan.seed}"), folder)
        self.supervisor = SimulatedSupervisor(self.world, "")
        self.is_over = False
        self._over_at: float | None = None
        self._is_ending = False  # run.py is gone, and its processes end
        self._ended_at: float | None = None  # s: when they had all ended
        self._clients = 0
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
            verdict = judge(self.plan, self.world, self.supervisor)
            for running in self.supervisor.running.values():
                running.popen.kill()
        return verdict

    # -- what run.py does

    def _start(self, resume: bool = False) -> None:
        plan, folder = self.plan, self.world.folder
        options = RunOptions(
            scenario=Scenario(**plan.scenario).model_dump(),
            run=RUN,
            connect=Network.ENDPOINT if plan.has_router else None,
            mode=plan.mode,  # type: ignore[arg-type]
            speed=20.0 if plan.mode == "realtime" else None,
            duration=plan.ticks * TIME_STEP,
            snapshots=str(folder / "snapshots"),
            snapshot_every=0.5,
            result=str(folder / "end"),
            recorded=plan.has_logger,
            resume=resume,
        )
        self._listen()
        names = sorted(lay_out(Scenario(**plan.scenario)).agents)
        self.supervisor = SimulatedSupervisor(self.world, RUN)
        self.supervisor.start(spec_of_physics(options))
        if plan.has_logger:
            self.supervisor.start(SPEC_OF_LOGGER)
        for number in range(plan.hosts):
            self.supervisor.start(spec_of_host(f"agents_{number}", names[number :: plan.hosts]))

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
        if self._is_ending:
            if not supervisor.is_any_left() and self._ended_at is None:
                self._ended_at = scheduler.now
            if self._ended_at is not None and scheduler.now >= self._ended_at + USER_SECONDS:
                self._is_ending, self._ended_at = False, None
                self._start(resume=True)
        elif self._over_at is not None:
            if scheduler.now > self._over_at + THINK_SECONDS:
                supervisor.kill(PHYSICS)
            self.is_over = not supervisor.is_any_left() or scheduler.now > self._over_at + LEAVE_LIMIT
        elif supervisor.is_over(PHYSICS) or PHYSICS in supervisor.given_up:
            self._let_go()
        else:
            supervisor.watch()
        scheduler.after(LOOK_SECONDS, self._look)

    def _let_go(self) -> None:
        """Let the processes end: the run is over."""
        self._over_at = self.world.scheduler.now
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
        is_here = self._over_at is None and not self._is_ending and self.supervisor.exit_code(PHYSICS) is None
        if is_here and self._ending.end is not None:
            self._let_go()

    def _die(self) -> None:
        """End as run.py does by SIGKILL: the lines of all processes close. A moment later, a user continues the run."""
        if not self._is_ending and self._over_at is None and not self.supervisor.is_over(PHYSICS):
            self._is_ending = True
            self.supervisor.terminate(*self.supervisor.running)

    # -- faults

    def _plan_faults(self) -> None:
        """Let each fault whose tick has come happen after its delay."""
        while self._faults_left and self._faults_left[0].tick <= (-1 if self.world.engine is None else self.world.engine.tick):
            fault = self._faults_left.pop(0)
            self.world.scheduler.after(fault.delay, partial(self._inflict, fault))

    def _inflict(self, fault: Fault) -> None:
        self.world.network.trace(f"fault: {fault.what} {fault.who} {fault.seconds:.2f}")
        if fault.who == RUN_PY:
            self._die()
        elif fault.who == CLIENT:
            self._connect_client(fault)
        elif fault.who == ROUTER:
            self.world.network.end_router(ROUTER, self.world.random.random())
            self.world.scheduler.after(1.0 + fault.delay * 50.0 % 5.0, partial(self.world.network.start_router, ROUTER))
        elif (running := self.supervisor.running.get(fault.who)) is not None and running.popen.poll() is None:
            self._hurt(fault, running.popen)  # type: ignore[arg-type]

    def _hurt(self, fault: Fault, process: SimulatedProcess) -> None:
        network = self.world.network
        match fault.what:
            case "kill":
                process.kill()
            case "vanish":  # with its machine: the router does not hear that it is gone
                network.silence(fault.who, fault.seconds)
                process.kill()
            case "freeze":
                self._freeze(process, fault.seconds)
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
        self._clients += 1
        name = f"client_{self._clients}"
        inbox = VirtualInbox(self.world.scheduler)

        def body() -> None:
            with suppress(BusError), self.world.network.client_session(name, task, inbox, NO_EXECUTOR) as bus:
                let_act(fault.what, Client(bus, Random(f"{name} {self.plan.seed}"), fault.seconds))

        task = self.world.scheduler.spawn(name, body)
        inbox.read_by(task)

    def _empty_disk(self) -> None:
        self.world.is_disk_full = False

    def _freeze(self, process: SimulatedProcess, seconds: float) -> None:
        process.freeze()
        self.world.scheduler.after(seconds, process.thaw)

    def _tear(self) -> None:
        files = sorted((self.world.folder / "snapshots").glob("tick-*.snapshot"))
        if files:
            content = files[-1].read_bytes()
            files[-1].write_bytes(content[: self.world.random.randrange(len(content))])


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
