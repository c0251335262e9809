"""One schedule: a run, its faults by a seed, and the verdict on it."""

import tempfile
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from chaos.simulated.clients import CHANGES_THE_HASH, KEYS, RUN, Client, let_act
from chaos.simulated.link import DOWN, UP, Delays
from chaos.simulated.network import Network
from chaos.simulated.processes import SPEC_OF_LOGGER, SimulatedProcess, SimulatedSupervisor, World, spec_of_host, spec_of_physics
from chaos.simulated.scheduler import PassingInbox, Scheduler, VirtualInbox
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.distributed import THINK_SECONDS
from orchard.launch.supervisor import BAD_ORDER
from orchard.local import Local
from orchard.net.bus import Alive, Item, Sample
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.server.options import RunOptions
from orchard.server.run import read_end
from orchard.wire.keys import LOGGER, PHYSICS
from orchard.wire.messages import RESET, End

NO_EXECUTOR = Executor()  # of clients, which write nothing
WATCH_SECONDS = 0.001  # between two looks at the tick
USER_SECONDS = 2.0  # that a user takes to continue a run
LOOK_SECONDS = 0.2  # between two looks of run.py at its processes
LIMIT = 300.0  # s of virtual time within which each schedule ends
MOST_TICKS = 300
LEAVE_LIMIT = 30.0  # s of virtual time within which all processes end after physics: a host that misses the end waits 20 s


class Fault(NamedTuple):
    """A fault: what happens to which process, so many seconds after a tick, and for how long (s). Before the first tick: tick -1."""

    what: str
    who: str
    tick: int
    delay: float = 0.0
    seconds: float = 0.0

    def __str__(self) -> str:
        return f"tick {self.tick} + {self.delay:.4f} s: {self.what} {self.who}" + (f" for {self.seconds:.2f} s" if self.seconds else "")


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

    @property
    def has_hash(self) -> bool:
        """Whether the run has the hash of local mode."""
        return self.mode == "lockstep" and not any(fault.what in CHANGES_THE_HASH for fault in self.faults)


@dataclass
class Verdict:
    """What came of a schedule. `complaints`: what was promised and did not hold; empty for a good one."""

    plan: Plan
    end: End | None = None
    seconds: float = 0.0  # virtual
    complaints: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)  # the trace, if it was wanted


ALONE = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
SCENARIOS: tuple[dict[str, Any], ...] = (
    {"rows": 3, "seed": 1},
    {"rows": 3, "seed": 2, "dispatch": "nearest", **ALONE},
    {"rows": 3, "seed": 3, "route": "two-way", **ALONE},
    {"rows": 4, "seed": 4, "dispatch": "assignment", "tractor": False, **ALONE},
)
CLIENT, RUN_PY, ROUTER = "client", "run.py", "router"
FAULTS = {
    "host": ("kill", "kill", "kill", "freeze", "cut", "cut", "silence", "silence up", "silence down", "vanish"),
    PHYSICS: ("kill", "kill", "kill", "freeze", "full disk", "torn snapshot"),
    LOGGER: ("kill", "freeze", "cut", "silence"),
    CLIENT: ("claim", "claim", "nonsense", "repeat", "lie", "lie", "pause", "pause", "listen", "reset", "reset", "quit"),
    RUN_PY: ("kill",),
    ROUTER: ("kill",),
}
AT_A_MOMENT = ("kill", "torn snapshot")


