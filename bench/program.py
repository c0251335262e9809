"""Benchmarks of the whole program: local mode, lockstep over Zenoh, realtime, start-up time and
memory.
"""

import json
import subprocess
import sys
import time
from collections import defaultdict
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
START_SECONDS = 60.0


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
    on, ignored = (Local(scenario(options), holds=holds) for holds in (Lookahead, IgnoredHolds))
    for local in (on, ignored):
        local.tick()
    rates = [(_rate(on, ticks), _rate(ignored, ticks)) for _ in range(repeats)]
    return LocalFigures(
        len(on.agents), on.engine.asked_share, *map(median, zip(*rates, strict=True))
    )


def _rate(local: Local, ticks: int) -> float:
    begun = time.perf_counter()
    for _ in range(ticks):
        local.tick()
    return ticks / (time.perf_counter() - begun)


class _Timed:
    """An agent whose time is added up."""

    holds = True

    def __init__(self, agent: Agent, spent: list[float], process: int) -> None:
        self.Memory, self._agent, self._spent, self._process = agent.Memory, agent, spent, process

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        begun = time.perf_counter()
        action = self._agent.tick(observation, mail, memory)
        self._spent[self._process] += time.perf_counter() - begun
        return action


def chain_seconds(options: list[str], hosts: str, ticks: int) -> float:
    """Return the mean time of the longest chain of computing in a tick, s: physics, and then the
    process whose agents take longest.
    """
    local, total = Local(scenario(options)), 0.0
    processes = shares(list(local.agents), 0 if hosts == "each" else int(hosts))
    spent = [0.0] * len(processes)
    agents: dict[str, Any] = {
        name: _Timed(local.agents[name], spent, i)
        for i, (_, names) in enumerate(processes)
        for name in names
    }
    local.agents = agents
    for _ in range(ticks):
        spent[:] = [0.0] * len(spent)
        begun = time.perf_counter()
        local.tick()
        total += time.perf_counter() - begun - sum(spent) + max(spent)
    return total / ticks


def trace_of(options: list[str], hosts: str, ticks: int, sizes: dict[str, int]) -> floor.Trace:
    """Return the messages of the first ticks of a lockstep run, with these mean sizes of `seen` and
    `velocities`, bytes.
    """
    local, found = Local(scenario(options)), []
    processes = shares(list(local.agents), 0 if hosts == "each" else int(hosts))
    process = {name: i for i, (_, names) in enumerate(processes) for name in names}
    letters, replies = list[int](), list[int]()
    for tick in range(ticks):
        local.tick()
        sent = [
            (name, number, *request)
            for name, action in local.answers.items()
            for number, request in enumerate(action.requests)
        ]
        letters += [
            len(pack(Letter(RUN, tick, name, number, body))) for name, number, _, body in sent
        ]
        replies += [
            len(pack(Answered(RUN, tick, body)))
            for action in local.answers.values()
            for _, body in action.answers
        ]
        asked = sorted({process[name] for name in local.answers})
        found.append(floor.Tick(asked, [(process[name], process[to]) for name, _, to, _ in sent]))
    return floor.Trace(
        len(processes),
        floor.Sizes(**sizes, request=round(mean(letters)), answer=round(mean(replies))),
        found,
    )


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
    return [sys.executable, "run.py", *options, "--hosts", hosts, "--duration", f"{ticks / 10:g}"]


class RunProfile(NamedTuple):
    """Measurements of a run, taken from outside."""

    first_tick: float  # s from the start of run.py to the first clock message
    megabytes: dict[str, float]  # process module -> MB, resident, of the largest process
    sizes: dict[str, int]  # mean bytes of `seen` and `velocities`


def profile_run(options: list[str], hosts: str, ticks: int) -> RunProfile:
    """Start run.py and record all messages for `ticks` ticks."""
    begun = time.perf_counter()
    endpoint = with_port(LOOPBACK)
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
    try:
        return list(process.cmdline())
    except psutil.Error:
        return []


def _received(bus: Bus, ticks: int) -> tuple[float, list[Sample]]:
    """The time of the first clock message (perf_counter), and all samples of `ticks` ticks from
    then on.
    """
    first, clocks, samples = 0.0, 0, []
    while clocks <= ticks:
        item = bus.inbox.take(START_SECONDS)
        if item is None:
            raise RuntimeError(f"run.py sent no message for {START_SECONDS:g} s")
        if isinstance(item, Sample):
            if item.key.endswith("/clock"):
                first, clocks = first or time.perf_counter(), clocks + 1
            if clocks:
                samples.append(item)
    return first, samples


def _memory(program: psutil.Process) -> dict[str, float]:
    found: dict[str, float] = defaultdict(float)
    for child in program.children(recursive=True):
        command = _command(child)
        for module in (word for word in command if word.startswith("orchard.")):
            found[module] = max(found[module], child.memory_info().rss / MEGABYTE)
    return dict(found)


def _sizes(samples: list[Sample]) -> dict[str, int]:
    """The mean sizes of the messages between physics and one process that is asked, bytes."""
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
        path, endpoint = Path(folder) / "summary.json", with_port(LOOPBACK)
        how = [
            "--mode",
            "realtime",
            "--record",
            "none",
            "--summary",
            str(path),
            "--listen",
            endpoint,
        ]
        popen = subprocess.Popen(
            [*_run([], "each", 10 * (seconds + 4)), *how], cwd=ROOT, stdout=subprocess.DEVNULL
        )
        with client(endpoint, seconds=START_SECONDS) as bus:
            bus.subscribe(Keys().of("clock"))
            _received(bus, 20)
            begun = _processor_seconds(popen.pid)
            _received(bus, 10 * seconds - 1)
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
    """Processor time of a process and of all its descendants."""
    program = psutil.Process(pid)
    times = [process.cpu_times() for process in [program, *program.children(recursive=True)]]
    return float(sum(each.user + each.system for each in times))


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
    import orchard.processes.physics  # noqa: F401
    from bench.core import drive

    world = world_of(field(robots))
    drive(world, Scanner(world), 10)
    print(psutil.Process().memory_info().rss / MEGABYTE)


if __name__ == "__main__":
    _print_memory(int(sys.argv[1]))
