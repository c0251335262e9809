"""Whether memory and file handles stay as they are over 100,000 ticks: of physics and two hosts in lockstep, and of local mode."""

import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from statistics import linear_regression
from typing import NamedTuple

import psutil

from chaos.harvest import Harvest
from orchard.field.scenario import Scenario, to_yaml
from orchard.launch.supervisor import free_port
from orchard.local import Local
from orchard.net.bus import Alive, Sample, client
from orchard.wire.keys import PHYSICS, Keys
from orchard.wire.messages import Figures
from orchard.wire.types import read

TICKS = 100_000
WARM_UP = 20_000  # ticks, after which all that is made once has been made
EVERY = 5_000  # ticks between two looks
MOST_GROWTH = 0.05  # of the memory, from the end of the warm-up to the end
SILENCE_SECONDS = 120.0  # without a figure: it hangs
MEGABYTE = 1e6
LONG = Scenario(rows=6, pickers=2, carriers=2, picking_speed=0.02)  # three rows each, of an hour each: more than 100,000 ticks

Say = Callable[[int, str], None]  # (tick, where)


class Look(NamedTuple):
    """A process at a tick."""

    tick: int
    megabytes: float  # resident
    handles: int  # open files and sockets


class Course(NamedTuple):
    """A process over a run; the warm-up is left out."""

    who: str
    looks: list[Look]

    @property
    def growth(self) -> float:
        """Of the memory, as a straight line goes through it: 0.05 is five per cent."""
        slope = linear_regression([look.tick for look in self.looks], [look.megabytes for look in self.looks]).slope
        return slope * (self.looks[-1].tick - self.looks[0].tick) / self.looks[0].megabytes

    @property
    def more_handles(self) -> int:
        """In the later half than in the earlier; a file that is open for a moment, as a snapshot is, does not count."""
        middle = len(self.looks) // 2
        earlier, later = (min(look.handles for look in part) for part in (self.looks[:middle], self.looks[middle:]))
        return later - earlier

    @property
    def is_flat(self) -> bool:
        return self.growth <= MOST_GROWTH and self.more_handles <= 0


class Endurance(NamedTuple):
    """What came of it."""

    ticks: int
    courses: list[Course]
    ticks_per_second: dict[str, float]  # mode ->

    @property
    def is_good(self) -> bool:
        return all(course.is_flat for course in self.courses)


def endure(say: Say, ticks: int = TICKS) -> Endurance:
    """Both modes, one after the other. Raises RuntimeError where a run does not go on."""
    rates = {}
    courses = []
    for mode, looked in (("lockstep", _lockstep), ("local", _local)):
        begun = time.monotonic()
        courses += courses_of(looked(say, ticks))
        rates[mode] = ticks / (time.monotonic() - begun)
    return Endurance(ticks, courses, rates)


def courses_of(looks: Iterator[tuple[int, Mapping[str, psutil.Process]]]) -> list[Course]:
    """Look at all processes whenever there is something to look at."""
    found: dict[str, list[Look]] = defaultdict(list)
    for tick, processes in looks:
        for who, process in processes.items():
            found[who].append(Look(tick, process.memory_info().rss / MEGABYTE, process.num_fds()))
    return [Course(who, seen) for who, seen in found.items()]


def _lockstep(say: Say, ticks: int) -> Iterator[tuple[int, Mapping[str, psutil.Process]]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "long.yaml"
        file.write_text(to_yaml(LONG))
        words = [str(file), "--hosts", "2", "--duration", str(ticks / 10), "--record", "none", "--listen", endpoint]
        with Harvest(words, "endurance") as harvest:
            for tick in _ticks_at(endpoint, ticks):
                say(tick, "lockstep, 2 hosts")
                if tick >= WARM_UP:
                    (physics,), hosts = harvest.processes("physics"), harvest.processes("agents")
                    yield tick, {"physics": physics} | {f"host {i + 1}": host for i, host in enumerate(hosts)}
    harvest.tidy()


def _ticks_at(endpoint: str, ticks: int) -> Iterator[int]:
    """Whenever another 5,000 ticks have gone by; physics tells its figures twice a second."""
    with client(endpoint, seconds=SILENCE_SECONDS) as bus:
        bus.subscribe(Keys().of("figures"))
        bus.watch(Keys().of("alive", PHYSICS))
        due = EVERY
        while due < ticks:
            item = bus.inbox.take(SILENCE_SECONDS)
            if item is None or (isinstance(item, Alive) and not item.up):
                raise RuntimeError(f"the long run does not go on after tick {due - EVERY}")
            if isinstance(item, Sample) and (tick := read(item.payload, Figures).tick) >= due:
                due = tick - tick % EVERY + EVERY
                yield tick


def _local(say: Say, ticks: int) -> Iterator[tuple[int, Mapping[str, psutil.Process]]]:
    local, here = Local(LONG), psutil.Process()
    for tick in range(1, ticks + 1):
        local.tick()
        if tick % EVERY == 0:
            say(tick, "local mode")
            if tick >= WARM_UP:
                yield tick, {"local mode": here}
