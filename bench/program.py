"""Benchmarks of the whole program: local mode, lockstep over Zenoh, realtime, start-up time and
memory.
"""

import json
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import psutil

from bench import floor
from bench.core import world_of
from bench.field import field
from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.messages import pack
from orchard.field.scenario import Scenario
from orchard.launch.request import shares
from orchard.local import Local
from orchard.net.bus import Bus, Sample
from orchard.net.endpoints import LOOPBACK, with_port
from orchard.net.zenoh_bus import client
from orchard.sim.lookahead import IgnoredHolds, Lookahead
from orchard.sim.scan import Scanner
from orchard.wire.keys import Keys
from orchard.wire.messages import Answered, Letter

ROOT = Path(__file__).parents[1]
MEGABYTE = 1e6
RUN = "0123456789abcdef"  # as long as the id of a run
START_SECONDS = 60.0  # that a run may take to start, or to end
TICKS_PER_SECOND = 10


def scenario(options: list[str]) -> Scenario:
    """Return the scenario that run.py makes of --rows and --pickers."""
    values = dict(zip(options[::2], options[1::2], strict=True))
    numbers: dict[str, Any] = {
        name.removeprefix("--"): int(value) for name, value in values.items()
    }
    return Scenario(**numbers)


# -- local mode


class LocalFigures(NamedTuple):
    """Figures of local mode."""

    agents: int
    asked: float  # share of agents that are asked, of all agents and ticks
    rate: float  # ticks/s
    ignored: float  # ticks/s with holds ignored


def local_figures(options: list[str], ticks: int, repeats: int = 5) -> LocalFigures:
    """Measure `repeats` times `ticks` ticks from the beginning of a harvest, with holds and with
    holds ignored in turns. Return medians.
    """
    with_holds = Local(scenario(options), holds=Lookahead)
    without = Local(scenario(options), holds=IgnoredHolds)
    # The first tick loads the compiled kernels.
    for local in (with_holds, without):
        local.tick()
    rates = []
    rates_ignored = []
    for _ in range(repeats):
        rates.append(_rate(with_holds, ticks))
        rates_ignored.append(_rate(without, ticks))
    return LocalFigures(
        agents=len(with_holds.agents),
        asked=with_holds.engine.asked_share,
        rate=median(rates),
        ignored=median(rates_ignored),
    )


def _rate(local: Local, ticks: int) -> float:
    """Return the ticks/s of the next ticks of a run."""
    begun = time.perf_counter()
    for _ in range(ticks):
        local.tick()
    return ticks / (time.perf_counter() - begun)


class _Timed:
    """An agent whose time is added up. Its holds count, as those of the agent."""

    holds = True

    def __init__(self, agent: Agent, spent: list[float], process: int) -> None:
        """`spent`: s of each process, of which that of `process` grows."""
        self.Memory = agent.Memory
        self._agent = agent
        self._spent = spent
        self._process = process

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        begun = time.perf_counter()
        action = self._agent.tick(observation, mail, memory)
        self._spent[self._process] += time.perf_counter() - begun
        return action


def chain_seconds(options: list[str], hosts: str, ticks: int) -> float:
    """Return the mean time of the longest chain of computing in a tick, s: physics, and then the
    process whose agents take longest.
    """
    local = Local(scenario(options))
    processes = _processes_of(local, hosts)
    spent = [0.0] * len(processes)
    agents: dict[str, Any] = {}
    for number, names in enumerate(processes):
        for name in names:
            agents[name] = _Timed(local.agents[name], spent, number)
    local.agents = agents
    total = 0.0
    for _ in range(ticks):
        # The agents have this list, so it is filled anew, and not replaced.
        spent[:] = [0.0] * len(spent)
        begun = time.perf_counter()
        local.tick()
        of_physics = time.perf_counter() - begun - sum(spent)
        total += of_physics + max(spent)
    return total / ticks


def _processes_of(local: Local, hosts: str) -> list[Sequence[str]]:
    """Return the agents of each process. `hosts`: their number, or 'each' for one process each."""
    count = 0 if hosts == "each" else int(hosts)
    return [names for _, names in shares(list(local.agents), count)]


def trace_of(options: list[str], hosts: str, ticks: int, sizes: dict[str, int]) -> floor.Trace:
    """Return the messages of the first ticks of a lockstep run, with these mean sizes of `seen` and
    `velocities`, bytes.
    """
    local = Local(scenario(options))
    processes = _processes_of(local, hosts)
    # Agent -> the number of its process.
    process: dict[str, int] = {}
    for index, names in enumerate(processes):
        process |= dict.fromkeys(names, index)
    trace = []
    # Bytes of each request, and of each answer.
    requests: list[int] = []
    answers: list[int] = []
    for tick in range(ticks):
        local.tick()
        ways = []
        for name, action in local.answers.items():
            for number, (to, body) in enumerate(action.requests):
                requests.append(len(pack(Letter(RUN, tick, name, number, body))))
                ways.append((process[name], process[to]))
            for _, answer in action.answers:
                answers.append(len(pack(Answered(RUN, tick, answer))))
        asked = sorted({process[name] for name in local.answers})
        trace.append(floor.Tick(asked, ways))
    of_mail = {"request": round(mean(requests)), "answer": round(mean(answers))}
    return floor.Trace(len(processes), floor.Sizes(**sizes, **of_mail), trace)


# -- lockstep


def lockstep_ticks_per_second(
    options: list[str], hosts: str, ticks: int, *more: str, record: bool = False
) -> float:
    """Return the rate that run.py reports for a run of `ticks` ticks, from the beginning of the
    first tick to the last.
    """
    with TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        recording = str(Path(folder) / "run.rrd") if record else "none"
        command = [
            *_run(options, hosts, ticks),
            "--record",
            recording,
            "--summary",
            str(summary),
            *more,
        ]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        return ticks / float(json.loads(summary.read_text())["wall_seconds"])


