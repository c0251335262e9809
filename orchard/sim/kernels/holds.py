"""The inner loops of `orchard.sim.lookahead`, which has the terms: which holds end.

Arrays have one row for each body. `ranges` are the scans of all bodies in one array: those of body
i are begin[i] to begin[i + 1]. A zone is given by its spans, (2, beams): the ranges at which each
beam enters and leaves the zone, m.
"""

from orchard.sim.kernels.jit import inlined, jit

# As an index: none.
NONE = -1


@jit
def end_holds(
    ranges, before, tick, until, wanted, twist, coupled, partner, partner_twist, full, was_full,
    watched, was_occupied, still, freer_within, was_left_freer, spans, begin,
):  # fmt: skip
    """Set `until`, (n,) ticks, to 0 for each body with a hold that ends at this tick.

    ranges, before: the scans of this tick and of the tick before. wanted (n, 3): the velocity that
    is applied again. partner, partner_twist, was_full, was_occupied, was_left_freer: what the body
    observed when it answered. watched, still (n, z): indices into spans, (k, 2, beams), or NONE.
    freer_within: m, or 0 if the body does not compare the halves of its scan.
    """
    for i in range(len(until)):
        has_partner_changed = _has_partner_changed(i, twist, coupled, partner, partner_twist)
        is_other = _differ(wanted[i], twist[i]) or full[i] != was_full[i] or has_partner_changed
        if until[i] <= tick or is_other:
            until[i] = 0
            continue
        first = begin[i]
        end = begin[i + 1]
        if freer_within[i] > 0.0:
            is_freer = is_left_freer(ranges, first, end, freer_within[i])
            if is_freer != was_left_freer[i]:
                until[i] = 0
        # A hold may end for two reasons: to set 0 again does no harm.
        if _is_zone_other(ranges, first, end, watched[i], was_occupied[i], spans):
            until[i] = 0
        if _is_zone_disturbed(ranges, before, first, end, still[i], spans):
            until[i] = 0


@inlined
def _is_zone_other(ranges, first, end, zones, was_occupied, spans):
    """Whether one of a body's watched zones is occupied though it was free, or free now."""
    is_other = False
    for z in range(len(zones)):
        if zones[z] != NONE:
            is_other |= occupied(ranges, first, end, spans[zones[z]]) != was_occupied[z]
    return is_other


@inlined
def _is_zone_disturbed(ranges, before, first, end, zones, spans):
    """Whether a return in one of a body's still zones is another than in the tick before."""
    is_disturbed = False
    for z in range(len(zones)):
        if zones[z] != NONE:
            is_disturbed |= changed(ranges, before, first, end, spans[zones[z]])
    return is_disturbed


@inlined
def _has_partner_changed(i, twist, coupled, partner, partner_twist):
    """Whether a body is coupled to another body than before, or that one moves otherwise."""
    j = coupled[i]
    return j != partner[i] or (j != NONE and _differ(twist[j], partner_twist[i]))


@jit
def begin_holds(
    ranges, bodies, twist, coupled, partner, partner_twist, full, was_full, watched, was_occupied,
    freer_within, was_left_freer, spans, begin,
):  # fmt: skip
    """Note what these bodies, (b,) indices, observe at the tick of their answers.

    It is written into the arrays with which `end_holds` compares.
    """
    for i in bodies:
        partner[i] = coupled[i]
        was_full[i] = full[i]
        if coupled[i] != NONE:
            for axis in range(3):
                partner_twist[i, axis] = twist[coupled[i], axis]
        was_left_freer[i] = is_left_freer(ranges, begin[i], begin[i + 1], freer_within[i])
        for z in range(watched.shape[1]):
            if watched[i, z] != NONE:
                span = spans[watched[i, z]]
                was_occupied[i, z] = occupied(ranges, begin[i], begin[i + 1], span)


@inlined
def _differ(a, b):
    """Whether two velocities differ."""
    return a[0] != b[0] or a[1] != b[1] or a[2] != b[2]


@inlined
def occupied(ranges, first, end, span):
    """Whether a return of one scan, ranges[first : end], lies in a zone."""
    is_occupied = False
    for k in range(end - first):
        is_occupied |= span[0, k] <= ranges[first + k] < span[1, k]
    return is_occupied


@inlined
def changed(ranges, before, first, end, span):
    """Whether a return of one scan in a zone has come, gone or changed since the tick before."""
    has_changed = False
    for k in range(end - first):
        now = ranges[first + k]
        then = before[first + k]
        is_in_zone = span[0, k] <= now < span[1, k] or span[0, k] <= then < span[1, k]
        has_changed |= now != then and is_in_zone
    return has_changed


@inlined
def is_left_freer(ranges, first, end, reach):
    """Whether no more beams of a scan's left half than of its right half return within a reach.

    reach: m, float32. Beams are counted from the right.
    """
    middle = first + (end - first) // 2
    surplus = 0
    for k in range(first, end):
        if ranges[k] < reach:
            if k >= middle:
                surplus += 1
            else:
                surplus -= 1
    return surplus <= 0
