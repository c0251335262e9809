"""Trailers at the bay, as `orchard.sim.trailers` has them: they take bins to the load-out."""

from orchard.event_model import columns as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import set_alarm
from orchard.event_model.kernel.places import tick_of
from orchard.field.ticks import BIN_FOLLOWS
from orchard.plans.robot import PATIENCE


@inner
def unload(m, carrier):
    """Begin to unload a bin, once a trailer stands at the bay."""
    me = m.robots[carrier]
    op = m.ops[me.op]
    me.state = c.LASTING
    waits = 0
    if len(m.trailers) > 0:
        rests = tick_of(m) + BIN_FOLLOWS
        waits = max(0, m.trailers[next_trailer(m, rests)].back - rests)
        # It asks its bin again and again whether that is empty.
        me.hears_later = -(waits + op.ticks) % PATIENCE - -op.ticks % PATIENCE
    set_alarm(m, carrier, waits + op.ticks)
    return False


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
def load_trailer(m):
    """Put a bin that was just delivered on a trailer. It leaves once it is full, or with the last
    bin.
    """
    if len(m.trailers) == 0:
        return
    desk = m.desk[0]
    tick = tick_of(m)
    trailer = m.trailers[next_trailer(m, tick)]
    trailer.bins += 1
    if trailer.bins == desk.trailer_bins or desk.deliveries == len(m.deliveries):
        trailer.bins = 0
        trailer.back = tick + desk.trailer_ticks