def _run(options: list[str], hosts: str, ticks: int) -> list[str]:
    """Return the command of a run of so many ticks."""
    seconds = f"{ticks / TICKS_PER_SECOND:g}"
    return [sys.executable, "run.py", *options, "--hosts", hosts, "--duration", seconds]


class RunProfile(NamedTuple):
    """Measurements of a run, taken from outside."""

    first_tick: float  # s from the start of run.py to the first clock message
    megabytes: dict[str, float]  # process module -> MB, resident, of the largest process
    sizes: dict[str, int]  # mean bytes of `seen` and `velocities`


def profile_run(options: list[str], hosts: str, ticks: int) -> RunProfile:
    """Start run.py and record all messages for `ticks` ticks."""
    begun = time.perf_counter()
    endpoint = with_port(LOOPBACK)
    # The run is much longer than what is recorded, and is ended then.
    command = [*_run(options, hosts, 10 * ticks), "--record", "none", "--listen", endpoint]
    popen = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    try:
        with client(endpoint, seconds=START_SECONDS) as bus:
            bus.subscribe(f"{Keys().prefix}/**")
            first, samples = _received(bus, ticks)
            return RunProfile(first - begun, _memory(psutil.Process(popen.pid)), _sizes(samples))
    finally:
        popen.terminate()
        popen.wait(timeout=START_SECONDS)


def _command(process: psutil.Process) -> list[str]:
    """Return the command line of a process; nothing if it has ended."""
    try:
        return list(process.cmdline())
    except psutil.Error:
        return []


def _received(bus: Bus, ticks: int) -> tuple[float, list[Sample]]:
    """Return the time of the first clock message (perf_counter), and all samples of `ticks` ticks
    from then on.
    """
    first = 0.0
    clocks = 0
    samples = []
    while clocks <= ticks:
        item = bus.inbox.take(START_SECONDS)
        if item is None:
            raise RuntimeError(f"run.py sent no message for {START_SECONDS:g} s")
        if isinstance(item, Sample):
            if item.key.endswith("/clock"):
                first = first or time.perf_counter()
                clocks += 1
            if clocks:
                samples.append(item)
    return first, samples


def _memory(program: psutil.Process) -> dict[str, float]:
    """Return the memory of the processes of a run: module -> MB, resident, of the largest one."""
    largest: dict[str, float] = defaultdict(float)
    for child in program.children(recursive=True):
        for word in _command(child):
            if word.startswith("orchard."):
                largest[word] = max(largest[word], child.memory_info().rss / MEGABYTE)
    return dict(largest)


def _sizes(samples: list[Sample]) -> dict[str, int]:
    """Return the mean sizes of the messages between physics and a process that is asked, bytes."""
    sizes = defaultdict(list)
    for sample in samples:
        sizes[sample.key.rsplit("/", 1)[1]].append(len(sample.payload))
    return {kind: round(mean(sizes[kind])) for kind in ("seen", "velocities")}


# -- real time


class RealtimeFigures(NamedTuple):
    """Figures of a realtime run with a process for each agent."""

    cores: float  # mean number of cores that all its processes keep busy
    answers: int  # that were due
    missed: int  # of these, those that came too late
    p50: float  # ms from the observation to the arrival of the velocity
    p99: float  # ms


def realtime_figures(seconds: int) -> RealtimeFigures:
    """Run the default scenario at speed 1.

    Return its processor load, measured for `seconds` after 20 ticks, and its delays.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "summary.json"
        endpoint = with_port(LOOPBACK)
        # 2 s before the measurement, and 2 s after it.
        command = _run([], "each", TICKS_PER_SECOND * (seconds + 4))
        command += ["--mode", "realtime", "--record", "none"]
        command += ["--summary", str(path), "--listen", endpoint]
        popen = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        with client(endpoint, seconds=START_SECONDS) as bus:
            bus.subscribe(Keys().of("clock"))
            _received(bus, 20)
            begun = _processor_seconds(popen.pid)
            # Up to the clock message that ends the time: the first one of `_received` begins it.
            _received(bus, TICKS_PER_SECOND * seconds - 1)
            used = _processor_seconds(popen.pid) - begun
        popen.wait(timeout=START_SECONDS)
        summary = json.loads(path.read_text())
    delays = summary["answer_milliseconds"]
    return RealtimeFigures(
        used / seconds,
        summary["ticks"] * summary["hosts"],
        summary["velocities_missed"],
        delays["p50"],
        delays["p99"],
    )


def _processor_seconds(pid: int) -> float:
    """Return the processor time of a process and of all its descendants, s."""
    program = psutil.Process(pid)
    seconds = 0.0
    for process in [program, *program.children(recursive=True)]:
        used = process.cpu_times()
        seconds += used.user + used.system
    return seconds


# -- memory


def physics_megabytes(robots: int) -> float:
    """Return the resident memory, MB, of a process that has imported the physics process and has
    scanned and moved `robots` robots.
    """
    process = subprocess.run(
        [sys.executable, "-m", "bench.program", str(robots)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    return float(process.stdout)


def _print_memory(robots: int) -> None:
    """Print the memory of this process, as `physics_megabytes` wants it."""
    import orchard.processes.physics  # noqa: F401
    from bench.core import drive

    world = world_of(field(robots))
    drive(world, Scanner(world), 10)
    print(psutil.Process().memory_info().rss / MEGABYTE)


if __name__ == "__main__":
    _print_memory(int(sys.argv[1]))
