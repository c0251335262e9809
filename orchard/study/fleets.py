"""The fleets among which a study with a deadline searches, each with its limit.

A fleet is a number of pickers and a number of carriers. A crew is a number of pickers. The limit is
the shortest time that a harvest can take without traffic, s. It needs no run. A fleet cannot be
faster than its slowest part: the picker with the most to pick, all carriers, the bay, or the
chargers. So a fleet whose limit is beyond the deadline is out, and what its harvest costs at its
limit is the least that it may cost.

Where the seed draws how fast rows or pickers are, each seed has a limit too: that of the picker
whose rows take longest with this seed. It is much longer than the limit in rows that take mean
times.

If a study chooses the numbers of pickers, it leaves some out: a number with which the largest share
of rows of a picker is the same as with a smaller number. It costs more, and is hardly faster.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor
from operator import attrgetter
from statistics import fmean

from orchard.field.layout import Layout, lay_out
from orchard.field.picking import picking_speed_of
from orchard.field.rows import Block
from orchard.field.scenario import BALANCED, BALANCED_ENDS, Scenario, with_changes
from orchard.plans.jobs import handover_seconds
from orchard.report.bounds import Bounds, load_out_seconds
from orchard.report.limits import full_bins, in_mean_rows, limit_of_question, with_seed
from orchard.study.deadline import Deadline
from orchard.study.settings import (
    CARRIERS,
    FEWER,
    MORE,
    Setting,
    is_possible,
    most_carriers,
    settings_of,
)

PICKERS = "pickers"
# The parts of an orchard whose limit depends on the number of robots, or on the seed.
OF_ROBOTS = (PICKERS, CARRIERS)
MOST_PICKERS = 60
LEAST_PICKERS = 2


@dataclass(frozen=True)
class Fleet:
    """A setting, and what is known of its harvest without a run."""

    setting: Setting
    limit_seconds: float
    #: The part of the orchard that sets this limit.
    part: str
    #: The least that its harvest may cost; without prices the number of robots.
    least_cost: float

    @property
    def pickers(self) -> int:
        """The number of pickers."""
        return self.setting.scenario.pickers

    @property
    def carriers(self) -> int:
        """The number of carriers."""
        return self.setting.scenario.carrier_count


class Crew:
    """A number of pickers, and the limits of its harvest.

    Its scenario has one carrier: a limit with c carriers divides the time of carriers by c.
    """

    def __init__(self, scenario: Scenario, pickers: int) -> None:
        self.scenario = with_changes(scenario, pickers=pickers, carriers=1)
        self.pickers = pickers
        # Seed -> the limit of the pickers, s.
        self._of_seeds: dict[int, float] = {}

    @cached_property
    def _layout(self) -> Layout:
        return lay_out(in_mean_rows(self.scenario))

    @cached_property
    def _bounds(self) -> Bounds:
        return limit_of_question(self.scenario)

    @cached_property
    def parts(self) -> dict[str, float]:
        """Part of the orchard -> how long the harvest takes it at least, s, with one carrier."""
        fruit = full_bins(self._layout)
        seconds = {name: fruit / rate for name, rate in self._bounds.terms.items()}
        seconds |= load_out_seconds(self._layout, fruit)
        for name, block in self._layout.blocks.items():
            times = self._bounds.of_pickers[name]
            metres = sum(self._layout.lane(row).length for row in block.rows)
            bins = self._bins_in(metres, block)
            # After its last bin the picker need not go on, so it neither crosses nor waits.
            alone = bins * times.of_picker - times.crossing - times.waiting
            seconds["pickers"] = max(seconds["pickers"], alone)
        return seconds

    def seconds_of_seed(self, seed: int) -> float:
        """Return the limit of the pickers in the rows of a seed, s. Failures are left out."""
        if seed not in self._of_seeds:
            self._of_seeds[seed] = max(self._seconds_of_shares(seed))
        return self._of_seeds[seed]

    def _seconds_of_shares(self, seed: int) -> Iterator[float]:
        """Yield for each picker how long its rows of a seed take at least, s.

        After each bin but the last one it crosses the roads, and gets an empty bin.
        """
        scenario = with_seed(self.scenario, seed)
        for name, block in self._layout.blocks.items():
            metres = 0.0
            picking = 0.0
            for row in block.rows:
                length = self._layout.lane(row).length
                metres += length
                picking += length / picking_speed_of(scenario, row, name)
            crossing = self._bounds.of_pickers[name].crossing
            between = max(0.0, self._bins_in(metres, block) - 1.0)
            yield picking + between * (crossing + handover_seconds(self._layout))

    def _bins_in(self, metres: float, block: Block) -> float:
        """Return how many bins some metres of row fill."""
        # Without `bin_metres` each row fills one bin.
        return metres / (self.scenario.bin_metres or metres / len(block.rows))

    def limit_of_seed(self, carriers: int, seed: int) -> float:
        """Return the limit with so many carriers in the rows of a seed, s."""
        others = [seconds for name, seconds in self.parts.items() if name not in OF_ROBOTS]
        return max(self.seconds_of_seed(seed), self.parts[CARRIERS] / carriers, *others)

    @property
    def without_carriers(self) -> float:
        """The limit with as many carriers as it takes, s."""
        return max(seconds for name, seconds in self.parts.items() if name != CARRIERS)

    def limit(self, carriers: int) -> tuple[float, str]:
        """Return the limit with so many carriers, s, and the part that sets it."""
        parts = self.parts | {CARRIERS: self.parts[CARRIERS] / carriers}
        part = max(parts, key=lambda name: parts[name])
        return parts[part], part


class Fleets:
    """All fleets among which the question of a user lets a study choose."""

    def __init__(
        self,
        scenario: Scenario,
        deadline: Deadline,
        pickers: Sequence[int | None],
        carriers: Sequence[int | None] | None,
    ) -> None:
        """`pickers`, `carriers`: the numbers to try; []: as many as it takes. `carriers` is None if
        they do not vary. None in a list is the number of a scenario that gives none.
        """
        self.scenario = scenario
        self.deadline = deadline
        self.is_open = not pickers
        if self.is_open:
            numbers = _worth_trying(scenario)
        else:
            numbers = [number for number in pickers if number]
        self.crews = [Crew(scenario, number) for number in sorted(numbers)]
        self.carriers = carriers
        # Numbers of pickers and carriers -> the fleet; None: the orchard has no room for it.
        self._known: dict[tuple[int, int], Fleet | None] = {}

    @cached_property
    def fleets(self) -> list[Fleet]:
        """The fleets of which the limit meets the deadline, by the least that they may cost."""
        meeting: list[Fleet] = []
        for crew in self._crews_in_time():
            meeting += filter(self.is_possible, self._fleets_of(crew))
        return sorted(meeting, key=attrgetter("least_cost", "pickers", "carriers"))

    def is_possible(self, fleet: Fleet) -> bool:
        """Whether the limit of a fleet meets the deadline."""
        return fleet.limit_seconds <= self.deadline.seconds(fleet.setting)

    def least_late(self, fleet: Fleet, count: int) -> int:
        """Return how many of the first `count` harvests must be late, by their limits."""
        most = self.deadline.seconds(fleet.setting)
        return sum(seconds > most for seconds in self._limits_of_seeds(fleet, count))

    def least_mean_cost(self, fleet: Fleet, count: int) -> float:
        """Return the mean of what the first `count` harvests of a fleet cost at least."""
        limits = self._limits_of_seeds(fleet, count)
        return fmean(self._least_cost(fleet.setting, seconds) for seconds in limits)

    def _limits_of_seeds(self, fleet: Fleet, count: int) -> list[float]:
        """Return the limits of the first `count` harvests of a fleet, s."""
        if not _rows_are_drawn(fleet.setting.scenario):
            return [fleet.limit_seconds] * count
        crew = self.crew(fleet.pickers)
        first = fleet.setting.scenario.seed
        return [crew.limit_of_seed(fleet.carriers, first + number) for number in range(count)]

    def crew(self, pickers: int) -> Crew:
        """Return the crew with this number of pickers."""
        (crew,) = [crew for crew in self.crews if crew.pickers == pickers]
        return crew

    def fleet(self, pickers: int, carriers: int) -> Fleet | None:
        """Return a fleet, the same one each time; None if the orchard has no room for it."""
        key = pickers, carriers
        if key not in self._known:
            self._known[key] = self._fleet(pickers, carriers)
        return self._known[key]

    def _fleet(self, pickers: int, carriers: int) -> Fleet | None:
        """Return a new fleet; None if the orchard has no room for it."""
        varied = {PICKERS: [pickers], CARRIERS: [carriers]}
        settings, _ = settings_of(self.scenario, varied)
        if not settings:
            return None
        (setting,) = settings
        seconds, part = self.crew(pickers).limit(carriers)
        return Fleet(setting, seconds, part, self._least_cost(setting, seconds))

    def fastest(self) -> Fleet:
        """Return the fleet of which the limit is the shortest."""
        crew = min(self.crews, key=attrgetter("without_carriers"))
        return min(self._fleets_of(crew), key=attrgetter("limit_seconds", "carriers"))

    def _fleets_of(self, crew: Crew) -> Iterator[Fleet]:
        """Yield the fleets of a crew for which the orchard has room."""
        for number in self._numbers_of_carriers(crew):
            fleet = self.fleet(crew.pickers, number)
            if fleet is not None:
                yield fleet

    def _crews_in_time(self) -> Iterator[Crew]:
        """Yield the crews that may be in time with as many carriers as it takes."""
        if not self.is_open:
            # The user's numbers are few, and each is asked for.
            yield from self.crews
            return
        # More pickers are faster, so once one is in time all larger ones are.
        first = _first(self.crews, self._may_be_in_time)
        yield from self.crews[first:]

    def _may_be_in_time(self, crew: Crew) -> bool:
        return crew.without_carriers <= self.deadline.seconds(Setting({}, crew.scenario))

    def _numbers_of_carriers(self, crew: Crew) -> list[int]:
        """Return the numbers of carriers that a study tries with a crew."""
        # The number of a scenario that gives none.
        usual = crew.scenario.model_copy(update={"carriers": None}).carrier_count
        if self.carriers is None:
            return [self.scenario.carriers or usual]
        if self.carriers:
            return [number or usual for number in self.carriers]
        most = most_carriers(crew.scenario)
        # With so many carriers they are as fast as pickers and the bay.
        busy = crew.parts[CARRIERS] / crew.without_carriers
        last = min(most, ceil(MORE * busy) + 1)
        return list(range(min(most, max(1, floor(FEWER * busy))), last + 1))

    def _least_cost(self, setting: Setting, seconds: float) -> float:
        """Return the least that a harvest in so many seconds may cost; else its robots."""
        if not setting.has_prices:
            return setting.robots
        bins = lay_out(setting.scenario).bins
        return bins * sum(setting.payments(3600.0 * bins / seconds, bins).values())


def _worth_trying(scenario: Scenario) -> list[int]:
    """Return the numbers of pickers to try: of those with the same largest share of rows the least.

    Shares are not compared where rows or pickers differ, or another rule gives the rows.
    """
    most = min(MOST_PICKERS, scenario.rows)
    numbers = range(LEAST_PICKERS, most + 1)
    are_alike = not scenario.picker_rates and not _pickers_are_drawn(scenario)
    has_equal_shares = scenario.rows_to_pickers in (BALANCED, BALANCED_ENDS)
    is_balanced = has_equal_shares and scenario.survey is None and are_alike
    possible = []
    for number in numbers:
        if is_possible(scenario, {PICKERS: number, CARRIERS: 1}):
            possible.append(number)
    if not is_balanced:
        return possible
    # The largest share of rows of a picker -> the least number of pickers with it.
    shares: dict[int, int] = {}
    for number in possible:
        shares.setdefault(ceil(scenario.rows / number), number)
    return list(shares.values())


def _pickers_are_drawn(scenario: Scenario) -> bool:
    """Whether the seed decides how fast a picker is."""
    return scenario.picking.spread_of_pickers.distribution != "none"


def _rows_are_drawn(scenario: Scenario) -> bool:
    """Whether the seed decides how long a row takes."""
    return scenario.picking.is_drawn


def _first(crews: Sequence[Crew], is_met: Callable[[Crew], bool]) -> int:
    """Return the place of the first crew for which a rule holds; len(crews) if it holds for none.

    The rule must hold for all crews after it too. A binary search asks it of a few crews only.
    """
    low = 0
    high = len(crews)
    while low < high:
        middle = (low + high) // 2
        if is_met(crews[middle]):
            high = middle
        else:
            low = middle + 1
    return low
