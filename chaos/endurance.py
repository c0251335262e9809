"""Measures whether memory and file handles stay constant over 100,000 ticks.

It does so for physics and two hosts in lockstep, and for local mode.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from statistics import linear_regression
from typing import NamedTuple

import psutil

from chaos.harvest import Harvest
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.launch.supervisor import free_port
from orchard.local import Local
from orchard.net.bus import Alive, Sample
from orchard.net.zenoh_bus import client
from orchard.wire.keys import Keys
from orchard.wire.messages import Figures, read

TICKS = 100_000
WARM_UP = 20_000  # ticks, after which all one-time allocations are done
EVERY = 5_000  # ticks between two samples
# The relative growth of the memory, from the end of the warm-up to the end of the run.
MOST_GROWTH = 0.05
SILENCE_SECONDS = 120.0  # without figures; after that the run counts as hung
MEGABYTE = 1e6  # bytes
# Three rows for each picker, an hour a row, at 0.02 m/s: more than 100,000 ticks of 0.1 s.
LONG = Scenario(rows=6, pickers=2, carriers=2, picking_speed=0.02)
LOCAL_MODE = "local mode"

# Shows how far the test is: (tick, mode).
Say = Callable[[int, str], None]


class MemorySample(NamedTuple):
    """The resources of a process at one tick."""

    tick: int
    megabytes: float  # resident
    handles: int  # open files and sockets


class MemorySeries(NamedTuple):
    """The samples of one process over a run, without the warm-up."""

    name: str  # of the process
    samples: list[MemorySample]

    @property
    def growth(self) -> float:
        """The relative growth of the memory along a fitted straight line: 0.05 is five per cent."""
        ticks = [sample.tick for sample in self.samples]
        megabytes = [sample.megabytes for sample in self.samples]
        slope = linear_regression(ticks, megabytes).slope
        return slope * (ticks[-1] - ticks[0]) / megabytes[0]

    @property
    def more_handles(self) -> int:
        """How many more handles the later half has than the earlier half.

        Each half counts with its minimum, so a file that is open for a moment, such as a snapshot,
        does not matter.
        """
        middle = len(self.samples) // 2
        earlier = min(sample.handles for sample in self.samples[:middle])
        later = min(sample.handles for sample in self.samples[middle:])
        return later - earlier

    @property
    def is_flat(self) -> bool:
        """Whether the memory grows by no more than MOST_GROWTH and the handles do not increase."""
        return self.growth <= MOST_GROWTH and self.more_handles <= 0


class Endurance(NamedTuple):
    """The result of the endurance test."""

    ticks: int
    series: list[MemorySeries]
    ticks_per_second: dict[str, float]  # mode -> rate

    @property
    def is_good(self) -> bool:
        """Whether all processes stayed flat."""
        return all(series.is_flat for series in self.series)


def endure(say: Say, ticks: int = TICKS) -> Endurance:
    """Run lockstep mode, then local mode. Raises RuntimeError where a run stops making progress."""
    rates = {}
    series = []
    for mode, sampled in (("lockstep", _lockstep), ("local", _local)):
        begun = time.monotonic()
        series += series_of(sampled(say, ticks))
        rates[mode] = ticks / (time.monotonic() - begun)
    return Endurance(ticks, series, rates)


def series_of(moments: Iterator[tuple[int, Mapping[str, psutil.Process]]]) -> list[MemorySeries]:
    """Sample processes at each moment. Return a series for each of their names.

    `moments`: yields a tick, and name -> process, when the run has come to that tick.
    """
    by_name: dict[str, list[MemorySample]] = defaultdict(list)
    for tick, processes in moments:
        for name, process in processes.items():
            megabytes = process.memory_info().rss / MEGABYTE
            by_name[name].append(MemorySample(tick, megabytes, process.num_fds()))
    return [MemorySeries(name, samples) for name, samples in by_name.items()]


def _lockstep(say: Say, ticks: int) -> Iterator[tuple[int, Mapping[str, psutil.Process]]]:
    """Do a run in lockstep. Yield its moments after the warm-up, as `series_of` takes them."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    arguments = ["--hosts", "2", "--duration", str(ticks * TIME_STEP)]
    arguments += ["--record", "none", "--listen", endpoint]
    with Harvest(LONG, arguments, "endurance") as harvest:
        for tick in _ticks_at(endpoint, ticks):
            say(tick, "lockstep, 2 hosts")
            if tick >= WARM_UP:
                (physics,) = harvest.processes("physics")
                sampled = {"physics": physics}
                for number, host in enumerate(harvest.processes("agents"), start=1):
                    sampled[f"host {number}"] = host
                yield tick, sampled
    harvest.tidy()


def _ticks_at(endpoint: str, ticks: int) -> Iterator[int]:
    """Yield a tick after every 5,000 ticks; physics publishes its figures twice a second."""
    with client(endpoint, seconds=SILENCE_SECONDS) as bus:
        bus.subscribe(Keys().of("figures"))
        bus.watch(Keys().of("physics"))
        due = EVERY
        while due < ticks:
            item = bus.inbox.take(SILENCE_SECONDS)
            if item is None or (isinstance(item, Alive) and not item.up):
                raise RuntimeError(
                    f"the endurance run stopped making progress after tick {due - EVERY}"
                )
            if not isinstance(item, Sample):
                continue
            tick = read(item.payload, Figures).tick
            if tick >= due:
                # The next multiple of EVERY.
                due = tick - tick % EVERY + EVERY
                yield tick


def _local(say: Say, ticks: int) -> Iterator[tuple[int, Mapping[str, psutil.Process]]]:
    """Do a run in local mode. Yield its moments after the warm-up, as `series_of` takes them."""
    local = Local(LONG)
    here = psutil.Process()
    for tick in range(1, ticks + 1):
        local.tick()
        if tick % EVERY == 0:
            say(tick, LOCAL_MODE)
            if tick >= WARM_UP:
                yield tick, {LOCAL_MODE: here}
