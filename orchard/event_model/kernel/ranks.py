"""How the built-in policies choose a bin and a carrier: the rules of `orchard.dispatch.ranking`.

At a decision the bins that it is about have `is_asked`, and the carriers that can leave `is_ready`.
Carriers that are booked at that time, because an order for them is under way, are left out.
"""

from orchard.dispatch.ranking import MARGIN
from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.reports import seconds_to_full
from orchard.field.scenario import TIME_STEP


@inner
def remember(m, picker, tick):
    """Note when a bin is full: as `orchard.dispatch.ranking.PredictiveMemory.note`.

    A bin that is full already keeps its last estimate, if there is one from this call.
    """
    call = m.calls[picker]
    seconds = seconds_to_full(m, picker, tick)
    if seconds > 0.0 or m.bins[call.bin].full < call.since:
        m.bins[call.bin].full = tick + round(seconds / TIME_STEP)


@inner
def is_due(m, picker, tick):
    """Whether a carrier may leave for a bin: as `orchard.dispatch.ranking.Predictive.is_due`."""
    reach = m.ends[m.calls[picker].end].seconds
    return seconds_to_full(m, picker, tick) - reach <= MARGIN


@inner
def first_bin(m):
    """Return the picker whose bin is the first of those that the policy decides on; NONE: there is
    none.
    """
    best = c.NONE
    for picker in range(len(m.robots)):
        if m.calls[picker].is_asked and (best == c.NONE or is_ranked_before(m, picker, best)):
            best = picker
    return best


@inner
def is_ranked_before(m, picker, other):
    """Whether a policy ranks the bin of one picker before that of another.

    Ties by the bins' names.
    """
    keys = rank(m, picker)
    other_keys = rank(m, other)
    for key, other_key in zip(keys, other_keys):  # noqa: B905
        if key != other_key:
            return key < other_key
    return m.calls[picker].bin < m.calls[other].bin


@inner
def rank(m, picker):
    """Return two keys by which a policy ranks a bin, the least first: as `rank` of the policies in
    `orchard.dispatch.ranking`.
    """
    call = m.calls[picker]
    end = m.ends[call.end]
    policy = m.desk[0].policy
    if policy == c.LONGEST_WAITING:
        return float(call.since), -end.metres
    if policy == c.PREDICTIVE:
        return m.bins[call.bin].full * TIME_STEP - end.seconds, 0.0
    if policy == c.GLOBAL_ASSIGNMENT:
        return end.metres, float(call.since)
    # FARTHEST_FIRST and PREDICTIVE_FARTHEST.
    return -end.metres, 0.0


@inner
def nearest_carrier(m):
    """Return the carrier that can leave and is nearest to its head; NONE: there is none.

    Ties by name.
    """
    best = c.NONE
    for carrier in range(len(m.robots)):
        me = m.robots[carrier]
        is_free = me.is_ready and not me.is_booked
        if is_free and (best == c.NONE or is_nearer_to_head(m, carrier, best)):
            best = carrier
    return best


@inner
def is_nearer_to_head(m, carrier, other):
    """Whether one carrier was nearer to its head than another when the dispatcher asked."""
    return m.robots[carrier].millimetres_to_head < m.robots[other].millimetres_to_head
