"""The bay, as `orchard.sim.trailers` and `orchard.sim.stock` have it: trailers or a truck take full
bins from it, and bring empty ones.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import set_alarm
from orchard.event_model.kernel.places import tick_of
from orchard.field.ticks import BIN_FOLLOWS
from orchard.plans.robot import PATIENCE


@inner
def unload(m, carrier):
    """Begin to unload a bin, once the bay takes it."""
    me = m.robots[carrier]
    op = m.ops[me.op]
    me.state = c.LASTING
    rests = tick_of(m) + BIN_FOLLOWS
    waits = taken_from(m, rests) - rests
    me.hears_later = later(op.ticks, waits)
    set_alarm(m, carrier, waits + op.ticks)
    return False


@inner
def later(ticks, waits):
    """Return by how many ticks more than it waits a carrier hears later that its bin is empty,
    because it asks the bin again and again. `ticks`: until that is empty if it does not wait.
    """
    return -(waits + ticks) % PATIENCE - -ticks % PATIENCE


@inner
def taken_from(m, tick):
    """Return the first tick, from `tick` on, at which the bay takes a bin: with a trailer there, if
    it needs one, and an empty bin.
    """
    desk = m.desk[0]
    if len(m.trailers) > 0:
        tick = max(tick, m.trailers[next_trailer(m, tick)].back)
    if desk.bay_bins == c.NONE or empty_bins(m, tick) > 0:
        return tick
    if desk.truck_ticks > 0:
        return (tick // desk.truck_ticks + 1) * desk.truck_ticks
    soonest = c.NEVER
    for trailer in range(len(m.trailers)):
        if m.trailers[trailer].back > tick:
            soonest = min(soonest, m.trailers[trailer].back)
    return soonest


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
