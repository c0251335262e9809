"""The values that a user can set in a scenario: each with its default, its limits and its meaning.

Properties tell what follows from them, such as the number of carriers where `carriers` is null.
The rules about several values stand in `orchard/field/scenario/rules.py`, whose class `Scenario` is
derived from the class here.
"""

import math
from statistics import fmean
from typing import Annotated, Self

from pydantic import Field

from orchard.field.kinds import DISPATCH, TRAFFIC
from orchard.field.problems import Section
from orchard.field.queue import (
    LONGEST_ROW,
    MOST_CARRIERS,
    QUEUES,
    SHORTEST_ROW,
    TWO_WAY,
    USUAL_ROW,
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
    ROLLING,
    ROW_ORDERS,
    ROW_RULES,
)
from orchard.field.scenario.prices import Prices
from orchard.field.scenario.sections import (
    Animals,
    Carrying,
    Crop,
    Handling,
    LoadOut,
    People,
    Picking,
)
from orchard.field.scenario.sensors import LaserSettings, SensorSettings
from orchard.field.scenario.shift import WorkShift
from orchard.field.survey import (
    FEWEST_ROWS,
    MOST_ROWS,
    NARROWEST_ROW,
    TRUNK,
    USUAL_WIDTH,
    WIDEST_ROW,
    Survey,
    spacing_of,
)

# Meanings of values that are too long for their line below.
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
CHARGERS = (
    "number of carriers that can charge at once, in lines of their own in the queue; only batteries"
    " need them"
)
BAYS = (
    "number of carriers that unload at a time: those behind the first one do it where they stand"
    " in its line"
)

# Limits of the speed of a picker while it picks, m/s.
SLOWEST = 0.001
FASTEST = 1.0
# Limits of the metres of row that fill a bin.
SHORTEST_BIN = 5.0
LONGEST_BIN = 400.0


class Values(Section):
    """The values of a scenario, and the numbers that follow from them."""

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
        """The number of carriers, by default 7 for every 10 pickers (manual), rounded up."""
        if self.carriers is not None:
            return self.carriers
        return math.ceil(self.pickers * 7 / 10)

    @property
    def queue_carriers(self) -> int:
        """The number of carriers for which the queue has places."""
        return max(self.carrier_count, self.queue_room or 0)

    @property
    def bin_metres(self) -> float | None:
        """The metres of row that fill a bin; None: each row fills one bin, however long it is.

        They are `metres_per_bin`, or follow from `bins_per_row` or from `crop`.
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
        """The speed of a picker of mean speed while it picks, m/s.

        It is `picking_speed`, or follows from `picking_rate`.
        """
        if self.picking_rate is not None:
            # bins/h * m/bin is m/h.
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
        """Key -> the number that holds, also where the value is null and the number follows from
        other values.
        """
        return {
            "carriers": self.carrier_count,
            "picking_speed": self.mean_picking_speed,
            "picking_rate": 3600.0 * self.mean_picking_speed / self._metres_per_full_bin,
            "metres_per_bin": self._metres_per_full_bin,
            "bins_per_row": self.mean_row / self._metres_per_full_bin,
        }

    @property
    def _metres_per_full_bin(self) -> float:
        """Metres of row that fill a bin; the length of the mean row if each row fills one."""
        return self.bin_metres or self.mean_row

    @property
    def has_batteries(self) -> bool:
        """Whether carriers must charge."""
        return self.carrying.battery.hours is not None

    @property
    def work_is_drawn(self) -> bool:
        """Whether the seed changes how long robots work."""
        if self.picking.is_drawn:
            return True
        for failure in (self.picking.failure, self.carrying.failure):
            if failure.mean_between is not None:
                return True
        return False

    @property
    def bodiless_agents(self) -> tuple[str, ...]:
        """The names of the agents without a body: the built-in ones, then the user's.

        With the policy `nearest` bins call carriers themselves, so there is no `dispatch`.
        """
        built_in = [TRAFFIC]
        if self.dispatch != NEAREST:
            built_in.append(DISPATCH)
        return (*built_in, *sorted(self.agents_without_body))

    @property
    def own_classes(self) -> dict[str, str]:
        """The paths of all classes and functions of the user's own that this scenario names.

        They are code that runs when the scenario is used. Each is found by the name of its agent,
        or by the key of its rule, such as "route".
        """
        return self.agents | self.agents_without_body | self._own_rules

    @property
    def without_code(self) -> Self:
        """The same scenario with the default for each rule of the user's own, so that none is run.

        A program that only shows the orchard uses it: the names of the bodies, and walls and trees,
        are as they were.
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
            # The field of a rule has the built-in ones as its examples (`fields.plugin`).
            if field.examples and path not in field.examples:
                own[key] = path
        return own
