"""The scenario: what a user can set, its limits, what follows from it, and the rules about several
of its values.
"""

import math
from collections.abc import Iterable
from functools import reduce
from itertools import combinations, pairwise
from statistics import fmean
from typing import Annotated, Any

from pydantic import Field, model_validator

from orchard.field.kinds import DISPATCH, KINDS, TRAFFIC, kind_of, name_of
from orchard.field.problems import Section
from orchard.field.queue import (
    LONGEST_ROW,
    MOST_CARRIERS,
    QUEUES,
    SHORTEST_ROW,
    TWO_WAY,
    USUAL_ROW,
    lack_of_room,
)
from orchard.field.scenario.fields import (
    CHOICE,
    CIRCUMSTANCE,
    Classes,
    MoreAgents,
    PickerAbsences,
    PickerRates,
    choice,
    count,
    plugin,
)
from orchard.field.scenario.names import (
    BALANCED_ENDS,
    DISPATCH_POLICIES,
    END,
    NEAREST,
    ONWARD,
    RESERVED,
    ROLLING,
    ROW_ORDERS,
    ROW_RULES,
)
from orchard.field.scenario.prices import Prices
from orchard.field.scenario.sections import (
    LEAST_CV,
    WIDEST,
    Animals,
    Carrying,
    Crop,
    Handling,
    LaserSettings,
    LoadOut,
    People,
    Picking,
    SensorSettings,
    Spread,
)
from orchard.field.scenario.shift import WorkShift
from orchard.field.survey import (
    FEWEST_ROWS,
    MOST_ROWS,
    NARROWEST_ROW,
    ROUNDING,
    TRUNK,
    USUAL_WIDTH,
    WIDEST_ROW,
    Survey,
    spacing_of,
)

ROWS = "number of rows to pick; of a larger orchard, simulate each block by itself"
ROW_WIDTH = f"width of a row between its trees, m; from row to row it is {TRUNK:g} m more"
METRES_PER_BIN = (
    "length of row that fills a bin, m; null: what bins_per_row or crop say, else each row"
    " fills one"
)
BINS_PER_ROW = (
    "number of bins that a row fills, the mean one if surveyed; null: what metres_per_bin or crop"
    " say, else 1"
)
PICKING_SPEED = (
    "speed of a picker while it picks, m/s; null: what picking_rate says, else 1, or what it drives"
    " if that is less"
)
PICKING_RATE = (
    "what a picker fills while it picks, bins/h; of a person: 1.2 to 1.8; null: what picking_speed"
    " says"
)
CARRIERS = "number of carriers; null: 7 for every 10 pickers, rounded up"
QUEUE_ROOM = (
    "number of carriers for which the queue has places; null, or less than there are: as many as"
    " there are"
)


CROP = ("crop.tonnes_per_hectare", "crop.kilograms_per_bin")
# Each line has the ways to say one thing, by their keys. At most one way can be used.
WAYS: tuple[tuple[tuple[str, ...], ...], ...] = (
    (("picking_speed",), ("picking_rate",)),
    (("metres_per_bin",), ("bins_per_row",), CROP),
    (("load_out.metres", "load_out.speed", "load_out.seconds"), ("load_out.seconds_away",)),
)
# m/s, of a picker while it picks.
SLOWEST = 0.001
FASTEST = 1.0
# Metres of row that fill a bin.
SHORTEST_BIN = 5.0
LONGEST_BIN = 400.0
CHARGERS = (
    "number of carriers that can charge at once, in lines of their own in the queue; only batteries"
    " need them"
)
# What `survey` decides.
SURVEYED = ("rows", "row_length", "row_width")

BAYS = (
    "number of carriers that unload at a time: those behind the first one do it where they stand"
    " in its line"
)


