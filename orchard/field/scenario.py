"""The scenario: what a user can set, with its limits, and how its values are checked."""

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import reduce
from itertools import combinations
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError, model_validator

from orchard.field.decisions import Decision
from orchard.field.kinds import BODILESS, DISPATCH, KINDS, TRAFFIC, kind_of
from orchard.field.problems import (
    Lines,
    Problem,
    ScenarioError,
    Section,
    key_text,
    problem_of,
    show,
)
from orchard.field.queue import (
    LONGEST_ROW,
    MOST_CARRIERS,
    QUEUES,
    SHORTEST_ROW,
    TWO_WAY,
    USUAL_ROW,
    lack_of_room,
)
from orchard.field.survey import (
    FEWEST_ROWS,
    MOST_ROWS,
    NARROWEST_ROW,
    ROUNDING,
    TRUNK,
    WIDEST_ROW,
    Survey,
)
from orchard.field.yaml_file import dump, read, values_of

TICKS_PER_SECOND = 10
TIME_STEP = 1 / TICKS_PER_SECOND  # s
CHOICE = Decision.CHOICE
CIRCUMSTANCE = Decision.CIRCUMSTANCE
MOST_GUESTS = 50  # people together, animals together, weeds
NEAREST = "nearest"
ROLLING = "rolling"
END = "end"
# The built-in policies.
DISPATCH_POLICIES = (
    NEAREST,
    "farthest-first",
    "longest-waiting",
    "predictive",
    "predictive-farthest",
    ROLLING,
    "assignment",
)
BALANCED = "balanced"
BALANCED_ENDS = "balanced-ends"
MANUAL = "manual"
# The built-in rules for rows.
ROW_RULES = (BALANCED, BALANCED_ENDS, MANUAL)
ONWARD = "onward"
OUTWARD = "outward"
# The built-in orders of picking inside a row.
ROW_ORDERS = (ONWARD, OUTWARD)
# Names that a user's agent without a body cannot have.
RESERVED = (*BODILESS, "physics", "logger")


def _choice(names: Sequence[str], meaning: str) -> Any:
    """One of some names.

    Programs that offer a choice, such as the page, find them in `examples`.
    """
    return Field(
        pattern=rf"^({'|'.join(names)})$",
        examples=list(names),
        description=f"{meaning}: {', '.join(names)}",
    )


def _count(meaning: str) -> Any:
    """A number of people or animals."""
    return Field(ge=0, le=MOST_GUESTS, description=meaning)


class _Guests(Section):
    """Numbers of bodies that are at most 50 together."""

    @model_validator(mode="after")
    def _not_too_many(self) -> "_Guests":
        """Check the sum of all numbers."""
        counts = self.model_dump()
        self._demand(
            sum(counts.values()) <= MOST_GUESTS, f"must be at most {MOST_GUESTS} together", *counts
        )
        return self


class People(_Guests):
    """Workers and visitors: at most 50 together."""

    workers: Annotated[int, _count("number of workers, in yellow hats")] = 4
    visitors: Annotated[int, _count("number of visitors")] = 3


class Animals(_Guests):
    """Dogs and cats: at most 50 together."""

    dogs: Annotated[int, _count("number of dogs")] = 2
    cats: Annotated[int, _count("number of cats")] = 1


YIELD = "yield of rows with their trees, t/ha; null: unknown"


class Crop(Section):
    """How much fruit grows, and how much of it a bin holds: both, or neither."""

    tonnes_per_hectare: Annotated[float | None, Field(ge=1.0, le=200.0, description=YIELD)] = None
    kilograms_per_bin: Annotated[
        float | None,
        Field(ge=10.0, le=2000.0, description="fruit in a full bin, kg; null: unknown"),
    ] = None


LEAST_CV = 0.01
# Greatest cv of the part of a row's picking time that is drawn.
WIDEST = {
    "lognormal": 1.0,
    "gamma": 1.0,
    "uniform": 1.0 / math.sqrt(3.0),
}