def draw(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    scenario, hosts, ticks = random.choice(SCENARIOS), random.randint(1, 3), random.choice((30, 100, 100, 200, 300))
    mode = "realtime" if random.random() < 0.1 else "lockstep"
    has_logger, has_router = random.random() < 0.15, random.random() < 0.2
    delays = Delays(10.0 ** random.uniform(-4.0, -2.0), random.choice((0.05, 0.3, 1.0)), random.choice((0.0, 0.003, 0.02)))
    names = [f"agents_{number}" for number in range(hosts)]
    targets = [*names, *names, *names, PHYSICS, PHYSICS, CLIENT, CLIENT, RUN_PY, *[LOGGER] * has_logger, *[ROUTER] * has_router]
    faults = []
    for _ in range(random.choice((0, 1, 1, 2, 2, 3, 4, 6))):
        who = random.choice(targets)
        choices = FAULTS.get(who, FAULTS["host"])
        if who == PHYSICS and has_router:
            choices += ("cut", "silence")
        what = random.choice(choices)
        seconds = 0.0 if what in AT_A_MOMENT else 10.0 ** random.uniform(-1.5, 0.9)
        tick, delay = _moment(random, ticks)
        faults.append(Fault(what, who, max(tick, 0) if who == ROUTER else tick, delay, seconds))  # without a router nothing begins
    if mode == "lockstep" and random.random() < 0.05:  # what an open run cannot tell from the truth while a link is cut or physics is gone
        faults = [Fault(random.choice(("false end", "advise", "stop robots")), CLIENT, *_moment(random, ticks), 1.0)]
    return Plan(seed, scenario, ticks, hosts, has_logger, has_router, delays, tuple(sorted(faults, key=lambda fault: fault.tick)), mode)


def _moment(random: Random, ticks: int) -> tuple[int, float]:
    """A tick and a delay, s: at the start, at the end or between."""
    if (kind := random.random()) < 0.1:
        return -1, random.random() * 1.5
    return ticks - random.randrange(3) if kind < 0.3 else random.randrange(ticks), 10.0 ** random.uniform(-4.0, -1.0)


@lru_cache(maxsize=len(SCENARIOS))
def hashes_of(scenario: int) -> list[str]:
    """Return the hash of local mode at each tick."""
    local = Local(Scenario(**SCENARIOS[scenario]))
    hashes: list[str] = []
    while len(hashes) <= MOST_TICKS:
        hashes.append(local.engine.hash)
        local.tick()
    return hashes


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

    def run(self) -> Verdict:
        """Carry it out, and judge it."""
        with self.world.entered():
            if self.plan.has_router:
                self.world.network.start_router(ROUTER)
            self._start()
            self.world.scheduler.after(LOOK_SECONDS, self._look)
            self._watch(list(self.plan.faults))
            self.world.scheduler.run(lambda: self.is_over, LIMIT)
            verdict = self._judge()
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

    def _watch(self, faults: list[Fault]) -> None:
        """Let each fault happen when its tick has come."""
        tick = -1 if self.world.engine is None else self.world.engine.tick
        due = [fault for fault in faults if fault.tick <= tick]
        for fault in due:
            self.world.scheduler.after(fault.delay, partial(self._inflict, fault))
        if left := [fault for fault in faults if fault not in due]:
            self.world.scheduler.after(WATCH_SECONDS, partial(self._watch, left))

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

    # -- the verdict

    def _judge(self) -> Verdict:
        verdict = Verdict(self.plan, read_end(self.world.folder / "end", RUN), self.world.scheduler.now, lines=self.world.network.lines)
        complain, end, plan = verdict.complaints.append, verdict.end, self.plan
        for crash in self.world.crashes:
            complain(f"crash: {crash}")
        if end is None:
            complain(f"no end: {'; '.join(self.world.lines[-3:])}")
            return verdict
        if end.summary["violations"]:
            complain(f"violated: {end.summary['violations'][0]}")
        if end.summary["broken_agents"]:
            complain(f"broken: {end.summary['broken_agents'][0]}")
        may_quit = any(fault.what == "quit" for fault in plan.faults)
        if end.why != "duration" and not (may_quit and end.why == "stopped"):
            complain(f"ended by itself: {end.why}, at tick {end.tick}")
        elif end.why == "duration" and end.tick != plan.ticks:
            complain(f"wrong tick: {end.tick} of {plan.ticks}")
        if plan.has_hash and end.hash != hashes_of(SCENARIOS.index(plan.scenario))[end.tick]:
            complain("another hash than local mode")
        self._judge_codes(complain)
        return verdict

    def _judge_codes(self, complain: Callable[[str], None]) -> None:
        for name, running in self.supervisor.running.items():
            code = running.popen.poll()
            if code is None:
                complain(f"{name} still runs {LEAVE_LIMIT:g} s after the end")
            elif code not in (0, 1, -9) and not (code == BAD_ORDER and running.is_asked):  # it was asked while it connected
                complain(f"{name} ended with code {code}")
        for name in self.supervisor.given_up:
            complain(f"{name} was given up")


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
