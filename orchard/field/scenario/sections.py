"""The sections of a scenario: people, crop, picking, carrying, sensors, prices; their limits."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from orchard.field.kinds import KINDS
from orchard.field.problems import Section
from orchard.field.scenario.fields import CHOICE, CIRCUMSTANCE, MOST_GUESTS, choice, count, price
from orchard.field.ticks import QUICKEST_COUPLING, QUICKEST_UNCOUPLING, TIME_STEP


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

    workers: Annotated[int, count("number of workers, in yellow hats")] = 4
    visitors: Annotated[int, count("number of visitors")] = 3


class Animals(_Guests):
    """Dogs and cats: at most 50 together."""

    dogs: Annotated[int, count("number of dogs")] = 2
    cats: Annotated[int, count("number of cats")] = 1


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
        str, choice(("none", *WIDEST), "distribution of the rows' picking times")
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


TURNING = "rate at which it turns on the spot, degrees/s; its bin swings round behind it"
USUAL_TURNING = 22.5  # degrees/s
SLOWEST_TURN = 5.0
FASTEST_TURN = 60.0


PICKER_SPEED = (
    "speed of a picker where it does not pick, m/s; in its row it picks no faster, and not faster"
    " than 1 m/s"
)


class Picking(Section):
    """What pickers can, and how picking varies."""

    driving_speed: Annotated[float, Field(ge=0.5, le=2.5, description=PICKER_SPEED)] = KINDS[
        "picker"
    ].speed
    turning: Annotated[float, Field(ge=SLOWEST_TURN, le=FASTEST_TURN, description=TURNING)] = (
        USUAL_TURNING
    )
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


CARRIER_SPEED = "speed of a carrier, m/s; a bin cannot follow a faster one"


class Carrying(Section):
    """What carriers can, and how their work varies."""

    speed: Annotated[float, Field(ge=0.5, le=2.5, description=CARRIER_SPEED), CIRCUMSTANCE] = KINDS[
        "carrier"
    ].speed
    turning: Annotated[
        float, Field(ge=SLOWEST_TURN, le=FASTEST_TURN, description=TURNING), CIRCUMSTANCE
    ] = USUAL_TURNING
    failure: Annotated[
        Failure,
        Field(description="how often carriers fail on a job, and for how long they stand"),
        CIRCUMSTANCE,
    ] = Failure()
    battery: Annotated[Battery, Field(description="the batteries of carriers")] = Battery()


UNLOADING = (
    "time for which a carrier stands in the bay until its bin is empty, s, in whole ticks of 0.1 s"
)


COUPLING = "time for which a robot stands to couple a bin, s, in whole ticks of 0.1 s"
UNCOUPLING = "time for which a robot stands to uncouple a bin, s, in whole ticks of 0.1 s"
EXCHANGE = (
    "time for which a picker that has coupled an empty bin stands before it goes on, s, in whole"
    " ticks of 0.1 s"
)
# s
SHORTEST_COUPLING = QUICKEST_COUPLING * TIME_STEP
SHORTEST_UNCOUPLING = QUICKEST_UNCOUPLING * TIME_STEP
LONGEST_HANDLING = 120.0


class Handling(Section):
    """For how long bins are handled."""

    coupling: Annotated[
        float, Field(ge=SHORTEST_COUPLING, le=LONGEST_HANDLING, description=COUPLING)
    ] = SHORTEST_COUPLING
    uncoupling: Annotated[
        float, Field(ge=SHORTEST_UNCOUPLING, le=LONGEST_HANDLING, description=UNCOUPLING)
    ] = SHORTEST_UNCOUPLING
    exchange: Annotated[float, Field(ge=0.0, le=LONGEST_HANDLING, description=EXCHANGE)] = 0.0
    unloading: Annotated[float, Field(ge=5.0, le=300.0, description=UNLOADING)] = 5.0


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


class Prices(Section):
    """What a harvest costs, in a currency of your own.

    `orchard study` tells costs if a price is given; a run does not depend on them.
    """

    picker_per_hour: Annotated[float | None, price("price of an hour of a picker; null: none")] = (
        None
    )
    carrier_per_hour: Annotated[
        float | None, price("price of an hour of a carrier; null: none")
    ] = None
    overhead_per_hour: Annotated[
        float | None, price("price of an hour of all else; null: none")
    ] = None
    per_bin: Annotated[float | None, price("price of each bin; null: none")] = None
