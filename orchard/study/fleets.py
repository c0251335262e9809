"""The fleets among which a study with a deadline looks, each with its limit, which needs no run.

Without traffic a fleet cannot be faster than its slowest part: the picker with the most to pick,
all carriers, the bay, or the chargers. So a fleet of which the limit misses the deadline is out.
What its harvest costs at its limit is the least that it may cost.

Where rows or pickers differ, each seed has a limit of its own: that of the picker whose rows take
longest with this seed. It is much longer than that of mean rows, and needs no run either.

Of numbers of pickers that a study chooses itself, those are left out with which the picker with the
most rows has as many as with a smaller number: they cost more, and are hardly faster.
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
from orchard.field.scenario import ROW_RULES, Scenario, with_changes
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
# The parts of which the limit hangs on what varies, or on the seed.
OF_ROBOTS = (PICKERS, CARRIERS)
MOST_PICKERS = 60
LEAST_PICKERS = 2


@dataclass(frozen=True)
class Fleet:
    """A setting, and what is known of its harvest without a run."""

    setting: Setting
    limit_seconds: float
    #: The part that sets this limit.
    part: str
    #: The least that it may cost: all that is paid, or without prices the number of robots.
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
    """A number of pickers, and the limits of its harvest: those of one carrier too."""

    def __init__(self, scenario: Scenario, pickers: int) -> None:
        self.scenario = with_changes(scenario, pickers=pickers, carriers=1)
        self.pickers = pickers
        self._of_seeds: dict[int, float] = {}

    @cached_property
    def _layout(self) -> Layout:
        return lay_out(in_mean_rows(self.scenario))

    @cached_property
    def _bounds(self) -> Bounds:
        return limit_of_question(self.scenario)

    @cached_property
    def parts(self) -> dict[str, float]:
        """How long the harvest takes at least for each part, s: with one carrier."""
        fruit = full_bins(self._layout)
        seconds = {name: fruit / rate for name, rate in self._bounds.terms.items()}
        seconds |= load_out_seconds(self._layout, fruit)
        for name, block in self._layout.blocks.items():
            times = self._bounds.of_pickers[name]
            metres = sum(self._layout.lane(row).length for row in block.rows)
            bins = self._bins_in(metres, block)
            # After the last bin it need not go on.
            of_a_bin = times.picking + times.crossing + times.waiting
            alone = bins * of_a_bin - times.crossing - times.waiting
            seconds["pickers"] = max(seconds["pickers"], alone)
        return seconds

    def seconds_of_seed(self, seed: int) -> float:
        """Return the limit of the pickers in the rows of a seed, s. Failures are left out."""
        if seed not in self._of_seeds:
            self._of_seeds[seed] = max(self._seconds_of_shares(seed))
        return self._of_seeds[seed]

    def _seconds_of_shares(self, seed: int) -> Iterator[float]:
        """Yield for each picker how long its rows of a seed take at least, s.

        After the last bin it need not go on. For each other one it crosses the roads, and is handed
        an empty bin.
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
    """All fleets of a question. `pickers`, `carriers`: their numbers; none: as it takes."""

    def __init__(
        self,
        scenario: Scenario,
        deadline: Deadline,
        pickers: Sequence[int | None],
        carriers: Sequence[int | None] | None,
    ) -> None:
        """`carriers`: None if they are those of the scenario."""
        self.scenario = scenario
        self.deadline = deadline
        self.is_open = not pickers
        if self.is_open:
            numbers = _worth_trying(scenario)
        else:
            numbers = [number for number in pickers if number]
        self.crews = [Crew(scenario, number) for number in sorted(numbers)]
        self.carriers = carriers
        self._known: dict[tuple[int, int], Fleet | None] = {}

    @cached_property
    def fleets(self) -> list[Fleet]:
        """The fleets of which the limit meets the deadline: the cheapest ones first."""
        meeting: list[Fleet] = []
        for crew in self._crews_in_time():
            meeting += filter(self.is_possible, self._fleets_of(crew))
        return sorted(meeting, key=attrgetter("least_cost", "pickers", "carriers"))

    def is_possible(self, fleet: Fleet) -> bool:
        """Whether the limit of a fleet meets the deadline."""
        return fleet.limit_seconds <= self.deadline.seconds(fleet.setting)

    def least_late(self, fleet: Fleet, count: int) -> int:
        """Return how many of the first harvests of a fleet are late at least, by their limits."""
        most = self.deadline.seconds(fleet.setting)
        return sum(seconds > most for seconds in self._limits_of_seeds(fleet, count))

    def least_mean_cost(self, fleet: Fleet, count: int) -> float:
        """Return what the first harvests of a fleet cost at least, as the mean."""
        limits = self._limits_of_seeds(fleet, count)
        return fmean(self._least_cost(fleet.setting, seconds) for seconds in limits)

    def _limits_of_seeds(self, fleet: Fleet, count: int) -> list[float]:
        """Return the limit of each of the first harvests of a fleet, s."""
        if not _rows_are_drawn(fleet.setting.scenario):
            return [fleet.limit_seconds] * count
        crew = self.crew(fleet.pickers)
        first = fleet.setting.scenario.seed
        return [crew.limit_of_seed(fleet.carriers, first + number) for number in range(count)]

    def crew(self, pickers: int) -> Crew:
        """Return a crew of the question."""
        (crew,) = [crew for crew in self.crews if crew.pickers == pickers]
        return crew

    def fleet(self, pickers: int, carriers: int) -> Fleet | None:
        """Return a fleet, the same one each time; None if the orchard has no room for it."""
        key = pickers, carriers
        if key not in self._known:
            self._known[key] = self._fleet(pickers, carriers)
        return self._known[key]

    def _fleet(self, pickers: int, carriers: int) -> Fleet | None:
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
        """Yield the crews that may be in time, if they have as many carriers as it takes."""
        if not self.is_open:
            yield from self.crews
            return
        first = _first(self.crews, self._may_be_in_time)
        yield from self.crews[first:]

    def _may_be_in_time(self, crew: Crew) -> bool:
        return crew.without_carriers <= self.deadline.seconds(Setting({}, crew.scenario))

    def _numbers_of_carriers(self, crew: Crew) -> list[int]:
        """Return the numbers of carriers that a study tries with a crew."""
        usual = crew.scenario.model_copy(update={"carriers": None}).carrier_count
        if self.carriers is None:
            return [self.scenario.carriers or usual]
        if self.carriers:
            return [number or usual for number in self.carriers]
        most = most_carriers(crew.scenario)
        # With so many carriers they do not limit what pickers and the bay allow.
        busy = crew.parts[CARRIERS] / crew.without_carriers
        last = min(most, ceil(MORE * busy) + 1)
        return list(range(min(most, max(1, floor(FEWER * busy))), last + 1))

    def _least_cost(self, setting: Setting, seconds: float) -> float:
        """Return the least that the harvest of a setting may cost in so many s, or its robots."""
        if not setting.has_prices:
            return setting.robots
        bins = lay_out(setting.scenario).bins
        return bins * sum(setting.payments(3600.0 * bins / seconds, bins).values())


