"""Batteries: what carriers use of them, and which carrier gets a charger.

`orchard.sim.batteries` has the rules. A carrier whose battery is low after its job charges in a
charging line. A free charger goes to the one that stands there nearest to a head.
"""

from math import ceil, inf

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import whole_ticks
from orchard.event_model.kernel.places import tick_of
from orchard.field.scenario import TIME_STEP
from orchard.plans.robot import ASK

# Ticks for which a carrier asks its bin whether that wants it.
CONFIRMED = ASK
HOUR = 3600.0  # s


@inner
def use_battery(m, robot, standing):
    """Count what a battery was used for since it was last counted.

    `standing`: the share of the power that was used since then while the robot stood.
    """
    me = m.robots[robot]
    tick = tick_of(m)
    if me.state != c.DRIVING:
        note_rest(m, robot)
    elif me.leg_ended <= me.leg_begun:
        # It is on its way. The rest of this leg is counted at its end.
        me.moved += tick - max(me.leg_begun, me.counted)
    worked = me.moved + standing * (tick - me.counted - me.moved - me.rested)
    me.charge -= worked * TIME_STEP / HOUR / m.desk[0].battery_hours
    me.counted = tick
    me.moved = 0
    me.rested = 0


@inner
def may_get_flat(m, robot):
    """Whether a robot uses a battery now: carriers do, unless theirs is endless or charged."""
    me = m.robots[robot]
    return m.desk[0].battery_hours < inf and me.queue_line != c.NONE and not me.is_charging


@inner
def is_flat(m, robot):
    """Whether the battery of a robot is flat, if it has one."""
    if not may_get_flat(m, robot):
        return False
    use_battery(m, robot, m.desk[0].standing)
    return m.robots[robot].charge <= 0.0


@inner
def ticks_to_flat(m, robot):
    """Return the ticks, one or more, for which a robot can drive; NEVER: as long as it likes."""
    if not may_get_flat(m, robot):
        return c.NEVER
    use_battery(m, robot, m.desk[0].standing)
    seconds = m.robots[robot].charge * m.desk[0].battery_hours * HOUR
    return max(1, whole_ticks(seconds))


@inner
def note_rest(m, robot):
    """Note for how long a robot has stood, up to now, if it stood in the queue: it is off there."""
    me = m.robots[robot]
    desk = m.desk[0]
    is_along = desk.queue_west <= me.x <= desk.exit
    if is_along and desk.queue_south <= me.y <= desk.queue_north:
        tick = tick_of(m)
        me.rested += tick - max(me.counted, min(tick, me.moved_at))


@inner
def end_job(m, carrier, away):
    """Note what the job of a carrier took that has turned into its line of the queue.

    A job counts from the queue's exit to the queue's exit, as if no robot stood in that line.
    `away`: ticks for which the carrier is away at the load-out from now on.
    """
    me = m.robots[carrier]
    if me.exchange == c.NONE:
        return
    desk = m.desk[0]
    through = (desk.exit - me.x) / desk.carrier_speed / TIME_STEP
    exchange = m.exchanges[me.exchange]
    exchange.carrier_ticks = tick_of(m) - me.away + max(away, through) + CONFIRMED
    used = me.charge_before - me.charge
    exchange.battery_used = used + through * TIME_STEP / HOUR / desk.battery_hours
    me.exchange = c.NONE


@inner
def end_trip(m, carrier, away):
    """Count what a carrier's way took that ends in a line of the queue. `away`: see `end_job`."""
    end_job(m, carrier, away)
    note_trip(m, carrier, away)


@inner
def haul(m, carrier):
    """Let a carrier that has unloaded, and is in its line, be away at the load-out for a time."""
    me = m.robots[carrier]
    away = m.ops[me.op].ticks
    use_battery(m, carrier, m.desk[0].standing)
    me.charge -= m.desk[0].haul_charge
    me.back = tick_of(m) + away
    end_trip(m, carrier, away)


@inner
def note_trip(m, carrier, away):
    """Note for how long a carrier was outside the queue, if it was, or will be away."""
    me = m.robots[carrier]
    if me.away == c.NEVER:
        return
    desk = m.desk[0]
    trip = m.trips[desk.trips]
    desk.trips += 1
    trip.since = me.away
    trip.until = tick_of(m) + away
    me.away = c.NEVER