class Scenario(Section):
    """An orchard with its robots, people, animals and weeds. Figures: docs/reference.md."""

    rows: Annotated[int, Field(ge=FEWEST_ROWS, le=MOST_ROWS, description=ROWS), CIRCUMSTANCE] = 5
    pickers: Annotated[
        int,
        Field(ge=2, le=60, description="number of picking robots; at most one for each row"),
        CHOICE,
    ] = 2
    row_length: Annotated[
        float,
        Field(ge=SHORTEST_ROW, le=LONGEST_ROW, description="length of the picked part of a row, m"),
        CIRCUMSTANCE,
    ] = USUAL_ROW
    metres_per_bin: Annotated[
        float | None,
        Field(ge=SHORTEST_BIN, le=LONGEST_BIN, description=METRES_PER_BIN),
        CIRCUMSTANCE,
    ] = None
    bins_per_row: Annotated[
        float | None, Field(ge=0.1, le=40.0, description=BINS_PER_ROW), CIRCUMSTANCE
    ] = None
    crop: Annotated[
        Crop,
        Field(description="the yield and the bins, from which follow the metres per bin"),
        CIRCUMSTANCE,
    ] = Crop()
    row_width: Annotated[
        float,
        Field(ge=NARROWEST_ROW, le=WIDEST_ROW, description=ROW_WIDTH),
        CIRCUMSTANCE,
    ] = USUAL_WIDTH
    carriers: Annotated[int | None, Field(ge=1, le=MOST_CARRIERS, description=CARRIERS), CHOICE] = (
        None
    )
    queue_room: Annotated[
        int | None, Field(ge=1, le=MOST_CARRIERS, description=QUEUE_ROOM), CHOICE
    ] = None
    picking_speed: Annotated[
        float | None, Field(ge=SLOWEST, le=FASTEST, description=PICKING_SPEED), CIRCUMSTANCE
    ] = None
    picking_rate: Annotated[
        float | None, Field(ge=0.1, le=60.0, description=PICKING_RATE), CIRCUMSTANCE
    ] = None
    picking: Annotated[
        Picking, Field(description="what pickers can, and how picking varies"), CIRCUMSTANCE
    ] = Picking()
    picker_rates: Annotated[PickerRates, CIRCUMSTANCE] = {}
    picker_absences: Annotated[PickerAbsences, CIRCUMSTANCE] = {}
    carrying: Annotated[
        Carrying, Field(description="what carriers can, and how their work varies")
    ] = Carrying()
    handling: Annotated[
        Handling, Field(description="for how long bins are handled"), CIRCUMSTANCE
    ] = Handling()
    load_out: Annotated[LoadOut, Field(description="where full bins go from the bay")] = LoadOut()
    chargers: Annotated[int, Field(ge=0, le=MOST_CARRIERS, description=CHARGERS), CHOICE] = 1
    seed: Annotated[
        int,
        Field(
            ge=0,
            le=2**63 - 1,
            description="seed of all random numbers; the same seed gives the same harvest",
        ),
        CIRCUMSTANCE,
    ] = 1
    people: Annotated[People, Field(description="workers and visitors"), CIRCUMSTANCE] = People()
    animals: Annotated[Animals, Field(description="dogs and cats"), CIRCUMSTANCE] = Animals()
    weeds: Annotated[int, count("number of weeds, north and south of the rows"), CIRCUMSTANCE] = 10
    tractor: Annotated[
        bool, Field(description="whether a tractor drives up and down the driveway"), CIRCUMSTANCE
    ] = True
    laser: Annotated[
        LaserSettings, Field(description="the laser range finders of all bodies"), CIRCUMSTANCE
    ] = LaserSettings()
    sensors: Annotated[
        SensorSettings, Field(description="what robots measure of their own motion"), CIRCUMSTANCE
    ] = SensorSettings()
    agents: Annotated[Classes, CHOICE] = {}
    agents_without_body: Annotated[MoreAgents, CHOICE] = {}
    dispatch: Annotated[
        str,
        plugin(DISPATCH_POLICIES, "which carrier fetches which bin, and when it leaves"),
        CHOICE,
    ] = ROLLING
    dispatch_errors: Annotated[
        str,
        choice((NEAREST, END), "what follows an order of an own policy that cannot be"),
        CHOICE,
    ] = NEAREST
    rows_to_pickers: Annotated[str, plugin(ROW_RULES, "which picker picks which rows"), CHOICE] = (
        BALANCED_ENDS
    )
    order_in_row: Annotated[
        str, plugin(ROW_ORDERS, "with several bins a row, which part is picked first"), CHOICE
    ] = ONWARD
    route: Annotated[str, plugin(tuple(QUEUES), "where pickers and carriers drive"), CHOICE] = (
        TWO_WAY
    )
    bay: Annotated[
        float,
        Field(
            ge=0.0,
            le=180.0,
            description="how far east of its usual place the unloading bay lies, m",
        ),
        CHOICE,
    ] = 0.0
    bays: Annotated[int, Field(ge=1, le=3, description=BAYS), CHOICE] = 1
    shift: Annotated[
        WorkShift, Field(description="the working day; it changes no run"), CIRCUMSTANCE
    ] = WorkShift()
    prices: Annotated[
        Prices, Field(description="what a harvest costs, for a study"), CIRCUMSTANCE
    ] = Prices()
    survey: Annotated[
        Survey | None,
        Field(description="surveyed rows, unequal in length and spacing; null: all rows are alike"),
        CIRCUMSTANCE,
    ] = None

    @property
    def carrier_count(self) -> int:
        """The number of carriers, by default 7 for every 10 pickers, rounded up (manual)."""
        if self.carriers is not None:
            return self.carriers
        return math.ceil(self.pickers * 7 / 10)

    @property
    def queue_carriers(self) -> int:
        """The number of carriers for which the queue has places."""
        return max(self.carrier_count, self.queue_room or 0)

    @property
    def bin_metres(self) -> float | None:
        """The metres of row that fill a bin: `metres_per_bin`, or what `bins_per_row` or `crop`
        say; None: each row fills one.
        """
        if self.bins_per_row is not None:
            return self.mean_row / self.bins_per_row
        tonnes_per_hectare = self.crop.tonnes_per_hectare
        kilograms_per_bin = self.crop.kilograms_per_bin
        if tonnes_per_hectare is None or kilograms_per_bin is None:
            return self.metres_per_bin
        # 1 t/ha is 0.1 kg/m2.
        kilograms_per_metre = 0.1 * tonnes_per_hectare * self.row_pitch
        return kilograms_per_bin / kilograms_per_metre

    @property
    def mean_row(self) -> float:
        """The length of a row, m; the mean, if they are surveyed."""
        if self.survey is None:
            return self.row_length
        return fmean(row.length for row in self.survey.rows)

    @property
    def row_pitch(self) -> float:
        """From the centre line of a row to that of the next one, m; the mean, if they are
        surveyed.
        """
        if self.survey is None:
            return spacing_of(self.row_width)
        souths = [row.south for row in self.survey.rows]
        return (souths[-1] - souths[0]) / (len(souths) - 1)

    @property
    def mean_picking_speed(self) -> float:
        """The speed of a picker while it picks, m/s: `picking_speed`, or what
        `picking_rate` says.
        """
        if self.picking_rate is not None:
            return self.picking_rate * self._metres_per_full_bin / 3600.0
        if self.picking_speed is not None:
            return self.picking_speed
        return self.top_picking_speed

    @property
    def top_picking_speed(self) -> float:
        """The speed at which a picker picks at most, m/s: as fast as it drives, up to FASTEST."""
        return min(FASTEST, self.picking.driving_speed)

    @property
    def chosen(self) -> dict[str, float]:
        """What holds where a value is null, by its key: numbers that follow from other values."""
        return {
            "carriers": self.carrier_count,
            "picking_speed": self.mean_picking_speed,
            "picking_rate": 3600.0 * self.mean_picking_speed / self._metres_per_full_bin,
            "metres_per_bin": self._metres_per_full_bin,
            "bins_per_row": self.mean_row / self._metres_per_full_bin,
        }

    @property
    def _metres_per_full_bin(self) -> float:
        """Metres of row that fill a bin; if each row fills one, of the mean row."""
        return self.bin_metres or self.mean_row

    @property
    def has_batteries(self) -> bool:
        """Whether carriers must charge."""
        return self.carrying.battery.hours is not None

    @property
    def work_is_drawn(self) -> bool:
        """Whether the seed changes how long robots work."""
        spreads = (self.picking.spread, self.picking.spread_of_pickers)
        for spread in spreads:
            if spread.distribution != "none":
                return True
        for failure in (self.picking.failure, self.carrying.failure):
            if failure.mean_between is not None:
                return True
        return False

    @property
    def bodiless_agents(self) -> tuple[str, ...]:
        """The agents without a body: `traffic`, `dispatch` if the policy is not `nearest`, and
        those of the user.
        """
        desks = [TRAFFIC]
        if self.dispatch != NEAREST:
            desks.append(DISPATCH)
        return (*desks, *sorted(self.agents_without_body))

    @property
    def own_classes(self) -> dict[str, str]:
        """The classes and functions of a user's own that it names, by the key of a rule or the
        agent that names them: code.
        """
        return self.agents | self.agents_without_body | self._own_rules

    @property
    def without_code(self) -> "Scenario":
        """The same with the default for each rule of a user's own: the names of the bodies, and
        walls and trees, are as they were.
        """
        return self.model_copy(
            update={name: type(self).model_fields[name].default for name in self._own_rules}
        )

    @property
    def _own_rules(self) -> dict[str, str]:
        """The rules that are not built in: key -> path of the user's class or function."""
        own = {}
        for key, field in type(self).model_fields.items():
            path = getattr(self, key)
            if field.examples and path not in field.examples:
                own[key] = path
        return own

    @model_validator(mode="after")
    def _check_rules(self) -> "Scenario":
        """Check all rules about several values."""
        self._demand_what_the_survey_says()
        taken = [name for name in self.agents_without_body if kind_of(name) in (*KINDS, *RESERVED)]
        self._demand(
            not taken,
            f"must be names that no other agent has; not {', '.join(taken)}",
            "agents_without_body",
        )
        self._demand(
            self.pickers <= self.rows, "must be at most one picker a row", "pickers", "rows"
        )
        self._demand_one_way_to_say_it()
        text = (
            f"must be 1 to {MOST_CARRIERS} chargers for carriers with batteries; without chargers,"
            " hours must be null"
        )
        self._demand(
            self.chargers > 0 or not self.has_batteries, text, "chargers", "carrying.battery.hours"
        )
        self._demand_that_no_row_is_faster_than_a_picker()
        self._demand_rates_of_pickers()
        self._demand_absences_of_pickers()
        self._demand_days_for_their_prices()
        self._demand_a_battery_for_the_load_out()
        self._demand_trailers_that_fill()
        if self.route in QUEUES:
            self._demand_room_in_the_queue()
        return self

    def _demand_days_for_their_prices(self) -> None:
        """Check that there are days if something is paid by the day."""
        for key in self.prices.by_the_day:
            text = "a price for a day needs a day: set shift.begin and shift.end"
            self._demand(self.shift.is_set, text, f"prices.{key}", "shift.begin", "shift.end")

    def _demand_a_battery_for_the_load_out(self) -> None:
        """A carrier comes back from the load-out with more than its reserve, if it left full."""
        battery = self.carrying.battery
        load_out = self.load_out
        if load_out.has_trailers:
            return
        driven = battery.as_driven(load_out.seconds_on_the_way, load_out.seconds)
        used = battery.share_used(driven)
        text = (
            f"a way to the load-out and back uses {used:.2g} of a battery; must be less than"
            f" {1.0 - battery.reserve:.2g}, what is above the reserve"
        )
        if load_out.seconds_away is None:
            key = "metres"
        else:
            key = "seconds_away"
        keys = ("carrying.battery.hours", "carrying.battery.reserve", f"load_out.{key}")
        self._demand(used < 1.0 - battery.reserve, text, *keys)

    def _demand_trailers_that_fill(self) -> None:
        """A harvest has the bins for a trailer, so that one leaves before it ends."""
        bins = self.load_out.trailers.bins
        if bins is None:
            return
        # The last bin of each picker may be part full.
        most = math.ceil(self.rows * self.mean_row / self._metres_per_full_bin) + self.pickers
        text = f"a trailer never fills: a harvest has {most} bins at most"
        keys = ("load_out.trailers.bins", "rows", "bins_per_row")
        self._demand(bins <= most, text, *keys)

    def _demand_room_in_the_queue(self) -> None:
        """The queue has places for all carriers."""
        text = lack_of_room(
            self.route, self.row_length, self.bay, self.queue_carriers, self.has_batteries
        )
        # The key that says how many carriers there are.
        if self.queue_carriers > self.carrier_count:
            key = "queue_room"
        elif self.carriers is None:
            key = "pickers"
        else:
            key = "carriers"
        self._demand(not text, text, key, "row_length", "bay")

    def _demand_one_way_to_say_it(self) -> None:
        """A picking speed or a rate; metres per bin, bins per row, or a crop; and what follows from
        them lies within the limits.
        """
        self._demand(
            (self.crop.tonnes_per_hectare is None) == (self.crop.kilograms_per_bin is None),
            "must be set together",
            *CROP,
        )
        for ways in WAYS:
            for (first, *_), (second, *_) in combinations(ways, 2):
                is_one = value_at(self, first) is None or value_at(self, second) is None
                text = "at most one of both can be set: each says what the other is"
                self._demand(is_one, text, first, second)
        self._demand_bins_of_a_usual_size()
        text = f"must be at most the speed at which pickers drive, {self.top_picking_speed:g} m/s"
        is_met = self.picking_speed is None or self.picking_speed <= self.top_picking_speed
        self._demand(is_met, text, "picking_speed", "picking.driving_speed")
        self._demand_a_rate_that_a_picker_can_have()

    def _demand_bins_of_a_usual_size(self) -> None:
        """The metres of row that fill a bin are within their limits, also where they follow from
        other values.
        """
        metres = self.bin_metres
        if metres is None or metres == self.metres_per_bin:
            return
        text = (
            f"a bin would fill in {metres:.4g} m of row; must be {SHORTEST_BIN:g} to"
            f" {LONGEST_BIN:g} m"
        )
        keys: tuple[str, ...] = ("bins_per_row", "row_length")
        if self.bins_per_row is None:
            keys = (*CROP, "row_width")
        self._demand(SHORTEST_BIN <= metres <= LONGEST_BIN, text, *keys)

    def _demand_a_rate_that_a_picker_can_have(self) -> None:
        """The picking rate makes a speed that a picker can drive."""
        if self.picking_rate is None:
            return
        metres = self._metres_per_full_bin
        least = math.ceil(36e5 * SLOWEST / metres) / 1e3
        top = self.top_picking_speed
        most = math.floor(36e5 * top / metres) / 1e3
        text = (
            f"must be {least:g} to {most:g} where {metres:.4g} m of row fill a bin: a"
            f" picker goes {SLOWEST:g} to {top:g} m/s"
        )
        self._demand(least <= self.picking_rate <= most, text, "picking_rate")

    def _demand_that_no_row_is_faster_than_a_picker(self) -> None:
        """A row takes at least the time to drive along it, so only the rest of its mean time can
        spread.
        """
        self._demand_a_spread_that_can_be("picking.spread", self.picking.spread)
        self._demand_a_spread_that_can_be(
            "picking.spread_of_pickers", self.picking.spread_of_pickers
        )

    def _demand_a_spread_that_can_be(self, path: str, spread: Spread) -> None:
        """Check that a spread leaves the time to drive along a row. `path`: of the spread."""
        if spread.distribution == "none":
            return
        top = self.top_picking_speed
        most = WIDEST.get(spread.distribution, 1.0) * (1.0 - self.mean_picking_speed / top)
        if most >= LEAST_CV:
            wanted = f"cv must be at most {math.floor(most * 1e6) / 1e6:g}"
        else:
            wanted = "the distribution must be none"
        if self.picking_rate is None:
            speed = "picking_speed"
        else:
            speed = "picking_rate"
        text = f"{wanted} at this {speed}, because no picker picks faster than {top:g} m/s"
        keys = (speed, f"{path}.distribution", f"{path}.cv")
        self._demand(spread.cv <= most + 1e-9, text, *keys)

    def _demand_rates_of_pickers(self) -> None:
        """Check that the rates are those of pickers, and that no picker is faster than it can."""
        self._demand_known_pickers("picker_rates", self.picker_rates)
        least = SLOWEST / self.mean_picking_speed
        most = self.top_picking_speed / self.mean_picking_speed
        text = (
            f"must be {least:.3g} to {most:.4g} each: a picker goes {SLOWEST:g} to"
            f" {self.top_picking_speed:g} m/s"
        )
        rates = self.picker_rates.values()
        are_possible = all(least <= rate <= most * (1.0 + 1e-9) for rate in rates)
        self._demand(are_possible, text, "picker_rates")

    def _demand_absences_of_pickers(self) -> None:
        """Check that those who are away are pickers, and that each leaves before it comes back."""
        self._demand_known_pickers("picker_absences", self.picker_absences)
        for name, absences in self.picker_absences.items():
            hours = [hour for absence in absences for hour in absence]
            text = (
                f"{name}: must be pairs of hours that go on, [from, to], such as [[0, 4.5], [8, 9]]"
            )
            is_in_order = all(after - before >= 0.01 for before, after in pairwise(hours))
            self._demand(is_in_order, text, "picker_absences")

    def _demand_known_pickers(self, key: str, given: Iterable[str]) -> None:
        """Check that names are those of pickers."""
        names = [name_of("picker", i + 1) for i in range(self.pickers)]
        unknown = [name for name in given if name not in names]
        text = (
            f"must be pickers that there are, {names[0]} to {names[-1]}; not {', '.join(unknown)}"
        )
        self._demand(not unknown, text, key)

    def _demand_what_the_survey_says(self) -> None:
        """Rows, their length and width are those of the survey, if there is one."""
        if self.survey is None:
            return
        length = round(self.survey.length, 6)
        wanted = {"rows": len(self.survey.rows), "row_length": length, "row_width": USUAL_WIDTH}
        wrong = [name for name in SURVEYED if abs(getattr(self, name) - wanted[name]) > ROUNDING]
        numbers = " and ".join(f"{wanted[name]:.10g}" for name in wrong)
        self._demand(not wrong, f"must be {numbers} with this survey", *wrong)


def value_at(scenario: Scenario, path: str) -> Any:
    """Return the value of a field. `path`: dotted."""
    return reduce(getattr, path.split("."), scenario)


def other_ways(path: str) -> list[str]:
    """Return the keys that say in another way what this one says: at most one way can be used.

    `path`: dotted.

    >>> other_ways("bins_per_row")
    ['metres_per_bin', 'crop.tonnes_per_hectare', 'crop.kilograms_per_bin']
    """
    others = []
    for ways in WAYS:
        if any(path in way for way in ways):
            others += [key for way in ways if path not in way for key in way]
    return others
