"""The prices of a scenario: what workers, robots and the rest cost."""

from typing import Annotated

from pydantic import Field, model_validator

from orchard.field.problems import Section
from orchard.field.scenario.fields import price_of

# Hours of a year of 366 days, the most in which a machine can work.
LONGEST_YEAR = 8784.0
YEARS = "years for which it is used; null: none. With hours_per_year"
HOURS_PER_YEAR = "hours a year in which it works; null: none. With years"


class Bought(Section):
    """A machine that is bought: its price is paid by the hours in which it works.

    With years and hours, and no price, a study tells what price would be paid back.
    """

    price: Annotated[float | None, price_of("price of one that is bought; null: none")] = None
    years: Annotated[float | None, Field(ge=0.1, le=100.0, description=YEARS)] = None
    hours_per_year: Annotated[
        float | None, Field(ge=1.0, le=LONGEST_YEAR, description=HOURS_PER_YEAR)
    ] = None

    @property
    def hours(self) -> float | None:
        """The hours in which it works, in all its years; None: they are not set."""
        if self.years is None or self.hours_per_year is None:
            return None
        return self.years * self.hours_per_year

    @property
    def per_hour(self) -> float:
        """What an hour costs, in the currency of the price; 0 without a price."""
        if self.price is None or self.hours is None:
            return 0.0
        return self.price / self.hours

    @model_validator(mode="after")
    def _is_whole(self) -> "Bought":
        """Check that a price has the hours over which it is spread, and hours have both keys."""
        is_whole = (self.years is None) == (self.hours_per_year is None)
        self._demand(is_whole, "must be set together", "years", "hours_per_year")
        text = "a price needs years and hours_per_year, by which it is paid"
        self._demand(self.price is None or self.hours is not None, text, "price", "years")
        return self


PICKER_PER_BIN = "piece rate: what a picker is paid for a bin, beside its hours; null: none"
PICKER_LEAST = (
    "what a picker is paid for a day at least, for hours and bins together; null: none. It needs"
    " shift"
)
PICKER_BOUGHT = "a picker that is bought: a robot"


class Prices(Section):
    """What a harvest costs, in a currency of your own. All that is set adds up.

    `orchard study` tells costs if a price is given; a run does not depend on them. Hours are
    working hours. A day that is begun is paid as a whole where a price is for a day.
    """

    picker_per_hour: Annotated[
        float | None, price_of("wage of an hour of a picker; null: none")
    ] = None
    picker_per_bin: Annotated[float | None, price_of(PICKER_PER_BIN)] = None
    picker_least_per_day: Annotated[float | None, price_of(PICKER_LEAST)] = None
    picker_bought: Annotated[Bought, Field(description=PICKER_BOUGHT)] = Bought()
    carrier_per_hour: Annotated[
        float | None, price_of("price of an hour of a carrier; null: none")
    ] = None
    carrier_per_day: Annotated[
        float | None, price_of("rent of a carrier for a day; null: none. It needs shift")
    ] = None
    carrier_bought: Annotated[Bought, Field(description="a carrier that is bought")] = Bought()
    overhead_per_hour: Annotated[
        float | None, price_of("price of an hour of all else; null: none")
    ] = None
    overhead_per_day: Annotated[
        float | None, price_of("price of a day of all else; null: none. It needs shift")
    ] = None
    per_bin: Annotated[float | None, price_of("price of each bin; null: none")] = None

    @property
    def are_of_pickers(self) -> bool:
        """Whether a price for pickers is set."""
        return _is_any_set(
            self.picker_per_hour,
            self.picker_per_bin,
            self.picker_least_per_day,
            self.picker_bought.price,
        )

    @property
    def are_of_carriers(self) -> bool:
        """Whether a price for carriers is set."""
        return _is_any_set(self.carrier_per_hour, self.carrier_per_day, self.carrier_bought.price)

    @property
    def are_set(self) -> bool:
        """Whether any price is set."""
        is_other = _is_any_set(self.overhead_per_hour, self.overhead_per_day, self.per_bin)
        return is_other or self.are_of_pickers or self.are_of_carriers

    @property
    def by_the_day(self) -> list[str]:
        """The keys of the prices for a day that are set."""
        return [key for key in BY_THE_DAY if getattr(self, key) is not None]


# The keys of all prices for a day.
BY_THE_DAY = ("picker_least_per_day", "carrier_per_day", "overhead_per_day")


def _is_any_set(*prices: float | None) -> bool:
    """Whether one of these prices is set."""
    return any(price is not None for price in prices)
