"""Begin a harvest of the event model where a run is: the door to this package."""

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model.begun.batteries import BatteriesOfCarriers
from orchard.event_model.begun.bay import take_over_bay
from orchard.event_model.begun.calls import CallsOfBins
from orchard.event_model.begun.claims import Claims
from orchard.event_model.begun.doing import Doing, NotInPlanError
from orchard.event_model.begun.lines import LinesOfRobots
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.begun.places import PlacesOfRobots
from orchard.event_model.begun.robots import Robots
from orchard.event_model.harvest import CarryOn, EventHarvest
from orchard.event_model.kernel.entry import run
from orchard.plans.routes import ROUTES


def begin_at(moment: RunMoment, carry_on: CarryOn = run) -> EventHarvest:
    """Return a harvest that goes on from a moment of a run. Its ticks are those of the run.

    `carry_on`: the machine, compiled or as plain Python.

    Raises NotImplementedError for what the event model does not know; NotInPlanError, which is one,
    for a robot that was pushed, or stands because of an emergency stop or with a flat battery.
    """
    world = moment.world
    layout = world.layout
    if world.is_any_stopped:
        raise NotInPlanError("an emergency stop holds a robot")
    if layout.scenario.route not in ROUTES:
        raise NotImplementedError("the event model does not go on with a route of your own")
    # At its start; what follows fills in the state of the moment.
    harvest = EventHarvest(layout, carry_on=carry_on)
    if moment.tick == 0:
        return harvest
    take_over_bay(moment, harvest)
    claims = Claims(moment)
    robots = Robots(moment, harvest, claims)
    # `Robots` has translated jobs, so the arrays of the program may be others.
    harvest.take_program()
    doing = robots.all()
    lines = LinesOfRobots(harvest, robots.ops)
    on_lines = [lines.place(me) for me in doing]
    places = PlacesOfRobots(harvest, robots.ops, claims, moment.tick)
    for me in doing:
        places.take_over(me)
    _take_over_batteries(moment, harvest, doing)
    calls = CallsOfBins(moment, harvest, robots.ops, doing)
    calls.take_over()
    # Until here all has been noted in `doing`. What follows reads columns of robots.
    for me in doing:
        _write(harvest, me, moment.tick)
    lines.line_up(on_lines, moment.tick)
    calls.take_over_desk()
    harvest.goes_on_from(moment.tick)
    return harvest


def _take_over_batteries(moment: RunMoment, harvest: EventHarvest, doing: list[Doing]) -> None:
    """Set the batteries of carriers, if they have some that can be flat."""
    layout = moment.world.layout
    if not layout.first_charging:
        return
    batteries = BatteriesOfCarriers(moment, harvest)
    for me in doing:
        if me.name not in layout.blocks:
            batteries.take_over(me)


def _write(harvest: EventHarvest, me: Doing, tick: int) -> None:
    """Write the columns of a robot, and when it goes on."""
    # Through a recarray each write costs a microsecond more.
    robots = harvest.model.robots.view(np.ndarray)
    columns = me.more | {
        "x": me.pose.x,
        "y": me.pose.y,
        "op": me.op,
        "state": me.state,
        "bin": me.bin,
        "counted": tick,
        "next_op": me.more.get("next_op", c.NONE),
        "meeting": me.here + float(robots["clear"][me.number]),
    }
    for column, value in columns.items():
        robots[column][me.number] = value
    harvest.model.timers[c.WAKE, me.number] = c.NEVER
    if me.alarm is not None:
        harvest.model.timers[c.WAKE, me.number] = c.QUARTERS * me.alarm
