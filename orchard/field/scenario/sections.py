"""The sections of a scenario, with their limits: people, animals, crop, picking, carrying, handling
of bins, and load-out.

The sections of sensors, of the working day and of prices stand in `sensors`, `shift` and `prices`
beside this file.
"""

import math
from typing import Annotated

from pydantic import Field, model_validator

from orchard.field.kinds import KINDS
from orchard.field.problems import Section
from orchard.field.scenario.fields import (
    CHOICE,
    CIRCUMSTANCE,
    MOST_GUESTS,
    choice,
    count,
)
from orchard.field.ticks import QUICKEST_COUPLING, QUICKEST_UNCOUPLING, TIME_STEP


class _Guests(Section):
    """Numbers of bodies that are at most MOST_GUESTS together."""

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


# A cv is a standard deviation as a share of the mean (coefficient of variation).
LEAST_CV = 0.01
# Distribution -> greatest cv of the part of a row's picking time that is drawn. It must not be
# negative: a uniform number with mean 1 reaches down to 1 - sqrt(3) * cv.
WIDEST = {
    "lognormal": 1.0,
    "gamma": 1.0,
    "uniform": 1.0 / math.sqrt(3.0),
}


class Spread(Section):
    """How the picking times of rows, of pickers or of bins differ. Their mean is that of the
    speed.
    """

    distribution: Annotated[str, choice(("none", *WIDEST), "distribution of the picking times")] = (
        "none"
    )
    cv: Annotated[
        float,
        Field(
            ge=LEAST_CV,
            le=1.0,
            description="standard deviation of the picking time, as a share of its mean",
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
        """The mean time of repairs, as a share of the time of work; 0 without failures."""
        if self.mean_between is None:
            return 0.0
        return self.mean_repair / self.mean_between


TURNING = "rate at which it turns on the spot, degrees/s; its bin swings round behind it"
# degrees/s: the usual rate is pi/8 rad/s, that of the manual.
USUAL_TURNING = 22.5
SLOWEST_TURN = 5.0
FASTEST_TURN = 60.0


PICKER_SPEED = (
    "speed of a picker where it does not pick, m/s; in its row it picks no faster, and not faster"
    " than 1 m/s"
)


# The keys of `Picking` that are a Spread.
SPREADS = ("spread_of_pickers", "spread_of_bins", "spread")


class Picking(Section):
    """What pickers can, and how picking varies."""

    driving_speed: Annotated[float, Field(ge=0.5, le=2.5, description=PICKER_SPEED)] = KINDS[
        "picker"
    ].speed
    turning: Annotated[float, Field(ge=SLOWEST_TURN, le=FASTEST_TURN, description=TURNING)] = (
        USUAL_TURNING
    )
    spread_of_pickers: Annotated[
        Spread, Field(description="how the mean picking times of pickers differ")
    ] = Spread()
    spread_of_bins: Annotated[
        Spread, Field(description="how the picking times of bins of the same row differ")
    ] = Spread()
    spread: Annotated[Spread, Field(description="how the picking times of rows differ")] = Spread()
    failure: Annotated[
        Failure, Field(description="how often pickers fail, and for how long they stand")
    ] = Failure()

    @property
    def spreads(self) -> dict[str, Spread]:
        """All spreads, by their keys."""
        return {key: getattr(self, key) for key in SPREADS}

    @property
    def is_drawn(self) -> bool:
        """Whether the seed decides for how long pickers pick."""
        return any(spread.distribution != "none" for spread in self.spreads.values())

    @property
    def in_mean_times(self) -> "Picking":
        """The same without spreads: all picking takes its mean time."""
        return self.model_copy(update=dict.fromkeys(SPREADS, Spread()))


class Battery(Section):
    """How long a battery lasts, and takes to charge.

    A carrier whose battery is at the reserve when its job is done goes to charge.
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

    def as_driven(self, driving: float, standing: float) -> float:
        """Return the time of driving that uses as much charge as some driving and some standing.

        All three times are in the same unit.
        """
        return driving + self.standing * standing

    def share_used(self, driven_seconds: float) -> float:
        """Return which share of a full battery some driving uses; 0 if the battery is endless."""
        if self.hours is None:
            return 0.0
        return driven_seconds / (3600.0 * self.hours)


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


METRES_TO_LOAD_OUT = (
    "way from the bay to the load-out, m; null: no load-out, or seconds_away says it"
)
SPEED_TO_LOAD_OUT = "speed on the way to the load-out and back, m/s; null: as metres"
SECONDS_AT_LOAD_OUT = "time at the load-out, s"
SECONDS_AWAY = (
    "time for which a carrier is away at the load-out, s, ways included; its battery counts all of"
    " it as driven; null: no load-out, or metres say it"
)


TRAILER_COUNT = "number of trailers at the bay; null: none, carriers go to the load-out themselves"
TRAILER_BINS = "number of bins with which a trailer drives to the load-out; null: as count"


class Trailers(Section):
    """Trailers that stand at the bay, and take the bins of carriers to the load-out.

    A carrier swaps its full bin for an empty one there. It waits while no trailer stands there.
    """

    count: Annotated[int | None, Field(ge=1, le=20, description=TRAILER_COUNT), CHOICE] = None
    bins: Annotated[int | None, Field(ge=1, le=40, description=TRAILER_BINS), CHOICE] = None

    @model_validator(mode="after")
    def _both_or_neither(self) -> "Trailers":
        """Check that both are set, how many trailers there are and how many bins each takes."""
        self._demand(
            (self.count is None) == (self.bins is None), "must be set together", "count", "bins"
        )
        return self


TRUCK_EVERY = (
    "time from one truck to the next, s; the first one comes after this time; null: no truck"
)
TRUCK_BINS = "number of full bins that a truck takes from the bay at most; null: no truck"


class Truck(Section):
    """A truck that comes to the bay again and again: it takes full bins, and leaves as many empty
    ones.
    """

    every: Annotated[
        float | None, Field(ge=60.0, le=86400.0, description=TRUCK_EVERY), CIRCUMSTANCE
    ] = None
    bins: Annotated[int | None, Field(ge=1, le=200, description=TRUCK_BINS), CIRCUMSTANCE] = None

    @model_validator(mode="after")
    def _both_or_neither(self) -> "Truck":
        """Check that both are set, when the truck comes and how many bins it takes."""
        self._demand(
            (self.every is None) == (self.bins is None), "must be set together", "every", "bins"
        )
        return self


EMPTY_BINS = (
    "number of empty bins at the bay at first, beside those of the robots; a trailer or the truck"
    " brings as many back as it took; null: endless"
)


class LoadOut(Section):
    """Where full bins go from the bay.

    Without a load-out a carrier that has unloaded in the bay goes to the queue. With a load-out it
    first drives there and back; the scenario sets the way and the speed, or the time. With trailers
    these drive to the load-out, and carriers stay. With a truck no load-out is needed.
    """

    metres: Annotated[
        float | None, Field(ge=1.0, le=5000.0, description=METRES_TO_LOAD_OUT), CIRCUMSTANCE
    ] = None
    speed: Annotated[
        float | None, Field(ge=0.5, le=15.0, description=SPEED_TO_LOAD_OUT), CIRCUMSTANCE
    ] = None
    seconds: Annotated[
        float, Field(ge=0.0, le=3600.0, description=SECONDS_AT_LOAD_OUT), CIRCUMSTANCE
    ] = 0.0
    seconds_away: Annotated[
        float | None, Field(ge=0.0, le=7200.0, description=SECONDS_AWAY), CIRCUMSTANCE
    ] = None

    trailers: Annotated[
        Trailers, Field(description="trailers that take bins from the bay to the load-out")
    ] = Trailers()
    truck: Annotated[
        Truck, Field(description="truck that fetches full bins from the bay, and brings empty ones")
    ] = Truck()
    empty_bins: Annotated[int | None, Field(ge=1, le=400, description=EMPTY_BINS), CHOICE] = None

    @property
    def is_given(self) -> bool:
        """Whether there is a load-out."""
        return self.metres is not None or self.seconds_away is not None

    @property
    def has_trailers(self) -> bool:
        """Whether trailers take the bins to the load-out."""
        return self.trailers.count is not None

    @property
    def has_truck(self) -> bool:
        """Whether a truck fetches full bins from the bay."""
        return self.truck.every is not None

    @property
    def is_of_carriers(self) -> bool:
        """Whether carriers take their bins to the load-out themselves."""
        return self.is_given and not self.has_trailers

    @property
    def seconds_on_the_way(self) -> float:
        """The time of the way to the load-out and back, s; 0 without a load-out.

        `seconds_away` is the whole time, and counts as driven.
        """
        if self.seconds_away is not None:
            return self.seconds_away
        if self.metres is None or self.speed is None:
            return 0.0
        return 2.0 * self.metres / self.speed

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> "LoadOut":
        """Check that there is the whole way with its speed, or the time, or neither."""
        self._demand(
            (self.metres is None) == (self.speed is None),
            "must be set together: the way to the load-out and the speed on it",
            "metres",
            "speed",
        )
        self._demand(
            self.metres is None or self.seconds_away is None,
            "at most one of both can be set: metres, speed and seconds, or seconds_away alone",
            "metres",
            "seconds_away",
        )
        self._demand(
            self.seconds == 0.0 or self.metres is not None,
            "has no effect without metres and speed; seconds_away is the whole time",
            "seconds",
            "metres",
        )
        self._demand(
            self.is_given or not self.has_trailers,
            "have no way to drive: set metres and speed, or seconds_away",
            "trailers.count",
            "metres",
        )
        return self

    @model_validator(mode="after")
    def _empty_bins_come_back(self) -> "LoadOut":
        """Check that empty bins come back if they can run out.

        Only a trailer or a truck brings them. Neither may take more bins than there are: it would
        never be full, and a trailer leaves only when it is full.
        """
        self._demand(
            not self.has_truck or not self.is_given,
            "at most one of both can be set: a truck fetches the bins from the bay, or carriers or"
            " trailers take them to a load-out",
            "truck.every",
            "metres" if self.seconds_away is None else "seconds_away",
        )
        self._demand(
            not self.has_truck or self.empty_bins is not None,
            "has no effect while there are always empty bins: set how many stand at the bay",
            "truck.every",
            "empty_bins",
        )
        if self.empty_bins is None:
            return self
        self._demand(
            self.has_truck or self.has_trailers,
            "run out, and none comes back: set truck.every and truck.bins, or trailers",
            "empty_bins",
            "truck.every",
            "trailers.count",
        )
        for key, bins in (("truck.bins", self.truck.bins), ("trailers.bins", self.trailers.bins)):
            self._demand(
                bins is None or bins <= self.empty_bins,
                "never fills: must be at most empty_bins, all bins that stand at the bay; lower"
                " it, or raise empty_bins",
                key,
                "empty_bins",
            )
        return self
