"""How fast the machines of a scenario drive and turn, and how long they handle bins.

Robots, physics, the event model, bounds and the proof of the optimum all take it from here
(`Layout.machines`).
"""

from dataclasses import dataclass

from orchard.field.kinds import KINDS
from orchard.field.repeatable import PI
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.field.ticks import QUICKEST_COUPLING, QUICKEST_UNCOUPLING, whole_ticks


@dataclass(frozen=True)
class Machine:
    """What the machines of a kind can, and how long they handle bins."""

    #: m/s, at most, and as it drives.
    speed: float
    #: rad/s, at most, and as it turns.
    turn: float
    #: Ticks from the robot's stop until a bin is coupled.
    coupling_ticks: int
    #: Ticks from the robot's stop until its bin is uncoupled.
    uncoupling_ticks: int
    #: Ticks for which a picker stands with its empty bin before it goes on.
    exchange_ticks: int
    #: Ticks at rest in the bay until a bin is empty.
    unloading_ticks: int
    #: Ticks for which a carrier that has unloaded drives to the load-out and back; 0: it does not.
    haul_driving_ticks: int
    #: Ticks for which it stands there.
    haul_standing_ticks: int
    #: Ticks for which a trailer that leaves the bay is away; 0 without trailers.
    trailer_ticks: int
    #: Ticks from one truck at the bay to the next one; 0: none comes.
    truck_ticks: int

    @property
    def haul_ticks(self) -> int:
        """The ticks for which a carrier that has unloaded is away."""
        return self.haul_driving_ticks + self.haul_standing_ticks

    @property
    def rest_before_coupling(self) -> int:
        """The ticks for which a robot waits, at rest, before it asks physics to couple a bin."""
        return _rest(self.coupling_ticks, QUICKEST_COUPLING)

    @property
    def rest_before_uncoupling(self) -> int:
        """The ticks for which a robot waits, at rest, before it asks physics to uncouple a bin."""
        return _rest(self.uncoupling_ticks, QUICKEST_UNCOUPLING)

    @property
    def coupling_ticks_at_rest(self) -> int:
        """The ticks until a bin is coupled, of a robot that stands already when it begins.

        The deed itself takes a tick.
        """
        return self.rest_before_coupling + 1

    @property
    def uncoupling_ticks_at_rest(self) -> int:
        """The ticks until a bin is uncoupled, of a robot that stands already when it begins.

        The deed itself takes a tick.
        """
        return self.rest_before_uncoupling + 1


def machine_of(scenario: Scenario, kind: str) -> Machine:
    """Return what machines of a kind can in a scenario."""
    speed = KINDS[kind].speed
    turn = KINDS[kind].turn
    if kind == "carrier":
        speed = scenario.carrying.speed
        turn = _radians(scenario.carrying.turning)
    elif kind == "picker":
        speed = scenario.picking.driving_speed
        turn = _radians(scenario.picking.turning)
    handling = scenario.handling
    load_out = scenario.load_out
    driving = whole_ticks(load_out.seconds_on_the_way)
    standing = whole_ticks(load_out.seconds)
    trailer = 0
    if load_out.has_trailers:
        # At least 1, because 0 means that there are no trailers.
        trailer = max(1, driving + standing)
    if not load_out.is_of_carriers:
        driving = 0
        standing = 0
    return Machine(
        speed=speed,
        turn=turn,
        coupling_ticks=whole_ticks(handling.coupling),
        uncoupling_ticks=whole_ticks(handling.uncoupling),
        exchange_ticks=whole_ticks(handling.exchange),
        unloading_ticks=whole_ticks(handling.unloading),
        haul_driving_ticks=driving,
        haul_standing_ticks=standing,
        trailer_ticks=trailer,
        truck_ticks=whole_ticks(load_out.truck.every or 0.0),
    )


def haul_charge(scenario: Scenario, machine: Machine) -> float:
    """Return the share of its battery that a carrier uses on the way to the load-out and back."""
    battery = scenario.carrying.battery
    driven = battery.as_driven(machine.haul_driving_ticks, machine.haul_standing_ticks)
    return battery.share_used(driven * TIME_STEP)


def _radians(degrees: float) -> float:
    """Return an angle, rad.

    The order of the operations makes 22.5 degrees PI / 8 to the last bit, which is the rate of
    turning of `orchard/field/kinds.py`.
    """
    return PI * (degrees / 180.0)


def _rest(ticks: int, quickest: int) -> int:
    """Return for how many ticks a robot waits, at rest, before it asks physics to do a deed.

    `ticks`: those that the deed takes in all. `quickest`: the fewest that physics allows; a robot
    that needs no more asks at once, again and again until it is done. The deed itself takes a tick.
    """
    if ticks <= quickest:
        return 0
    return ticks - 1
