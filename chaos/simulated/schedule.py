"""One schedule: a run, its faults by a seed, and the verdict on it."""

import gc
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from chaos.simulated.network import DOWN, UP, Delays, Network
from chaos.simulated.processes import SPEC_OF_LOGGER, SimulatedProcess, SimulatedSupervisor, World, spec_of_host, spec_of_physics
from chaos.simulated.scheduler import Scheduler
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.supervisor import Watchdog
from orchard.local import Local
from orchard.net.lifeline import OVER
from orchard.server.options import RunOptions
from orchard.server.run import read_end
from orchard.wire.keys import LOGGER, PHYSICS
from orchard.wire.messages import End

LOOK_SECONDS = 0.2  # between two looks of run.py at its processes
LIMIT = 300.0  # s of virtual time within which each schedule ends
LEAVE_LIMIT = 30.0  # s of virtual time within which all processes end after physics: a host that misses the end waits 20 s


class Fault(NamedTuple):
    """A fault: what happens to which process, when (s), and for how long (s)."""

    what: str
    who: str
    at: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.at:.3f} s: {self.what} {self.who}" + (f" for {self.seconds:.2f} s" if self.seconds else "")


@dataclass(frozen=True)
class Plan:
    """What one schedule does. The same plan gives the same schedule."""

    seed: int
    scenario: dict[str, Any]
    ticks: int
    hosts: int
    has_logger: bool
    has_router: bool  # a router of its own, to which physics connects too
    delays: Delays
    faults: tuple[Fault, ...]
    mode: str = "lockstep"


@dataclass
class Verdict:
    """What came of a schedule. `complaints`: what was promised and did not hold; empty for a good one."""

    plan: Plan
    end: End | None = None
    seconds: float = 0.0  # virtual
    complaints: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # the trace, if it was wanted


SCENARIOS = (
    {"rows": 3, "seed": 1},
    {"rows": 3, "seed": 2, "dispatch": "nearest"},
    {"rows": 3, "seed": 3, "route": "two-way"},
    {"rows": 4, "seed": 4, "dispatch": "assignment"},
)
HOST_FAULTS = ("kill", "kill", "kill", "freeze", "cut", "cut", "silence", "silence up", "silence down")
PHYSICS_FAULTS = ("kill", "kill", "kill", "freeze", "full disk", "torn snapshot")
LOGGER_FAULTS = ("kill", "freeze", "cut", "silence")


def draw(seed: int, ticks: int = 300) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    scenario, hosts = random.choice(SCENARIOS), random.randint(1, 3)
    has_logger, has_router = random.random() < 0.15, random.random() < 0.2
    delays = Delays(10.0 ** random.uniform(-4.0, -2.0), random.choice((0.05, 0.3, 1.0)), random.choice((0.0, 0.003, 0.02)))
    length = 1.0 + ticks * 4.0 * delays.typical + ticks * 2.0 * delays.share * delays.slow  # s, roughly
    names = [f"agents_{number}" for number in range(hosts)]
    faults = []
    for _ in range(random.choice((0, 1, 1, 2, 2, 3, 4, 6))):
        who = random.choice([*names, *names, PHYSICS, *([LOGGER] if has_logger else [])])
        choices = PHYSICS_FAULTS if who == PHYSICS else LOGGER_FAULTS if who == LOGGER else HOST_FAULTS
        if who == PHYSICS and has_router:
            choices += ("cut", "silence")
        what = random.choice(choices)
        seconds = 0.0 if what in ("kill", "torn snapshot") else 10.0 ** random.uniform(-1.5, 0.9)
        faults.append(Fault(what, who, random.uniform(0.0, length * 1.3), seconds))
    return Plan(seed, scenario, ticks, hosts, has_logger, has_router, delays, tuple(sorted(faults, key=lambda fault: fault.at)))


@lru_cache(maxsize=100)
def local_end(scenario: tuple[tuple[str, Any], ...], ticks: int) -> tuple[int, str]:
    """Return tick and hash of a run in local mode."""
    local = Local(Scenario(**dict(scenario)))
    while local.engine.tick < ticks and not local.engine.over:
        local.tick()
    return local.engine.tick, local.engine.hash


