"""Figures that others published of kiwifruit, apples and table grapes, and ours beside them.

Ours follow from the rates of the harvests in `docs/published_harvests.py`. `docs/validation.py`
measures these, and writes the page. A key of the rates is the name of a harvest: "gangs 2007, 2"
are the two gangs of 2007 with two tractors that drive.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from docs.published_harvests import (
    BOX_KILOGRAMS,
    CARRIERS,
    CART_HOURS,
    GANGS,
    GRAPES_ALONE,
    HAND_COST,
    HARVESTS,
    HAULS,
    PEOPLE,
    PLATFORM_PEOPLE,
    ROBOT_HOURS,
    TRAILER_BINS,
    TRAILERS_AN_HOUR_AND_PERSON,
    WATCHING_COST,
)
from orchard.field.scenario import Scenario
from orchard.report.costs import payments_of_long_run

# Bins an hour by the name of the harvest.
Rates = Mapping[str, float]

# A fleet is enough if the best one brings less than this share more.
ENOUGH = 0.02
DAY_HOURS = 8.0

# t/h of forklifts and of trailers: the source has one range for both.
FEW_TONNES = 5.13
MANY_TONNES = 5.56

# Why a figure does not count among those that agree.
FITTED = "fitted"
HARDLY_FAILS = "could hardly fail"
ADVICE = "advice"


def _of_each(name: str, rates: Rates) -> float:
    """Return the bins an hour of each picker."""
    pickers: int = HARVESTS[name]["pickers"]
    return rates[name] / pickers


def _cost(name: str, rates: Rates) -> float:
    """Return the cost of a bin."""
    scenario = Scenario.model_validate(HARVESTS[name])
    return sum(payments_of_long_run(scenario, rates[name], None).values())


def _driving(year: str, rates: Rates) -> int:
    """Return how many tractors that drive are enough for the gangs of a year."""
    brought = {carriers: rates[f"gangs {year}, {carriers}"] for carriers in CARRIERS}
    least = (1.0 - ENOUGH) * max(brought.values())
    return min(carriers for carriers in CARRIERS if brought[carriers] >= least)


def _tractors(year: str, rates: Rates) -> float:
    """Return how many tractors are enough: those that stand with the gangs, and those that
    drive.
    """
    standing: int = GANGS["pickers"]
    return float(standing + _driving(year, rates))


def gain_of_a_third(rates: Rates) -> float:
    """Return the most that a third tractor that drives adds to two, of all years, %."""
    gains = []
    for year in PEOPLE:
        with_two = rates[f"gangs {year}, 2"]
        with_three = rates[f"gangs {year}, 3"]
        gains.append(100.0 * (with_three / with_two - 1.0))
    return max(gains)


def _bins_of_gangs(year: str, rates: Rates) -> str:
    """Return what the tractors bring, beside what people would pick that need no ways, in words."""
    driving = _driving(year, rates)
    brought = rates[f"gangs {year}, {driving}"] * TRAILER_BINS
    picked = TRAILERS_AN_HOUR_AND_PERSON * PEOPLE[year] * TRAILER_BINS
    return (
        f"{driving} drive, and bring {brought:.0f} of the {picked:.0f} bins an hour picked at most"
    )


def _robot_worth(rates: Rates) -> float:
    """Return the price at which a robot costs as much as hands."""
    saved = _of_each("apple robots 2024", rates) * HAND_COST - WATCHING_COST
    return ROBOT_HOURS * saved


def _farthest_haul(rates: Rates) -> float:
    """Return the farthest haul of a train before pickers lose time, m."""
    near = rates["train, 0 m"]
    farthest = 0
    for metres in HAULS:
        if rates[f"train, {metres} m"] < (1.0 - ENOUGH) * near:
            break
        farthest = metres
    return float(farthest)


def _lost(name: str, rates: Rates) -> float:
    """Return the share of the bins that a haul of 800 m costs, %."""
    return 100.0 * (1.0 - rates[f"{name}, 800 m"] / rates[f"{name}, 0 m"])


def _tonnes(count: int, rates: Rates) -> float:
    """Return t/h of a tractor that takes so many boxes."""
    return rates[f"{count} boxes"] * count * BOX_KILOGRAMS / 1000.0


def _gain_of_carts(rates: Rates) -> float:
    """Return how much more people pick who need not carry, %."""
    picking = _of_each("grapes", rates) * CART_HOURS
    return 100.0 * (picking / GRAPES_ALONE - 1.0)


@dataclass(frozen=True)
class Published:
    """A published figure, and how the same follows from our harvests."""

    group: str
    quantity: str
    source: str  # a key of SOURCES
    low: float
    high: float
    answer: Callable[[Rates], float]
    why: str  # it differs, or what to know if it agrees
    beside: Callable[[Rates], str] | None = None  # what our harvests say of it besides
    is_share: bool = False  # in %, and compared in points
    is_count: bool = False  # of things that come whole
    uncounted: str = ""  # why it does not count; nothing if it could fail

    def explained(self, rates: Rates) -> str:
        """Return why it differs, or what to know, with what our harvests say of it besides."""
        if self.beside is None:
            return self.why
        return f"{self.why}; {self.beside(rates)}"


FIGURES = (
    Published(
        group="Kiwifruit, by hand",
        quantity="bins an hour of 20 people",
        source="family 2007",
        low=36.0,
        high=36.0,
        answer=lambda rates: rates["kiwifruit by hand"],
        why="the rate is that of another gang, in 2010: 1.5 bins an hour and person in place of"
        " 1.8",
    ),
    Published(
        group="Kiwifruit, by hand",
        quantity="tractors for 20 people",
        source="family 2007",
        low=4.0,
        high=4.0,
        answer=lambda rates: _tractors("2007", rates),
        why="two stand with the gangs",
        beside=lambda rates: _bins_of_gangs("2007", rates),
        is_count=True,
        uncounted=HARDLY_FAILS,
    ),
    Published(
        group="Kiwifruit, by hand",
        quantity="tractors for 25 people",
        source="family 2017",
        low=4.0,
        high=4.0,
        answer=lambda rates: _tractors("2017", rates),
        why="if these are two gangs, too",
        beside=lambda rates: _bins_of_gangs("2017", rates),
        is_count=True,
        uncounted=HARDLY_FAILS,
    ),
    Published(
        group="Kiwifruit, by hand",
        quantity="tractors for 40 people",
        source="family 2013",
        low=4.0,
        high=4.0,
        answer=lambda rates: _tractors("2013", rates),
        why="if these are two gangs, too",
        beside=lambda rates: _bins_of_gangs("2013", rates),
        is_count=True,
        uncounted=HARDLY_FAILS,
    ),
    Published(
        group="Kiwifruit, by hand",
        quantity="bins a day of a picker",
        source="diary 2016",
        low=10.0,
        high=15.0,
        answer=lambda rates: DAY_HOURS * _of_each("kiwifruit by hand", rates),
        why="a day of 8 hours, without the breaks",
    ),
    Published(
        group="Kiwifruit, by hand",
        quantity="NZD for picking a bin",
        source="gang 2010",
        low=12.0,
        high=16.0,
        answer=lambda rates: _cost("kiwifruit by hand", rates),
        why="the least wage of 2012; people who are paid by the bin earn more",
    ),
    Published(
        group="Kiwifruit, by robot",
        quantity="USD for picking a bin",
        source="kiwifruit robot",
        low=20.0,
        high=20.0,
        answer=lambda rates: _cost("kiwifruit robots", rates),
        why="a claim of 2013, beside the speed that was measured in 2019; three months of 24"
        " hours a day",
    ),
    Published(
        group="Apples, by hand",
        quantity="bins a day of a picker",
        source="apples 2019",
        low=4.5,
        high=4.5,
        answer=lambda rates: DAY_HOURS * _of_each("apples by hand", rates),
        why="the rate is from Washington, the figure from New Zealand; a day of 8 hours",
    ),
    Published(
        group="Apples, by hand",
        quantity="USD for picking a bin",
        source="wages 2022",
        low=28.26,
        high=28.26,
        answer=lambda rates: _cost("apples by hand", rates),
        why="the wage is that of 2019",
    ),
    Published(
        group="Apples, by hand",
        quantity="bins a day of a person on a platform",
        source="platforms 2021",
        low=6.0,
        high=6.0,
        answer=lambda rates: DAY_HOURS * _of_each("platforms", rates) / PLATFORM_PEOPLE,
        why="less experienced people; the rate is from a few days of other crews; a day of 8 hours",
    ),
    Published(
        group="Apples, by hand",
        quantity="bins an hour of a platform with vacuum tubes",
        source="vacuum 2015",
        low=6.0,
        high=6.0,
        answer=lambda rates: _of_each("vacuum platforms", rates),
        why="it sets its bin down where it stands; here it drives to the row's end with it",
    ),
    Published(
        group="Apples, by robot",
        quantity="bins in 24 hours",
        source="robot 2024",
        low=24.0,
        high=24.0,
        answer=lambda rates: 24.0 * _of_each("apple robots 2024", rates),
        why="the rate is the season's mean, 2,500 apples an hour; on that day it was 1,790",
    ),
    Published(
        group="Apples, by robot",
        quantity="bins a day",
        source="apples 2019",
        low=20.0,
        high=20.0,
        answer=lambda rates: DAY_HOURS * _of_each("apple robots 2019", rates),
        why="its maker says faster than an apple a second, and not how much; neither are the"
        " hours of its day known",
    ),
    Published(
        group="Apples, by robot",
        quantity="USD that a robot is worth",
        source="worth 2023",
        low=55_332.0,
        high=55_332.0,
        answer=_robot_worth,
        why="they assume a prototype's speed, which the source does not tell; ours is that of 2024",
    ),
    Published(
        group="Bins by tractor",
        quantity="t/h, forklift, 4 boxes",
        source="boxes",
        low=FEW_TONNES,
        high=MANY_TONNES,
        answer=lambda rates: _tonnes(4, rates),
        why="the time away is fitted to the lower end, because the source does not tell the"
        " distance",
        uncounted=FITTED,
    ),
    Published(
        group="Bins by tractor",
        quantity="t/h, straddle trailer, 8 boxes",
        source="boxes",
        low=11.72,
        high=12.62,
        answer=lambda rates: _tonnes(8, rates),
        why="it loads itself, in less time than a forklift; here all take as long",
    ),
    Published(
        group="Bins by tractor",
        quantity="t/h, trailer, 12 boxes",
        source="boxes",
        low=FEW_TONNES,
        high=MANY_TONNES,
        answer=lambda rates: _tonnes(12, rates),
        why="a forklift loads it box by box; here a load is taken at once, however large",
    ),
    Published(
        group="The haul",
        quantity="m to which trains of 6 bins lose no time",
        source="hauls",
        low=400.0,
        high=400.0,
        answer=_farthest_haul,
        why="there the train leaves its gang; here an empty one stands with the gang by then",
        is_count=True,
    ),
    Published(
        group="The haul",
        quantity="bins lost, one trailer of 8, 800 m",
        source="hauls",
        low=0.0,
        high=0.0,
        answer=lambda rates: _lost("trailer", rates),
        why="it has no number, and a loss of 4.9 % would agree; for one gang of eight",
        is_share=True,
        uncounted=ADVICE,
    ),
    Published(
        group="Table grapes, carts",
        quantity="gain, one cart for six to eight people",
        source="carts",
        low=20.0,
        high=30.0,
        answer=_gain_of_carts,
        why="that people without carts pick for 80 % of the time is known of strawberries only",
        is_share=True,
    ),
    Published(
        group="Table grapes, carts",
        quantity="gain, one cart for six people",
        source="carts 2021",
        low=33.3,
        high=33.3,
        answer=_gain_of_carts,
        why="who pick for 80 % of the time can gain 25 % at most",
        is_share=True,
    ),
)

# What each source is, and what of the harvests comes from it.
SOURCES = {
    "family 2007": "anorchardistquilting.blogspot.com, Kiwifruit harvest, part 1, May 2007: two"
    " gangs of 10, with two tractors each, trailers of three bins, six bins in ten minutes.",
    "family 2017": "The same, Sunny harvest day, May 2017: 25 pickers, 4 tractors, three bins each."
    " The rate is that of 2007.",
    "family 2013": "The same, Kiwifruit harvest, May 2013: 40 pickers, 4 tractors. The rate is that"
    " of 2007.",
    "gang 2010": "jakandjoesexcellentadventure.blogspot.com, Kiwi picking, June 2010: a gang of 10"
    " to 12 filled nearly 150 bins in 9 hours, for 12 to 16 NZD each. The least wage of 2012,"
    " 13.50 NZD an hour: stephonahike.blogspot.com, May 2012.",
    "diary 2016": "thelogpose.wordpress.com, 31st March, Te Puke, 2016: 10 bins a day are the"
    " least, 15 are good money. From 8:30 to 17:30, with an hour of breaks:"
    " nz-adventures.blogspot.com, June 2013. The rate is that of the gang of 2010.",
    "kiwifruit robot": "Capital Press, New Zealand tests robotic kiwi picker, 13 December 2013:"
    " 100,000 to 125,000 USD, paid back in three years at 20 USD a bin, 24 hours a day. Four arms,"
    " 5.5 s a fruit, 51 % of the fruit: Williams and others, Biosystems Engineering 181 (2019). A"
    " harvest goes on for three months: Rural News, 22 March 2019.",
    "apples 2019": "Farmers Weekly NZ, 29 April 2019: a person fills 4.5 bins a day, a robot 20."
    " 3.58 kg a minute and person, Fuji: Ampatzidis and others, ASABE 121338439 (2012). 59.5 bins"
    " an acre, 386 kg a bin: Good Fruit Grower, December 2012. Faster than an apple a second: Good"
    " Fruit Grower, Creators of vacuum harvester. 2,730 apples a bin:"
    " pushpinpilgrim.blogspot.com, May 2010.",
    "wages 2022": "Good Fruit Grower, The mystery math of prevailing wages, 2022: 28.26 USD a bin."
    " 15.03 USD an hour: Capital Press on Washington, 2019. The rate as above.",
    "platforms 2021": "Waikato Times, 30 March 2021: platforms for four people, about six bins a"
    " day each. 0.72 and 0.73 apples a second and person on a platform: Good Fruit Grower, Pacing"
    " platform pickers.",
    "vacuum 2015": "Growing Produce, The state of mechanical apple harvesting, 2015: a bin every"
    " nine minutes, plus a minute for bin change.",
    "robot 2024": "AgInfo, Robotic apple picking making great strides: 43,000 apples in 24 bins, in"
    " 24 hours; 2,500 apples an hour in the mean of the season.",
    "worth 2023": "Good Fruit Grower, Robotic financing for apple farmers. 360 hours a season and 8"
    " years: Zhang and others, Transactions of the ASABE 60 (2017), and Zhang and Heinemann,"
    " HortTechnology 27 (2017). One person who watches: The Packer on FFRobotics. Wages and hands"
    " as above.",
    "boxes": "agro.icm.edu.pl: four ways to transport apples in boxes of 330 kg, in an orchard and"
    " on asphalt. It has one range for forklifts and trailers together; a straddle trailer brings"
    " the lower figure in the orchard, the higher one on asphalt.",
    "hauls": "NIAB, Equipment required for transporting fruit: within 400 m trains can drive to the"
    " pack house; from 400 to 800 m a trailer for up to eight bins. Six to eight people a gang: the"
    " same, Bin placement. The rate of a person as above, 1 m/s.",
    "carts": "burro.ai, Burros in table grapes: 20 to 30 % more with one cart for six to eight"
    " people. 226 kg: automatedwarehouseonline.com, 2022. 2.2 m/s: thespoon.tech. Rows of 201 m:"
    " dancingwithroomba.com. 1,200 lb an hour of six people: see the next one.",
    "carts 2021": "Ag Alert, 14 July 2021: with a cart six people do the work of eight.",
}
