"""The course of a run: a few of its figures over simulated time, for charts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from orchard.contract.agent import STATES, WAITING_STATES
from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP
from orchard.sim.state_times import StateTimes
from orchard.sim.world import World

FIRST_STEP = 100  # ticks between two samples at first: 10 s
MOST = 400  # samples; then every second one is dropped, and the step doubles
WAITING = [STATES.index(state) for state in WAITING_STATES]

# s since the start; bins; s of all pickers together; s of all carriers together, outside the queue
NAMES = ("seconds", "bins_delivered", "pickers_waited_seconds", "carriers_busy_seconds")
Sample = tuple[float, int, float, float]  # totals since the start of the run, in the order of NAMES


@dataclass
class History:
    """Samples of a run, as plain data. A long run has no more samples than a short one."""

    step: int = FIRST_STEP  # ticks between two samples
    samples: list[Sample] = field(default_factory=list)

    def update(self, world: World, states: StateTimes, busy_ticks: int) -> None:
        """Add a sample if one is due at this tick."""
        if world.tick % self.step:
            return
        self.samples.append(sample_of(world, states, busy_ticks))
        if len(self.samples) >= MOST:
            self.step, self.samples = 2 * self.step, self.samples[1::2]

    def until(self, now: Sample) -> dict[str, list[float]]:
        """Return all samples and that of now, for the summary: name -> values."""
        samples = [*self.samples, now] if [now] != self.samples[-1:] else self.samples
        return {name: list(values) for name, values in zip(NAMES, zip(*samples, strict=True), strict=True)}


def sample_of(world: World, states: StateTimes, busy_ticks: int) -> Sample:
    """Return the totals up to this tick. `busy_ticks`: of all carriers outside the queue."""
    waiting = sum(ticks[state] for name, ticks in states.counts.ticks.items() if kind_of(name) == "picker" for state in WAITING)
    return round(world.tick * TIME_STEP, 1), world.delivered, round(waiting * TIME_STEP, 1), round(busy_ticks * TIME_STEP, 1)


def shares(history: Mapping[str, Sequence[float]], name: str, robots: int) -> list[float]:
    """Return what share of its time a robot spent so, 0 to 1, from each sample to the next. `robots`: how many there are together."""
    times, spent = [0.0, *history["seconds"]], [0.0, *history[name]]
    steps = zip(times, times[1:], spent, spent[1:], strict=False)
    return [(after - before) / (robots * (until - since)) if until > since else 0.0 for since, until, before, after in steps]
