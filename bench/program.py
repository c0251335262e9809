"""The whole program: local mode, lockstep over Zenoh, how it starts, what memory it takes."""

import json
import subprocess
import sys
import time
from collections import Counter, defaultdict
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

import psutil

from bench.core import world_of
from bench.field import field
from bench.floor import Traffic, Way
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.net.bus import Bus, Inbox, Sample, client
from orchard.sim.scan import Scanner
from orchard.wire.keys import Keys

ROOT = Path(__file__).parents[1]
MEGABYTE = 1e6
START_SECONDS = 60.0


def scenario(words: list[str]) -> Scenario:
    """What run.py makes of --rows and --pickers."""
    options = dict(zip(words[::2], words[1::2], strict=True))
    return Scenario(**{name.removeprefix("--"): int(value) for name, value in options.items()})


# -- local mode


def local_ticks_per_second(words: list[str], ticks: int, repeats: int = 5) -> tuple[float, int]:
    """The median over stretches of one harvest, from its beginning; and how many agents it has."""
    local = Local(scenario(words))
    local.tick()
    return median(_rate(local, ticks) for _ in range(repeats)), len(local.agents)


def _rate(local: Local, ticks: int) -> float:
    begun = time.perf_counter()
    for _ in range(ticks):
        local.tick()
    return ticks / (time.perf_counter() - begun)


# -- lockstep


def lockstep_ticks_per_second(words: list[str], hosts: str, ticks: int, record: bool) -> float:
    """What run.py itself tells of a run of so many ticks, from the first agent's joining to the last tick."""
    with TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        recording = str(Path(folder) / "run.rrd") if record else "none"
        command = [*_run(words, hosts, ticks), "--record", recording, "--summary", str(summary)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        return ticks / float(json.loads(summary.read_text())["wall_seconds"])


def _run(words: list[str], hosts: str, ticks: int) -> list[str]:
    return [sys.executable, "run.py", *words, "--hosts", hosts, "--duration", f"{ticks / 10:g}"]


class Look(NamedTuple):
    """What is seen of a run from outside."""

    first_tick: float  # s from run.py's start to the first tick's clock
    megabytes: dict[str, float]  # process module -> the most that one of them holds
    traffic: Traffic  # that agents and physics need, at every tick


def look_at(words: list[str], hosts: str, ticks: int, clients: int) -> Look:
    """Start run.py, and listen to all that is said for so many ticks."""
    begun = time.perf_counter()
    popen = subprocess.Popen([*_run(words, hosts, 10 * ticks), "--record", "none"], cwd=ROOT, stdout=subprocess.DEVNULL)
    try:
        with _joined(psutil.Process(popen.pid)) as bus:
            bus.subscribe(f"{Keys().prefix}/**")
            first, samples = _heard(bus, ticks)
            return Look(first - begun, _memory(psutil.Process(popen.pid)), _traffic(samples, ticks, clients))
    finally:
        popen.terminate()
        popen.wait(timeout=START_SECONDS)


@contextmanager
def _joined(program: psutil.Process):
    """A session with the router of a program that is starting."""
    deadline = time.perf_counter() + START_SECONDS
    while time.perf_counter() < deadline:
        for child in program.children(recursive=True):
            words = _words(child)
            if "--listen" in words:
                with client(words[words.index("--listen") + 1], Inbox()) as bus:
                    yield bus
                return
        time.sleep(0.02)
    raise RuntimeError("run.py started no physics")


def _words(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def _heard(bus: Bus, ticks: int) -> tuple[float, list[Sample]]:
    """When the first clock came, and all that was said in so many ticks from then on."""
    first, clocks, samples = 0.0, 0, []
    while clocks <= ticks:
        item = bus.inbox.take(START_SECONDS)
        if item is None:
            raise RuntimeError("run.py does not tick")
        if isinstance(item, Sample):
            if item.key.endswith("/clock"):
                first, clocks = first or time.perf_counter(), clocks + 1
            if clocks:
                samples.append(item)
    return first, samples


def _memory(program: psutil.Process) -> dict[str, float]:
    found: dict[str, float] = defaultdict(float)
    for child in program.children(recursive=True):
        words = _words(child)
        if "-m" in words:
            module = words[words.index("-m") + 1]
            found[module] = max(found[module], child.memory_info().rss / MEGABYTE)
    return dict(found)


def _traffic(samples: list[Sample], ticks: int, clients: int) -> Traffic:
    """The mean of what was sent: to each client what is seen, and back from it the velocities."""
    count, size = Counter(), Counter()
    for sample in samples:
        kind = sample.key.rsplit("/", 1)[1]
        count[kind] += 1
        size[kind] += len(sample.payload)
    mean = {kind: round(size[kind] / count[kind]) for kind in count}
    back = round(count["velocities"] / ticks / clients)
    return Traffic(clients, Way(1, mean["seen"]), Way(back, mean["velocities"]))


# -- real time


class Clocked(NamedTuple):
    """A run that keeps to the wall clock, with a process for each agent."""

    cores: float  # that all its processes keep busy
    answers: int  # that were due
    missed: int  # of them
    p50: float  # ms from what was seen to the velocity
    p99: float


def clocked(seconds: int) -> Clocked:
    """The default scenario at speed 1: what it costs in its midst, and how it keeps its time."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "summary.json"
        order = [*_run([], "each", 10 * (seconds + 4)), "--mode", "realtime", "--record", "none", "--summary", str(path)]
        popen = subprocess.Popen(order, cwd=ROOT, stdout=subprocess.DEVNULL)
        with _joined(psutil.Process(popen.pid)) as bus:
            bus.subscribe(Keys().of("clock"))
            _heard(bus, 20)
            begun = _processor_seconds(popen.pid)
            _heard(bus, 10 * seconds - 1)
            used = _processor_seconds(popen.pid) - begun
        popen.wait(timeout=START_SECONDS)
        summary = json.loads(path.read_text())
    delays = summary["answer_milliseconds"]
    return Clocked(used / seconds, summary["ticks"] * summary["hosts"], summary["velocities_missed"], delays["p50"], delays["p99"])


def _processor_seconds(pid: int) -> float:
    """Of a process and all that it has started."""
    program = psutil.Process(pid)
    times = [process.cpu_times() for process in [program, *program.children(recursive=True)]]
    return sum(each.user + each.system for each in times)


# -- memory


def physics_megabytes(robots: int) -> float:
    """What a process holds that has imported the physics process, and has scanned and moved so many robots."""
    done = subprocess.run([sys.executable, "-m", "bench.program", str(robots)], cwd=ROOT, check=True, capture_output=True, text=True)
    return float(done.stdout)


def _hold(robots: int) -> None:
    import processes.physics  # noqa: F401
    from bench.core import drive

    world = world_of(field(robots))
    drive(world, Scanner(world.layout), 10)
    print(psutil.Process().memory_info().rss / MEGABYTE)


if __name__ == "__main__":
    _hold(int(sys.argv[1]))