@inner
def may_charge(m, carrier):
    """Let a carrier drive to the chargers if its battery is low."""
    me = m.robots[carrier]
    op = m.ops[me.op]
    use_battery(m, carrier, m.desk[0].standing)
    if me.charge <= op.reserve:
        me.next_op = op.arg


@inner
def ask_for_charger(m, carrier):
    """Let a carrier charge once it stands in its charging line."""
    me = m.robots[carrier]
    use_battery(m, carrier, m.desk[0].standing)
    end_trip(m, carrier, 0)
    me.queue_line = m.ops[me.op].arg
    me.is_charged = False
    # It gets a charger once it has stood there for a tick.
    m.timers[c.PARK, carrier] = c.QUARTERS * (max(tick_of(m), me.back) + 1)


@inner
def park(m, carrier):
    """Let a carrier that stands wait for a charger; look again later at one that drives."""
    me = m.robots[carrier]
    desk = m.desk[0]
    if me.state == c.DRIVING:
        m.timers[c.PARK, carrier] = desk.now + c.QUARTERS
        return
    if not me.waits_to_charge:
        me.parked = me.stood
    me.waits_to_charge = True
    # It has stood for a tick.
    give_chargers(m, 1)


@inner
def give_chargers(m, ticks):
    """Give free chargers to the carriers that stand nearest to a head.

    `ticks`: for which they have had them by now.
    """
    while m.desk[0].free_chargers > 0:
        first = nearest_to_charge(m)
        if first == c.NONE:
            return
        begin_to_charge(m, first, ticks)


@inner
def nearest_to_charge(m):
    """Return the carrier that stands nearest to a head of those that wait for a charger; NONE:
    there is none.
    """
    nearest = c.NONE
    for carrier in range(len(m.robots)):
        me = m.robots[carrier]
        if me.waits_to_charge and me.state == c.DRIVING:
            # It moves up, and gets one once it stands.
            m.timers[c.PARK, carrier] = m.desk[0].now + c.QUARTERS
        elif me.waits_to_charge and (nearest == c.NONE or me.x > m.robots[nearest].x):
            nearest = carrier
    return nearest


@inner
def begin_to_charge(m, carrier, begun):
    """Charge a carrier's battery until it is full. `begun`: ticks for which it does by now."""
    me = m.robots[carrier]
    desk = m.desk[0]
    use_battery(m, carrier, 0.0)
    desk.free_chargers -= 1
    me.waits_to_charge = False
    me.is_charging = True
    lacks = 1.0 - max(0.0, me.charge)
    ticks = ceil(lacks * desk.seconds_to_charge / TIME_STEP)
    m.timers[c.FULLY_CHARGED, carrier] = desk.now + c.QUARTERS * (ticks - begun)


@inner
def delay_charge(m, carrier, moved):
    """Charge for longer because a carrier has moved up for some ticks: it used its battery then."""
    desk = m.desk[0]
    used = desk.seconds_to_charge / HOUR / desk.battery_hours
    if m.timers[c.FULLY_CHARGED, carrier] == c.NEVER:
        # It was to be full while it moved.
        m.timers[c.FULLY_CHARGED, carrier] = c.QUARTERS * m.robots[carrier].counted
    m.timers[c.FULLY_CHARGED, carrier] += c.QUARTERS * round(moved * (1.0 + used))


@inner
def end_charging(m, carrier):
    """Let a carrier whose battery is full go on, and give its charger to the next one.

    One that moves up meanwhile is not charged while it does: `delay_charge` lets it charge on.
    """
    me = m.robots[carrier]
    me.counted = tick_of(m)
    if me.state == c.DRIVING:
        return
    me.charge = 1.0
    me.moved = 0
    me.rested = 0
    me.is_charging = False
    me.is_charged = True
    if me.state == c.WAITING_FOR_CHARGE or me.state == c.FLAT:
        m.timers[c.WAKE, carrier] = m.desk[0].now
    m.desk[0].free_chargers += 1
    give_chargers(m, 0)


@inner
def await_charge(m, carrier):
    """Stand until the battery has been full. Return whether it has."""
    me = m.robots[carrier]
    if not me.is_charged:
        me.state = c.WAITING_FOR_CHARGE
        return False
    use_battery(m, carrier, 0.0)
    return True
