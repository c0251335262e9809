"""The harvests of the fast model that answer published figures: see `docs/published.py`.

What goes into a harvest comes from the sources. What no source tells is that of the default
scenario: speeds of 1 m/s, two-way roads, and times to fill a bin that vary by 28 %.
"""

from collections.abc import Iterator
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.report.limits import limit_of_question, with_seed
from orchard.report.long_run import long_run

Values = dict[str, Any]

CARRIERS = (1, 2, 3, 4)
# Of trays of strawberries, see config/hand_picking.yaml. Nobody has published it of bins.
SPREAD: Values = {"spread": {"distribution": "lognormal", "cv": 0.28}}
NOBODY: Values = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}

# -- kiwifruit

# A hectare of 39 t in rows 5 m apart.
KIWIFRUIT: Values = NOBODY | {
    "rows": 26,
    "row_length": 100.0,
    "row_width": 4.5,
    "crop": {"tonnes_per_hectare": 39.0, "kilograms_per_bin": 350.0},
    "picking": SPREAD,
}
KIWIFRUIT_BY_HAND = KIWIFRUIT | {
    "pickers": 20,
    "carriers": 4,
    # A gang of 10 to 12 filled nearly 150 bins in 9 hours.
    "picking_rate": 150.0 / 9.0 / 11.0,
    "prices": {"picker_per_hour": 13.5},
}
# A gang fills a trailer of three bins together. Another tractor fetches it.
TRAILER_BINS = 3
GANGS = KIWIFRUIT | {
    "pickers": 2,
    "crop": {"tonnes_per_hectare": 39.0, "kilograms_per_bin": TRAILER_BINS * 350.0},
}
# Of 20 people: six bins in ten minutes, so a trailer of three in ten minutes for each gang.
TRAILERS_AN_HOUR_AND_PERSON = 0.6
# The people of both gangs, by the year.
PEOPLE = {"2007": 20, "2017": 25, "2013": 40}
KIWIFRUIT_ROBOTS = KIWIFRUIT | {
    "pickers": 10,
    "carriers": 2,
    # Four arms, 5.5 s a fruit of each, 3,000 fruit in a bin.
    "picking_rate": 4.0 * 3600.0 / 5.5 / 3000.0,
    # It picks 51 % of the fruit.
    "crop": {"tonnes_per_hectare": 0.51 * 39.0, "kilograms_per_bin": 350.0},
    "picking": {},
    # Day and night, for three months.
    "prices": {"picker_bought": {"price": 112_500.0, "years": 3.0, "hours_per_year": 2160.0}},
}

# -- apples

# 59.5 bins of 386 kg an acre, in rows 12 feet apart.
APPLES: Values = NOBODY | {
    "rows": 26,
    "row_length": 100.0,
    "row_width": 3.16,
    "crop": {"tonnes_per_hectare": 56.8, "kilograms_per_bin": 386.0},
    "picking": SPREAD,
}
APPLES_A_BIN = 2730.0
# 3.58 kg a minute.
PERSON_RATE = 3.58 * 60.0 / 386.0
APPLES_BY_HAND = APPLES | {
    "pickers": 10,
    "carriers": 2,
    "picking_rate": PERSON_RATE,
    "prices": {"picker_per_hour": 15.03},
}
PLATFORM_PEOPLE = 4
# Each of the four people picks 0.725 apples a second.
PLATFORMS = APPLES | {
    "pickers": 4,
    "carriers": 3,
    "picking_rate": PLATFORM_PEOPLE * 0.725 * 3600.0 / APPLES_A_BIN,
}
# "A bin every nine minutes, plus a minute for bin change."
VACUUM_PLATFORMS = APPLES | {
    "pickers": 4,
    "carriers": 3,
    "picking_rate": 60.0 / 9.0,
    "handling": {"exchange": 60.0},
}
ROBOTS_2019 = APPLES | {
    "pickers": 2,
    "carriers": 2,
    # An apple a second.
    "picking_rate": 3600.0 / APPLES_A_BIN,
    "picking": {},
}
ROBOTS_2024 = ROBOTS_2019 | {
    # 2,500 apples an hour; 43,000 apples filled 24 bins.
    "picking_rate": 2500.0 / (43_000.0 / 24.0),
}
# What a robot is worth: 8 years of 360 hours, beside hands that cost 28.26 USD a bin, with one
# person who watches it for 15.03 USD an hour.
ROBOT_HOURS = 8.0 * 360.0
HAND_COST = 28.26
WATCHING_COST = 15.03

