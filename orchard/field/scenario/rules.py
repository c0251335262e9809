"""The scenario: its values, and the rules about several of them.

The values stand in `orchard/field/scenario/schema.py`. Pydantic checks each value by itself, and
then calls `_check_rules`. Each rule has a method `_demand_...` here, which raises an error with the
keys and values that it is about unless the rule is met.
"""

import math
from collections.abc import Iterable
from itertools import combinations, pairwise

from pydantic import model_validator

from orchard.field.kinds import KINDS, kind_of, name_of
from orchard.field.queue import MOST_CARRIERS, QUEUES, lack_of_room
from orchard.field.scenario.names import RESERVED
from orchard.field.scenario.schema import LONGEST_BIN, SHORTEST_BIN, SLOWEST, Values
from orchard.field.scenario.sections import LEAST_CV, WIDEST, Spread
from orchard.field.scenario.ways import CROP, WAYS, value_at
from orchard.field.survey import ROUNDING, USUAL_WIDTH

# The keys that a survey decides. Without one they are free.
SURVEYED = ("rows", "row_length", "row_width")

# A number may exceed a limit that follows from others by this share, which is rounding.
SHARE_OF_ROUNDING = 1e-9
# Hours, at least, for which a picker is away or there: 36 s.
LEAST_HOURS = 0.01
# Decimals of a length in m that a user must repeat from the survey.
DECIMALS_OF_LENGTH = 6


class Scenario(Values):
    """An orchard with its robots, people, animals and weeds. Figures: docs/reference.md."""

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
        """A carrier that left with a full battery comes back with more than its reserve."""
        battery = self.carrying.battery
        load_out = self.load_out
        # Then carriers stay at the bay.
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
        """A harvest has enough bins to fill a trailer, so that at least one leaves."""
        bins = self.load_out.trailers.bins
        if bins is None:
            return
        # The bins of all fruit, and one more for each picker, because its last bin may be part
        # full.
        most = math.ceil(self.rows * self.mean_row / self._metres_per_full_bin) + self.pickers
        text = f"a trailer never fills: a harvest has {most} bins at most"
        keys = ("load_out.trailers.bins", "rows", "bins_per_row")
        self._demand(bins <= most, text, *keys)

    def _demand_room_in_the_queue(self) -> None:
        """The queue of a built-in route has places for all carriers."""
        text = lack_of_room(
            self.route, self.row_length, self.bay, self.queue_carriers, self.has_batteries
        )
        # The key that decides for how many carriers the queue has places.
        if self.queue_carriers > self.carrier_count:
            key = "queue_room"
        elif self.carriers is None:
            key = "pickers"
        else:
            key = "carriers"
        self._demand(not text, text, key, "row_length", "bay")

    def _demand_one_way_to_say_it(self) -> None:
        """At most one way to say a thing is used, and what follows from it lies within limits.

        These are the `WAYS`: a picking speed or a rate; metres per bin, bins per row, or a crop.
        """
        self._demand(
            (self.crop.tonnes_per_hectare is None) == (self.crop.kilograms_per_bin is None),
            "must be set together",
            *CROP,
        )
        for ways in WAYS:
            # The first key of a way is null if the way is not used.
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
        """The metres of row that fill a bin are within limits where they follow from other values.

        Pydantic has checked `metres_per_bin` itself.
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
        """The picking rate follows from a speed at which a picker can pick."""
        if self.picking_rate is None:
            return
        metres = self._metres_per_full_bin
        top = self.top_picking_speed
        # bins/h, of 3600 s, rounded into the limits to whole thousandths, because they are shown.
        least = math.ceil(3600e3 * SLOWEST / metres) / 1e3
        most = math.floor(3600e3 * top / metres) / 1e3
        text = (
            f"must be {least:g} to {most:g} where {metres:.4g} m of row fill a bin: a"
            f" picker goes {SLOWEST:g} to {top:g} m/s"
        )
        self._demand(least <= self.picking_rate <= most, text, "picking_rate")

    def _demand_that_no_row_is_faster_than_a_picker(self) -> None:
        """The spreads leave each row at least the time to drive along it.

        So only the rest of its mean time can vary (orchard/field/picking.py).
        """
        for key, spread in self.picking.spreads.items():
            self._demand_a_spread_that_can_be(f"picking.{key}", spread)

    def widest_cv(self, distribution: str) -> float:
        """Return the greatest cv that a spread of a distribution can have at the picking speed."""
        # The second factor is the share of a row's mean time that can vary.
        return WIDEST[distribution] * (1.0 - self.mean_picking_speed / self.top_picking_speed)

    def _demand_a_spread_that_can_be(self, path: str, spread: Spread) -> None:
        """Check that a spread leaves the time to drive along a row. `path`: of the spread."""
        if spread.distribution == "none":
            return
        top = self.top_picking_speed
        most = self.widest_cv(spread.distribution)
        if most >= LEAST_CV:
            # Rounded down, because it is shown: the shown cv must be allowed.
            wanted = f"cv must be at most {math.floor(most * 1e6) / 1e6:g}"
        else:
            wanted = "the distribution must be none"
        if self.picking_rate is None:
            speed = "picking_speed"
        else:
            speed = "picking_rate"
        text = f"{wanted} at this {speed}, because no picker picks faster than {top:g} m/s"
        keys = (speed, f"{path}.distribution", f"{path}.cv")
        self._demand(spread.cv <= most + SHARE_OF_ROUNDING, text, *keys)

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
        are_possible = all(least <= rate <= most * (1.0 + SHARE_OF_ROUNDING) for rate in rates)
        self._demand(are_possible, text, "picker_rates")

    def _demand_absences_of_pickers(self) -> None:
        """Check that absences are those of pickers, and that their hours go on.

        A picker leaves before it comes back, and comes back before it leaves again.
        """
        self._demand_known_pickers("picker_absences", self.picker_absences)
        for name, absences in self.picker_absences.items():
            # From and to of the first absence, of the second one, and so on.
            hours = [hour for absence in absences for hour in absence]
            text = (
                f"{name}: must be pairs of hours that go on, [from, to], such as [[0, 4.5], [8, 9]]"
            )
            is_in_order = all(after - before >= LEAST_HOURS for before, after in pairwise(hours))
            self._demand(is_in_order, text, "picker_absences")

    def _demand_known_pickers(self, key: str, given: Iterable[str]) -> None:
        """Check that names are those of pickers. `given`: the names, in the map of the key."""
        names = [name_of("picker", i + 1) for i in range(self.pickers)]
        unknown = [name for name in given if name not in names]
        text = (
            f"must be pickers that there are, {names[0]} to {names[-1]}; not {', '.join(unknown)}"
        )
        self._demand(not unknown, text, key)

    def _demand_what_the_survey_says(self) -> None:
        """Rows, their length and width are those of the survey, if there is one.

        The width of surveyed rows follows from their spacing, so `row_width` has its default then.
        """
        if self.survey is None:
            return
        length = round(self.survey.length, DECIMALS_OF_LENGTH)
        wanted = {"rows": len(self.survey.rows), "row_length": length, "row_width": USUAL_WIDTH}
        wrong = [name for name in SURVEYED if abs(getattr(self, name) - wanted[name]) > ROUNDING]
        numbers = " and ".join(f"{wanted[name]:.10g}" for name in wrong)
        self._demand(not wrong, f"must be {numbers} with this survey", *wrong)
