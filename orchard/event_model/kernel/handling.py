"""Bins: a picker leaves the full one and takes the empty one that a carrier has brought.

The "partner" of a picker is that carrier. While the bin changes over, both need the lane's place.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.batteries import end_trip, use_battery
from orchard.event_model.kernel.calls import call_carriers
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import set_alarm
from orchard.event_model.kernel.places import (
    has_places,
    hear_answer,
    is_alone,
    is_subset,
    tick_of,
    want_places,
)
from orchard.plans.robot import ASK, PATIENCE

# Quarters of a tick after which a letter is heard.
MAIL = 2


@inner
def handle(m, robot, state):
    """Begin to couple or uncouple a bin. A robot that has stood for a tick needs less.

    Return that the op is not done.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    me.state = state
    set_alarm(m, robot, op.handles if me.stood == tick_of(m) else op.handles_at_rest)
    return False


# -- places that have no gate


@inner
def seize(m, robot, beside):
    """Stand until the op's places are granted. Return whether the robot has them.

    `beside`: the partner that may have them too.
    """
    me = m.robots[robot]
    places = m.ops[me.op].places
    if has_places(m, robot, places):
        return True
    want_places(m, robot, places, beside)
    me.hears_grants = True
    return False


@inner
def ask_for_lone_place(m, robot):
    """Stand until the robot has heard that no other robot shares the op's place.

    It asks traffic by a claim. Return whether it has heard it before.
    """
    me = m.robots[robot]
    hear_answer(m, robot)
    if is_subset(m.places[m.ops[me.op].places], m.sets[c.ALONE, robot]):
        return True
    me.state = c.WAITING_FOR_PARTNER
    tick = tick_of(m)
    # Traffic hears a claim between its tick and the next one.
    claims = max(tick, me.claimed + PATIENCE)
    set_alarm(m, robot, claims + 1 - tick)
    return False


@inner
def await_partner_gone(m, robot):
    """Look whether another robot shares the op's place, when traffic has heard the robot's claim.

    If none does, the robot hears it in the next tick. Return whether it has.
    """
    me = m.robots[robot]
    place = m.ops[me.op].places
    hear_answer(m, robot)
    if is_subset(m.places[place], m.sets[c.ALONE, robot]):
        return True
    # Traffic has just heard the claim of the last tick.
    me.claimed = tick_of(m) - 1
    if is_alone(m, robot, place):
        me.state = c.LASTING
        # One of the ticks from the claim to its answer is over.
        set_alarm(m, robot, ASK - 1)
    else:
        set_alarm(m, robot, PATIENCE)
    return False


# -- pickers


@inner
def note_full(m, picker):
    """Note at the end of a pass that the bin is full, if it is left there."""
    me = m.robots[picker]
    drive = m.passes[m.ops[me.op].arg]
    if drive.leaves_bin and drive.is_full:
        me.full_since = tick_of(m)


@inner
def leave_bin(m, picker):
    """Leave the full bin in the lane. A carrier that waits for that hears it when it asks next."""
    me = m.robots[picker]
    drive = m.passes[m.ops[me.op].arg]
    if not drive.is_full:
        me.full_since = tick_of(m)
    me.left_bin = me.bin
    me.bin = c.NONE
    me.offered = c.NONE
    m.bins[me.left_bin].is_left = True
    m.bins[me.left_bin].left_at = tick_of(m)
    call_carriers(m, picker, drive.end)
    return True


@inner
def await_bin(m, picker):
    """Take the empty bin, once a carrier has brought one."""
    me = m.robots[picker]
    if me.offered == c.NONE:
        me.state = c.WAITING_FOR_BIN
        return False
    return handle(m, picker, c.COUPLING)


@inner
def hear_of_bin(m, picker):
    """Let a picker hear that a carrier has brought it a bin."""
    me = m.robots[picker]
    me.offered = m.robots[me.bringer].left_bin
    if me.state == c.WAITING_FOR_BIN:
        m.timers[c.WAKE, picker] = c.QUARTERS * tick_of(m)


@inner
def couple(m, picker):
    """Couple the empty bin, and count the exchange."""
    me = m.robots[picker]
    me.bin = me.offered
    desk = m.desk[0]
    exchange = m.exchanges[desk.exchanges]
    m.robots[me.bringer].exchange = desk.exchanges
    desk.exchanges += 1
    tick = tick_of(m)
    exchange.tick = tick
    exchange.picker = picker
    exchange.stood = tick - me.stood
    exchange.without = tick - me.full_since
    exchange.carrier_ticks = c.NONE
    me.full_since = c.NONE
    return take_place(m, picker)


@inner
def take_place(m, picker):
    """Take over the place in which the carrier stands, and the bin with it."""
    me = m.robots[picker]
    me.state = c.TAKING_PLACE
    if not seize(m, picker, me.bringer):
        return False
    m.bins[me.offered].taken = tick_of(m)
    bringer = m.robots[me.bringer]
    # It may have asked in this tick, before the picker acted. The picker answers in the next tick.
    if bringer.state == c.HANDING_OVER and bringer.asked == tick_of(m):
        await_yes(m, me.bringer)
    return True


# -- carriers


@inner
def hand_over(m, carrier):
    """Uncouple the empty bin in the lane, and let the picker know."""
    me = m.robots[carrier]
    # The bin before which it stands: the empty one now, and the full one once it is there.
    me.left_bin = me.bin
    me.bin = c.NONE
    m.bins[me.left_bin].taken = c.NEVER
    m.robots[me.customer].bringer = carrier
    m.timers[c.BROUGHT, me.customer] = m.desk[0].now + MAIL
    return await_taken(m, carrier)


@inner
def await_taken(m, carrier):
    """Ask again and again whether the picker has taken the bin."""
    me = m.robots[carrier]
    me.asked = tick_of(m)
    if m.bins[me.left_bin].taken <= me.asked:
        await_yes(m, carrier)
        return False
    me.state = c.HANDING_OVER
    set_alarm(m, carrier, PATIENCE)
    return False


@inner
def await_yes(m, carrier):
    """Wait for the answer to the question of this tick: the picker has taken the bin."""
    m.robots[carrier].state = c.LASTING
    set_alarm(m, carrier, ASK)


@inner
def take_bin(m, carrier):
    """Couple the full bin."""
    me = m.robots[carrier]
    me.bin = me.job_bin
    return True


@inner
def deliver(m):
    """Count a bin that is unloaded."""
    desk = m.desk[0]
    m.deliveries[desk.deliveries] = tick_of(m)
    desk.deliveries += 1


@inner
def come_home(m, carrier):
    """Be free for the next call."""
    me = m.robots[carrier]
    use_battery(m, carrier, m.desk[0].standing)
    end_trip(m, carrier, 0)
    if m.ops[me.op].arg != c.NONE:
        me.queue_line = m.ops[me.op].arg
    me.is_free = True