# -- boxes and the haul

# Apples on a metre of a row, kg: 56.8 t/ha in rows 3.66 m apart.
# A metre of a row has 3.66 m2, and a t/ha is 0.1 kg/m2.
KILOGRAMS_A_METRE = 56.8 * 3.66 / 10.0
BOX_KILOGRAMS = 330.0
# Seconds for which a load is away, so that a forklift with 4 boxes brings the published 5.13 t/h.
FITTED_AWAY = 618.6
TRAIN_BINS = 6
# A tractor on the way to the pack house, m/s, as slow as all else here.
HAUL_SPEED = 1.0
HAULS = (0, 400, 800, 1200, 1600, 2000, 2400, 2800)
# Two gangs of eight, of which each fills a train of six bins.
TRAINS = APPLES | {
    "pickers": 2,
    "carriers": 2,
    "picking_rate": 8.0 * PERSON_RATE / TRAIN_BINS,
    "crop": {},
    "metres_per_bin": TRAIN_BINS * 386.0 / KILOGRAMS_A_METRE,
}
# One gang of eight, whose bins wait at the headland for a trailer of eight.
ONE_GANG = APPLES | {"pickers": 8, "carriers": 2, "picking_rate": PERSON_RATE}

# -- table grapes

GANG_OF_GRAPES = 7
CART_KILOGRAMS = 226.0
# 1,200 lb an hour of six people.
CART_HOURS = CART_KILOGRAMS / (1200.0 * 0.4536 / 6.0 * GANG_OF_GRAPES)
# Of strawberries, because nobody has published it of grapes.
GRAPES_ALONE = 0.8
# A gang fills a cart together, which drives to the road, while the next one is filled.
GRAPES = NOBODY | {
    "rows": 24,
    "row_length": 201.0,
    "row_width": 3.15,
    "pickers": 4,
    "carriers": 4,
    "picking_rate": 1.0 / CART_HOURS,
    "picking": SPREAD,
    "carrying": {"speed": 2.2},
}


def _boxes(count: int) -> Values:
    """Return a harvest in which one tractor brings so many boxes at once, and is the bottleneck."""
    return APPLES | {
        "pickers": 6,
        "carriers": 1,
        "picking_rate": 6.0,
        "dispatch": "nearest",
        "crop": {},
        "metres_per_bin": count * BOX_KILOGRAMS / KILOGRAMS_A_METRE,
        "load_out": {"seconds_away": FITTED_AWAY},
    }


def _hauled(harvest: Values, metres: int, trailers: Values) -> Values:
    """Return a harvest with a haul of so many metres."""
    if metres == 0:
        return harvest
    load_out = {"metres": float(metres), "speed": HAUL_SPEED, "trailers": trailers}
    return harvest | {"load_out": load_out}


def _harvests() -> Iterator[tuple[str, Values]]:
    yield "kiwifruit by hand", KIWIFRUIT_BY_HAND
    for year, people in PEOPLE.items():
        rate = TRAILERS_AN_HOUR_AND_PERSON * people / GANGS["pickers"]
        for carriers in CARRIERS:
            yield f"gangs {year}, {carriers}", GANGS | {"picking_rate": rate, "carriers": carriers}
    yield "kiwifruit robots", KIWIFRUIT_ROBOTS
    yield "apples by hand", APPLES_BY_HAND
    yield "platforms", PLATFORMS
    yield "vacuum platforms", VACUUM_PLATFORMS
    yield "apple robots 2019", ROBOTS_2019
    yield "apple robots 2024", ROBOTS_2024
    for count in (4, 8, 12):
        yield f"{count} boxes", _boxes(count)
    for metres in HAULS:
        yield f"train, {metres} m", _hauled(TRAINS, metres, {})
    for metres in (0, 800):
        yield f"trailer, {metres} m", _hauled(ONE_GANG, metres, {"count": 1, "bins": 8})
    yield "grapes", GRAPES


HARVESTS = dict(_harvests())


def bins_per_hour(name: str, seed: int) -> float:
    """Return the rate of one of the harvests in the long run, in rows that take their mean
    times.
    """
    scenario = with_seed(Scenario.model_validate(HARVESTS[name]), seed)
    return long_run(lay_out(scenario), limit=limit_of_question(scenario)).bins_per_hour