class Spread(Section):
    """How the picking times of rows differ. Their mean is that of the picking speed."""

    distribution: Annotated[
        str, _choice(("none", *WIDEST), "distribution of the rows' picking times")
    ] = "none"
    cv: Annotated[
        float,
        Field(
            ge=LEAST_CV,
            le=1.0,
            description="standard deviation of a row's picking time, as a share of its mean",
        ),
    ] = 0.3


BETWEEN = "mean time of picking or, of a carrier, driving between failures, s; null: never"


class Failure(Section):
    """How often a robot fails while it works, and how long it then stands: exponential."""

    mean_between: Annotated[float | None, Field(ge=60.0, le=86400.0, description=BETWEEN)] = None
    mean_repair: Annotated[
        float,
        Field(ge=1.0, le=7200.0, description="mean time for which a robot that failed stands, s"),
    ] = 300.0

    @property
    def share(self) -> float:
        """The mean time of repairs for a time of work."""
        if self.mean_between is None:
            return 0.0
        return self.mean_repair / self.mean_between


class Picking(Section):
    """How picking varies."""

    spread: Annotated[Spread, Field(description="how the picking times of rows differ")] = Spread()
    failure: Annotated[
        Failure, Field(description="how often pickers fail, and for how long they stand")
    ] = Failure()


class Battery(Section):
    """How long a battery lasts, and takes to charge.

    One that is at the reserve when its carrier's job is done must charge.
    """

    hours: Annotated[
        float | None,
        Field(ge=0.05, le=200.0, description="hours of driving with a full battery; null: endless"),
        CIRCUMSTANCE,
    ] = None
    standing: Annotated[
        float,
        Field(
            ge=0.0,
            le=1.0,
            description="share of the power that a carrier uses while it stands on its way",
        ),
        CIRCUMSTANCE,
    ] = 0.2
    hours_to_charge: Annotated[
        float,
        Field(
            ge=0.01, le=48.0, description="hours to charge a flat battery; of a swap: its minutes"
        ),
        CIRCUMSTANCE,
    ] = 1.0
    reserve: Annotated[
        float,
        Field(
            ge=0.0,
            le=0.9,
            description="charge, 0 to 1, at which a carrier goes to charge after its job",
        ),
        CHOICE,
    ] = 0.2


class Carrying(Section):
    """How the work of carriers varies."""

    failure: Annotated[
        Failure,
        Field(description="how often carriers fail on a job, and for how long they stand"),
        CIRCUMSTANCE,
    ] = Failure()
    battery: Annotated[Battery, Field(description="the batteries of carriers")] = Battery()


class LaserSettings(Section):
    """Settings of all lasers."""

    noise: Annotated[
        float, Field(ge=0.0, le=0.02, description="standard deviation of a measured range, m")
    ] = 0.0


BIAS_TIME = "time in which the correlation of the slow error falls to 1/e, s"
# With larger errors, a carrier may take a picker that waits 0.25 m beside its road for one ahead of
# it.
MOST_WHITE = 0.1  # m
MOST_BIAS = 0.03  # m


class Gnss(Section):
    """Errors of receivers in x and in y: a white one, and a slow one, a Gauss-Markov process of the
    first order. See docs/reference.md.
    """

    white: Annotated[
        float,
        Field(
            ge=0.0, le=MOST_WHITE, description="standard deviation of the error new at each tick, m"
        ),
    ] = 0.0
    bias: Annotated[
        float, Field(ge=0.0, le=MOST_BIAS, description="standard deviation of the slow error, m")
    ] = 0.0
    bias_time: Annotated[float, Field(ge=1.0, le=86400.0, description=BIAS_TIME)] = 300.0


class OdometrySettings(Section):
    """Errors of the odometry of pickers, carriers and the tractor: constants, drawn for
    each robot.
    """

    distance: Annotated[
        float,
        Field(
            ge=0.0, le=0.1, description="standard deviation of the error of distances, as a share"
        ),
    ] = 0.0
    heading: Annotated[
        float,
        Field(
            ge=0.0,
            le=0.05,
            description="standard deviation of the drift of the heading, rad/m driven",
        ),
    ] = 0.0


