"""The bay, as `orchard.sim.trailers` and `orchard.sim.stock` have it: trailers or a truck take full
bins from it, and bring empty ones.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.handling import deliver
from orchard.event_model.kernel.motion import set_alarm
from orchard.event_model.kernel.places import tick_of
from orchard.field.ticks import BIN_FOLLOWS
from orchard.plans.robot import ASK, PATIENCE


@inner
def unload(m, carrier):
    """Stand in the bay, and look whether it takes the bin once that rests. Return whether the op is
    done.
    """
    me = m.robots[carrier]
    if me.is_emptied:
        hear_of_emptied(m, carrier)
        return True
    me.state = c.LASTING
    me.is_taken = False
    me.asked = tick_of(m)
    if is_bay_endless(m):
        take_in(m, carrier, me.asked + BIN_FOLLOWS)
    else:
        set_alarm(m, carrier, BIN_FOLLOWS)
    return False


@inner
def go_on_unloading(m, carrier):
    """Look whether the bay takes the bin now, or deliver it. Return whether that is done."""
    me = m.robots[carrier]
    if me.is_taken:
        deliver(m)
        take_over(m)
        return True
    tick = tick_of(m)
    if bins_before(m, carrier) < most_taken(m, tick):
        take_in(m, carrier, tick)
    else:
        m.timers[c.WAKE, carrier] = next_change(m, carrier, tick)
    return False


@inner
def take_in(m, carrier, tick):
    """Let the bay unload a carrier's bin from a tick on."""
    me = m.robots[carrier]
    ticks = m.ops[me.op].ticks
    me.is_taken = True
    me.hears_later = later(ticks, tick - me.asked - BIN_FOLLOWS)
    set_alarm(m, carrier, tick - BIN_FOLLOWS + ticks - tick_of(m))


# -- a carrier whose bin rests in the bay before the carrier is at its place: it is repaired
# or held up


@inner
def be_held_up(m, carrier):
    """Let the bay go on with the bin of a carrier that is held up on its way, if that is in it."""
    if m.robots[carrier].emptied_next <= m.desk[0].now:
        go_on_emptying(m, carrier)
    elif m.robots[carrier].emptied_next == c.NEVER:
        may_be_emptied(m, carrier)


@inner
def begin_anew(m, carrier):
    """Let the bay begin anew with a bin that it has not emptied, because its carrier drives on."""
    m.robots[carrier].is_taken = False
    m.robots[carrier].emptied_next = c.NEVER


@inner
def may_be_emptied(m, carrier):
    """Let the bay look, once a carrier and its bin rest, whether it takes the bin.

    That is if the bin stands in the bay.
    """
    me = m.robots[carrier]
    begin_anew(m, carrier)
    # A drive that begins in the bay with an empty bin leads to no UNLOAD.
    if m.ops[me.op + 1].kind != c.UNLOAD or me.is_emptied:
        return
    if m.desk[0].bay_west <= me.x - me.tows <= m.desk[0].bay_east:
        me.asked = tick_of(m)
        me.emptied_next = m.desk[0].now + c.QUARTERS * BIN_FOLLOWS


@inner
def go_on_emptying(m, carrier):
    """Let the bay take the bin of such a carrier, if it can now, or be done with it."""
    me = m.robots[carrier]
    tick = tick_of(m)
    if me.is_taken:
        deliver(m)
        take_over(m)
        me.is_taken = False
        me.is_emptied = True
        me.emptied_next = c.NEVER
    elif bins_before(m, carrier) < most_taken(m, tick):
        me.is_taken = True
        me.emptied_next = m.desk[0].now + c.QUARTERS * (m.ops[me.op + 1].ticks - BIN_FOLLOWS)
    else:
        me.emptied_next = next_change(m, carrier, tick)


@inner
def hear_of_emptied(m, carrier):
    """Let a carrier at its place in the bay hear from its bin that this is empty already."""
    me = m.robots[carrier]
    me.is_emptied = False
    # The op after this one is the time until it hears.
    me.hears_later = ASK - m.ops[me.op + 1].ticks


@inner
def is_bay_endless(m):
    """Whether no bin ever waits in the bay: it needs no trailer, and has always an empty bin."""
    return len(m.trailers) == 0 and m.desk[0].bay_bins == c.NONE