class Schedule:
    """A plan that is carried out."""

    def __init__(self, plan: Plan, folder: Path, is_traced: bool = False) -> None:
        self.plan = plan
        scheduler = Scheduler()
        network = Network(scheduler, str(plan.seed), plan.delays)
        network.is_traced = is_traced
        self.world = World(scheduler, network, Random(f"world {plan.seed}"), folder)
        self.supervisor = SimulatedSupervisor(self.world, "run1")
        self.is_over = False
        self._over_at: float | None = None
        self.processes: list[SimulatedProcess] = []

    def run(self) -> Verdict:
        """Carry it out, and judge it."""
        with self.world.entered():
            self._start()
            for fault in self.plan.faults:
                self.world.scheduler.after(fault.at, lambda fault=fault: self._inflict(fault))
            self.world.scheduler.run(lambda: self.is_over, LIMIT)
            verdict = self._judge()
            for running in self.supervisor.running.values():
                running.popen.kill()
        return verdict

    # -- what run.py does

    def _start(self) -> None:
        plan, folder = self.plan, self.world.folder
        if plan.has_router:
            self.world.scheduler.spawn("router", self._route)
        options = RunOptions(
            scenario=Scenario(**plan.scenario).model_dump(),
            run="run1",
            connect=Network.ENDPOINT if plan.has_router else None,
            duration=plan.ticks * TIME_STEP,
            snapshots=str(folder / "snapshots"),
            snapshot_every=0.5,
            result=str(folder / "end"),
            recorded=plan.has_logger,
        )
        names = sorted(lay_out(Scenario(**plan.scenario)).agents)
        self.supervisor.start(spec_of_physics(options))
        if plan.has_logger:
            self.supervisor.start(SPEC_OF_LOGGER)
        for number in range(plan.hosts):
            self.supervisor.start(spec_of_host(f"agents_{number}", names[number :: plan.hosts]))
        self.world.scheduler.after(LOOK_SECONDS, self._look)

    def _route(self) -> None:
        """A router of its own: `orchard router`."""
        from chaos.simulated.network import Router

        self.world.network.router = Router(self.world.scheduler)

    def _look(self) -> None:
        """Restart what has died, until physics is over; then wait for the others."""
        scheduler, supervisor = self.world.scheduler, self.supervisor
        if self._over_at is None and (supervisor.is_over(PHYSICS) or PHYSICS in supervisor.given_up):
            self._over_at = scheduler.now
        if self._over_at is None:
            supervisor.watch()
        elif None not in supervisor.exit_codes() or scheduler.now > self._over_at + LEAVE_LIMIT:
            self.is_over = True
        scheduler.after(LOOK_SECONDS, self._look)

    # -- faults

    def _inflict(self, fault: Fault) -> None:
        running = self.supervisor.running.get(fault.who)
        if running is None or running.popen.poll() is not None or self._over_at is not None:
            return
        self.world.network.trace(f"fault: {fault.what} {fault.who} {fault.seconds:.2f}")
        network, process = self.world.network, running.popen
        match fault.what:
            case "kill":
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

    def _empty_disk(self) -> None:
        self.world.is_disk_full = False

    def _freeze(self, process: SimulatedProcess, seconds: float) -> None:
        process.task.freeze()
        self.world.network.freeze(process.spec.name, seconds)
        self.world.scheduler.after(seconds, process.task.thaw)

    def _tear(self) -> None:
        files = sorted((self.world.folder / "snapshots").glob("tick-*.snapshot"))
        if files:
            files[-1].write_bytes(files[-1].read_bytes()[: self.world.random.randint(0, 5000)])

    # -- the verdict

    def _judge(self) -> Verdict:
        verdict = Verdict(self.plan, read_end(self.world.folder / "end", "run1"), self.world.scheduler.now, lines=self.world.network.lines)
        complain = verdict.complaints.append
        for crash in self.world.crashes:
            complain(f"crash: {crash}")
        if verdict.end is None:
            complain(f"no end: {'; '.join(self.world.lines[-3:])}")
            return verdict
        if verdict.end.summary["violations"]:
            complain(f"violated: {verdict.end.summary['violations'][0]}")
        wanted = local_end(tuple(self.plan.scenario.items()), self.plan.ticks)
        if verdict.end.tick != wanted[0]:
            complain(f"ended at tick {verdict.end.tick} of {wanted[0]}: {verdict.end.why}")
        elif verdict.end.hash != wanted[1]:
            complain("another hash than local mode")
        self._judge_codes(complain)
        return verdict

    def _judge_codes(self, complain: Callable[[str], None]) -> None:
        for name, running in self.supervisor.running.items():
            code = running.popen.poll()
            if code is None:
                complain(f"{name} still runs {LEAVE_LIMIT:g} s after the end")
            elif code not in (OVER, 1, -9):
                complain(f"{name} ended with code {code}")
        for name in self.supervisor.given_up:
            complain(f"{name} was given up")


def carry_out(plan: Plan, is_traced: bool = False) -> Verdict:
    """Carry out a plan, in a folder of its own."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        return Schedule(plan, Path(folder), is_traced).run()


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


def collect() -> None:
    """Free what the schedules so far have left."""
    gc.collect()