class SensorSettings(Section):
    """Errors of what robots measure of their own motion.

    Without them what they measure is the truth.
    """

    gnss: Annotated[Gnss, Field(description="the receivers that measure where robots are")] = Gnss()
    odometry: Annotated[
        OdometrySettings, Field(description="what robots measure of their motion by their wheels")
    ] = OdometrySettings()

    @property
    def are_exact(self) -> bool:
        """Whether robots measure the truth."""
        return not any(
            (self.gnss.white, self.gnss.bias, self.odometry.distance, self.odometry.heading)
        )


HIGHEST_PRICE = 1e9  # in whatever currency


def _price(meaning: str) -> Any:
    """A price."""
    return Field(ge=0.0, le=HIGHEST_PRICE, description=meaning)


class Prices(Section):
    """What a harvest costs, in a currency of your own.

    `orchard study` tells costs if a price is given; a run does not depend on them.
    """

    picker_per_hour: Annotated[float | None, _price("price of an hour of a picker; null: none")] = (
        None
    )
    carrier_per_hour: Annotated[
        float | None, _price("price of an hour of a carrier; null: none")
    ] = None
    overhead_per_hour: Annotated[
        float | None, _price("price of an hour of all else; null: none")
    ] = None
    per_bin: Annotated[float | None, _price("price of each bin; null: none")] = None


_NAME = "[A-Za-z_][A-Za-z0-9_]*"
_PATH = rf"{_NAME}(\.{_NAME})*[.:]{_NAME}"
ClassPath = Annotated[str, Field(pattern=rf"^{_PATH}$", max_length=200)]
Driven = Annotated[str, Field(pattern=rf"^(({'|'.join(KINDS)})(_[0-9]+)?|{'|'.join(BODILESS)})$")]
Bodiless = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,63}$")]
Classes = Annotated[
    dict[Driven, ClassPath],
    Field(max_length=200, description="kind or name -> module.Class in place of the built-in one"),
]
MoreAgents = Annotated[
    dict[Bodiless, ClassPath],
    Field(max_length=200, description="name -> module.Class of another agent without a body"),
]


def _plugin(builtin: Sequence[str], meaning: str) -> Any:
    """A rule that the scenario names: a built-in one, or module.Class of a user."""
    return Field(
        pattern=rf"^({'|'.join(builtin)}|{_PATH})$",
        max_length=200,
        examples=list(builtin),
        description=f"{meaning}: {', '.join(builtin)}, or module.Class",
    )


ROWS = "number of rows to pick; of a larger orchard, simulate each block by itself"
METRES_PER_BIN = (
    "length of row that fills a bin, m; null: what bins_per_row or crop say, else each row"
    " fills one"
)
BINS_PER_ROW = (
    "number of bins that a row fills, the mean one if surveyed; null: what metres_per_bin or crop"
    " say, else 1"
)
PICKING_SPEED = "speed of a picker while it picks, m/s; null: what picking_rate says, else 1"
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
SLOWEST = 0.001  # m/s, of a picker while it picks
# Metres of row that fill a bin.
SHORTEST_BIN = 5.0
LONGEST_BIN = 200.0
CHARGERS = (
    "number of carriers that can charge at once, in lines of their own in the queue; only batteries"
    " need them"
)
# What `survey` decides.
SURVEYED = ("rows", "row_length", "row_width")