@inner
def bins_before(m, carrier):
    """Return how many bins the bay unloads, or takes before that of a carrier: those that it has
    begun, and those that stand further on in it.
    """
    bins = 0
    for robot in range(len(m.robots)):
        if not is_unloading(m, robot):
            continue
        if m.robots[robot].is_taken or m.robots[robot].x > m.robots[carrier].x:
            bins += 1
    return bins


@inner
def is_unloading(m, robot):
    """Whether a robot stands in the bay with a bin that is unloaded, or waits for that."""
    me = m.robots[robot]
    if me.state == c.REPAIRED or me.state == c.STANDING:
        return me.emptied_next != c.NEVER
    return me.state == c.LASTING and m.ops[me.op].kind == c.UNLOAD


@inner
def later(ticks, waits):
    """Return by how many ticks more than it waits a carrier hears later that its bin is empty,
    because it asks the bin again and again. `ticks`: until that is empty if it does not wait.
    """
    # Each term is the ticks from the empty bin to the carrier's next question, one each PATIENCE.
    return -(waits + ticks) % PATIENCE - -ticks % PATIENCE


@inner
def most_taken(m, tick):
    """Return how many bins the bay unloads together at a tick: one at each place, with an empty bin
    for each, and room on a trailer if it needs that.
    """
    desk = m.desk[0]
    most = desk.bays
    if len(m.trailers) > 0:
        room = 0
        for trailer in range(len(m.trailers)):
            if m.trailers[trailer].back <= tick:
                room += desk.trailer_bins - m.trailers[trailer].bins
        most = min(most, room)
    if desk.bay_bins != c.NONE:
        most = min(most, empty_bins(m, tick))
    return most


@inner
def next_change(m, carrier, tick):
    """Return the time after a tick at which the bay may take more bins: a trailer is back, the
    truck comes, or a bin before that of a carrier is empty.
    """
    desk = m.desk[0]
    soonest = c.NEVER // c.QUARTERS
    for trailer in range(len(m.trailers)):
        if m.trailers[trailer].back > tick:
            soonest = min(soonest, m.trailers[trailer].back)
    if desk.truck_ticks > 0:
        soonest = min(soonest, (tick // desk.truck_ticks + 1) * desk.truck_ticks)
    for other in range(len(m.robots)):
        if other != carrier and is_unloading(m, other):
            # A bin keeps its place in the tick in which it is empty, too.
            soonest = min(soonest, m.timers[c.WAKE, other] // c.QUARTERS + 1)
    return c.QUARTERS * soonest


@inner
def empty_bins(m, tick):
    """Return how many empty bins there are at a tick, if no bin is taken before."""
    bins = m.desk[0].bay_bins - waiting_bins(m, tick)
    for trailer in range(len(m.trailers)):
        bins -= m.trailers[trailer].bins
        if m.trailers[trailer].back > tick:
            bins -= m.trailers[trailer].taken
    return bins


@inner
def waiting_bins(m, tick):
    """Return how many full bins wait for the truck at a tick, if no bin is taken before."""
    desk = m.desk[0]
    if desk.truck_ticks == 0:
        return 0
    trucks = tick // desk.truck_ticks - desk.trucks
    return max(0, desk.waiting_bins - trucks * desk.truck_bins)


@inner
def next_trailer(m, tick):
    """Return the trailer that takes the next bin: of those that stand at the bay at a tick the one
    with most bins, else the one that is back first.
    """
    best = 0
    for trailer in range(1, len(m.trailers)):
        back = max(tick, m.trailers[trailer].back)
        best_back = max(tick, m.trailers[best].back)
        has_more = m.trailers[trailer].bins > m.trailers[best].bins
        if back < best_back or (back == best_back and has_more):
            best = trailer
    return best


@inner
def take_over(m):
    """Take over a bin that was just delivered: it waits for the truck, or goes on a trailer. That
    leaves once it is full, or with the last bin.
    """
    desk = m.desk[0]
    tick = tick_of(m)
    if desk.truck_ticks > 0:
        desk.waiting_bins = waiting_bins(m, tick) + 1
        desk.trucks = tick // desk.truck_ticks
    if len(m.trailers) == 0:
        return
    trailer = m.trailers[next_trailer(m, tick)]
    trailer.bins += 1
    if trailer.bins == desk.trailer_bins or desk.deliveries == len(m.deliveries):
        trailer.taken = trailer.bins
        trailer.bins = 0
        trailer.back = tick + desk.trailer_ticks