def _worth_trying(scenario: Scenario) -> list[int]:
    """Return the numbers of pickers of which each shortens the longest share of rows."""
    most = min(MOST_PICKERS, scenario.rows)
    numbers = range(LEAST_PICKERS, most + 1)
    are_alike = not scenario.picker_rates and not _pickers_are_drawn(scenario)
    is_balanced = (
        scenario.rows_to_pickers in ROW_RULES[:2] and scenario.survey is None and are_alike
    )
    possible = []
    for number in numbers:
        if is_possible(scenario, {PICKERS: number, CARRIERS: 1}):
            possible.append(number)
    if not is_balanced:
        return possible
    # The longest share of rows -> the least number of pickers that has it.
    shares: dict[int, int] = {}
    for number in possible:
        shares.setdefault(ceil(scenario.rows / number), number)
    return list(shares.values())


def _pickers_are_drawn(scenario: Scenario) -> bool:
    return scenario.picking.spread_of_pickers.distribution != "none"


def _rows_are_drawn(scenario: Scenario) -> bool:
    """Whether the seed decides how long a row takes."""
    return scenario.picking.spread.distribution != "none" or _pickers_are_drawn(scenario)


def _first(crews: Sequence[Crew], is_met: Callable[[Crew], bool]) -> int:
    """Return the place of the first crew for which a rule holds, if it holds for all later ones.

    It asks only a few of them.
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