_NO_BATTERY = "has no effect: a battery is endless unless hours is set"
_NO_FAILURE = "has no effect: robots never fail unless mean_between is set"
# Field -> the field without which it has no effect, and what is said then.
_IN_VAIN = {
    "carrying.battery.standing": ("carrying.battery.hours", _NO_BATTERY),
    "carrying.battery.hours_to_charge": ("carrying.battery.hours", _NO_BATTERY),
    "carrying.battery.reserve": ("carrying.battery.hours", _NO_BATTERY),
    "picking.failure.mean_repair": ("picking.failure.mean_between", _NO_FAILURE),
    "carrying.failure.mean_repair": ("carrying.failure.mean_between", _NO_FAILURE),
    "picking.spread.cv": (
        "picking.spread.distribution",
        "has no effect: all rows are picked alike while the distribution is none",
    ),
}


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
        Field(ge=NARROWEST_ROW, le=WIDEST_ROW, description="width of a row between its trees, m"),
        CIRCUMSTANCE,
    ] = NARROWEST_ROW
    carriers: Annotated[int | None, Field(ge=1, le=MOST_CARRIERS, description=CARRIERS), CHOICE] = (
        None
    )
    queue_room: Annotated[
        int | None, Field(ge=1, le=MOST_CARRIERS, description=QUEUE_ROOM), CHOICE
    ] = None
    picking_speed: Annotated[
        float | None, Field(ge=SLOWEST, le=1.0, description=PICKING_SPEED), CIRCUMSTANCE
    ] = None
    picking_rate: Annotated[
        float | None, Field(ge=0.1, le=60.0, description=PICKING_RATE), CIRCUMSTANCE
    ] = None
    picking: Annotated[Picking, Field(description="how picking varies"), CIRCUMSTANCE] = Picking()
    carrying: Annotated[Carrying, Field(description="how the work of carriers varies")] = Carrying()
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
    weeds: Annotated[int, _count("number of weeds, north and south of the rows"), CIRCUMSTANCE] = 10
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
        _plugin(DISPATCH_POLICIES, "which carrier fetches which bin, and when it leaves"),
        CHOICE,
    ] = ROLLING
    dispatch_errors: Annotated[
        str,
        _choice((NEAREST, END), "what follows an order of an own policy that cannot be"),
        CHOICE,
    ] = NEAREST
    rows_to_pickers: Annotated[str, _plugin(ROW_RULES, "which picker picks which rows"), CHOICE] = (
        BALANCED_ENDS
    )
    order_in_row: Annotated[
        str, _plugin(ROW_ORDERS, "with several bins a row, which part is picked first"), CHOICE
    ] = ONWARD
    route: Annotated[str, _plugin(tuple(QUEUES), "where pickers and carriers drive"), CHOICE] = (
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
            return self.row_width + TRUNK
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
        return 1.0

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
        if self.picking.spread.distribution != "none":
            return True
        failures = (self.picking.failure, self.carrying.failure)
        return any(failure.mean_between is not None for failure in failures)

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
        if self.route in QUEUES:
            self._demand_room_in_the_queue()
        return self

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
        pairs = [
            ("picking_speed", "picking_rate"),
            *combinations(("metres_per_bin", "bins_per_row", CROP[0]), 2),
        ]
        for pair in pairs:
            is_one = None in [_value_at(self, field) for field in pair]
            self._demand(
                is_one, "at most one of both can be set: each says what the other is", *pair
            )
        self._demand_bins_of_a_usual_size()
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
        most = math.floor(36e5 / metres) / 1e3
        text = (
            f"must be {least:g} to {most:g} where {metres:.4g} m of row fill a bin: a"
            f" picker goes {SLOWEST:g} to 1 m/s"
        )
        self._demand(least <= self.picking_rate <= most, text, "picking_rate")

    def _demand_that_no_row_is_faster_than_a_picker(self) -> None:
        """A row takes at least the time to drive along it, so only the rest of its mean time can
        spread.
        """
        spread = self.picking.spread
        if spread.distribution == "none":
            return
        top = KINDS["picker"].speed
        most = WIDEST.get(spread.distribution, 1.0) * (1.0 - self.mean_picking_speed / top)
        if most >= LEAST_CV:
            wanted = f"cv must be at most {math.floor(most * 1e6) / 1e6:g}"
        else:
            wanted = "the distribution must be none"
        speed = "picking_speed" if self.picking_rate is None else "picking_rate"
        text = f"{wanted} at this {speed}, because no picker picks faster than {top:g} m/s"
        keys = (speed, "picking.spread.distribution", "picking.spread.cv")
        self._demand(spread.cv <= most + 1e-9, text, *keys)

    def _demand_what_the_survey_says(self) -> None:
        """Rows, their length and width are those of the survey, if there is one."""
        if self.survey is None:
            return
        length = round(self.survey.length, 6)
        wanted = {"rows": len(self.survey.rows), "row_length": length, "row_width": NARROWEST_ROW}
        wrong = [name for name in SURVEYED if abs(getattr(self, name) - wanted[name]) > ROUNDING]
        numbers = " and ".join(f"{wanted[name]:.10g}" for name in wrong)
        self._demand(not wrong, f"must be {numbers} with this survey", *wrong)


def load(path: str | Path) -> Scenario:
    """Return the scenario in a YAML file.

    Values that the file leaves out keep their defaults. Raises `ScenarioError`.
    """
    source = key_text(str(path))
    return parse(read(path, source), source)


def parse(text: str, source: str = "scenario") -> Scenario:
    """Return the scenario in a YAML text.

    `source` names the text in errors. Raises `ScenarioError`.
    """
    values, lines, repeated = values_of(text, source)
    scenario = check({} if values is None else values, source, lines, repeated)
    return with_effect(scenario, source, lines)


def with_changes(scenario: Scenario, /, **changes: Any) -> Scenario:
    """Return a scenario with some values changed, checked again.

    Raises `ScenarioError`. Name a nested value by its dotted path, or give a map of changes to a
    section: `with_changes(s, rows=8, **{"people.workers": 0})`, `with_changes(s, people={"workers":
    0})`.
    """
    values = scenario.model_dump()
    for path, value in changes.items():
        change = value
        for key in reversed(path.split(".")):
            change = {key: change}
        _merge(values, change)
    return check(values, "changes")


def with_effect(scenario: Scenario, source: str, lines: Lines | None = None) -> Scenario:
    """Return a scenario in which a user has set no value that needs another one, and lacks it.

    Settings of a study, forks and old snapshots may have such values: there another value was
    taken away. Raises `ScenarioError`.
    """
    problems = []
    for fields, text in _rules_of_effect(scenario):
        problems.append(_in_vain(scenario, source, lines or {}, fields, text))
    if problems:
        raise ScenarioError(problems, scenario)
    return scenario


def _rules_of_effect(scenario: Scenario) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the fields, and what is wrong with them, of each value that has no effect."""
    has_effect = {
        "carrying.battery.hours": scenario.has_batteries,
        "picking.failure.mean_between": scenario.picking.failure.mean_between is not None,
        "carrying.failure.mean_between": scenario.carrying.failure.mean_between is not None,
        "picking.spread.distribution": scenario.picking.spread.distribution != "none",
    }
    default = Scenario.model_construct()
    for field, (needed, text) in _IN_VAIN.items():
        is_set = _value_at(scenario, field) != _value_at(default, field)
        if is_set and not has_effect[needed]:
            yield (field, needed), text
    if scenario.chargers > default.chargers and not scenario.has_batteries:
        text = "has no effect: carriers charge only if hours is set"
        yield ("chargers", "carrying.battery.hours"), text
    if scenario.order_in_row != default.order_in_row and scenario.bin_metres is None:
        text = (
            "has no effect where each row fills one bin: metres_per_bin, bins_per_row and crop say"
            " how many"
        )
        yield ("order_in_row",), text


def _in_vain(
    scenario: Scenario, source: str, lines: Lines, fields: tuple[str, ...], text: str
) -> Problem:
    """Return a rule's problem, as those of several fields are."""
    values = []
    line = 0
    for field in fields:
        values.append(str(_value_at(scenario, field)))
        line = max(line, lines.get(tuple(field.split(".")), 0))
    return Problem(source, text, ", ".join(fields), ", ".join(values), line)


def _value_at(scenario: Scenario, path: str) -> Any:
    """Return the value of a field. `path`: dotted."""
    return reduce(getattr, path.split("."), scenario)


def to_yaml(scenario: Scenario) -> str:
    """Return all values of a scenario as YAML. `parse` reads it back to an equal scenario."""
    return dump(scenario.model_dump())


def to_short_yaml(scenario: Scenario) -> str:
    """Return the values of a scenario that differ from their defaults as YAML, a line for each
    surveyed row.
    """
    return dump(scenario.model_dump(exclude_defaults=True), default_flow_style=None, width=200)


# --- values -> Scenario, or every problem ---


def check(
    values: Any,
    source: str = "scenario",
    lines: Lines | None = None,
    known: list[Problem] | None = None,
) -> Scenario:
    """Return the scenario with these values.

    Raises a `ScenarioError` with all problems, including those in `known`.
    """
    problems = list(known or [])
    if not isinstance(values, Mapping | BaseModel):
        text = f"must be a map of keys and values, and not {show(values)}"
        raise ScenarioError([*problems, Problem(source, text)])
    errors, scenario = _errors(_plain(values))
    problems += [problem_of(error, Scenario, source, lines or {}) for error in errors]
    if problems:
        raise ScenarioError(problems, scenario)
    return scenario


def _plain(values: Any, levels: int = 3) -> Any:
    """Convert sections to dicts with printable text as keys."""
    if isinstance(values, BaseModel):
        values = values.model_dump()
    if levels == 0 or not isinstance(values, Mapping):
        return values
    return {key_text(key): _plain(value, levels - 1) for key, value in values.items()}


def _errors(values: dict[str, Any]) -> tuple[list[dict[str, Any]], Scenario]:
    """Return all errors, and the scenario without the fields of these errors.

    Pydantic ends at the first broken rule about several fields, and checks none if a field is
    invalid. So the fields of all errors are set to their defaults, which break no rule, and all is
    checked again, until every rule has been checked.
    """
    errors: list[dict[str, Any]] = []
    wrong: set[tuple[str, ...]] = set()
    while True:
        try:
            return errors, Scenario.model_validate(values)
        except ValidationError as failure:
            details = failure.errors(include_url=False)
        current = [_located(error) for error in details if not _counts_what_is_wrong(error)]
        errors += [error for error in current if wrong.isdisjoint(error["fields"])]
        paths: set[tuple[str, ...]] = set()
        for error in current:
            for field in error["fields"]:
                paths.update(_with_defaults(field))
        wrong |= paths
        values = _without(values, paths)


def _with_defaults(field: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return what is set to its default because a field is wrong: the field, or the whole survey,
    because its sizes have no default.
    """
    if field[0] == "survey":
        return [("survey",)]
    if field[0] in SURVEYED:
        return [field, ("survey",)]
    return [field]


def _counts_what_is_wrong(error: Any) -> bool:
    """Whether a list is told to be too short only because some of it is wrong, which other errors
    tell.
    """
    return bool(
        error["type"] == "too_short" and error["ctx"]["actual_length"] < len(error["input"])
    )


def _located(error: Any) -> dict[str, Any]:
    """Return an error of pydantic with the paths of the fields that it is about, and whether it is
    about a key of a map.
    """
    of_key = error["loc"][2:] == ("[key]",)
    path = tuple(map(str, error["loc"][:2] if of_key else error["loc"]))
    fields = [path]
    if error["type"] == "rule":
        fields = [(*path, *field.split(".")) for field in error["ctx"]["fields"]]
    return dict(error) | {"loc": path, "of_key": of_key, "fields": fields}


def _without(
    values: dict[str, Any], paths: set[tuple[str, ...]], at: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the values without those at some paths. `at`: the path of the values themselves."""
    kept = {}
    for key, value in values.items():
        path = (*at, key)
        if path not in paths:
            kept[key] = _without(value, paths, path) if isinstance(value, dict) else value
    return kept


def _merge(values: dict[str, Any], changes: dict[str, Any]) -> None:
    """Put changes into values, also into the maps inside them."""
    for key, change in changes.items():
        if isinstance(change, dict) and isinstance(values.get(key), dict):
            _merge(values[key], change)
        else:
            values[key] = deepcopy(change)
