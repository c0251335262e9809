"""The inner loops of lookahead: which holds end. Arrays have one row per body; `ranges` are the scans of all bodies in one array."""

from orchard.sim.kernels.jit import inlined, jit

NONE = -1  # as an index: none


@jit
def end_holds(
    ranges, before, tick, until, wanted, twist, coupled, partner, partner_twist, full, was_full, watched, was_occupied, still,
    freer_within, was_left_freer, spans, begin,
):  # fmt: skip
    """Set `until`, (n,) ticks, to 0 for each body with a hold that ends at this tick.

    wanted (n, 3): the velocity that is applied again; partner, partner_twist, was_full: what the body observed when it answered;
    watched, still (n, z): indices into spans, (k, 2, beams), or NONE; before: the ranges of the tick before; freer_within: m, or 0.
    """
    for i in range(len(until)):
        j = coupled[i]
        if (
            until[i] <= tick
            or differs(wanted[i], twist[i])
            or j != partner[i]
            or (j != NONE and differs(twist[j], partner_twist[i]))
            or full[i] != was_full[i]
        ):
            until[i] = 0
            continue
        if (
            freer_within[i] > 0.0
            and left_freer(ranges, begin[i], begin[i + 1], freer_within[i]) != was_left_freer[i]
        ):
            until[i] = 0
        for z in range(watched.shape[1]):
            if (
                watched[i, z] != NONE
                and occupied(ranges, begin[i], begin[i + 1], spans[watched[i, z]])
                != was_occupied[i, z]
            ):
                until[i] = 0
            if still[i, z] != NONE and changed(
                ranges, before, begin[i], begin[i + 1], spans[still[i, z]]
            ):
                until[i] = 0


@jit
def begin_holds(
    ranges, bodies, twist, coupled, partner, partner_twist, full, was_full, watched, was_occupied, freer_within, was_left_freer,
    spans, begin,
):  # fmt: skip
    """Note what these bodies, (b,) indices, observe at the tick of their answers."""
    for i in bodies:
        partner[i], was_full[i] = coupled[i], full[i]
        if coupled[i] != NONE:
            for axis in range(3):
                partner_twist[i, axis] = twist[coupled[i], axis]
        was_left_freer[i] = left_freer(ranges, begin[i], begin[i + 1], freer_within[i])
        for z in range(watched.shape[1]):
            if watched[i, z] != NONE:
                was_occupied[i, z] = occupied(ranges, begin[i], begin[i + 1], spans[watched[i, z]])


@inlined
def differs(one, other):
    return one[0] != other[0] or one[1] != other[1] or one[2] != other[2]


@inlined
def occupied(ranges, first, end, span):
    """Whether a return of one scan lies in a zone, given by the ranges at which each beam enters and leaves it."""
    found = False
    for k in range(end - first):
        found |= span[0, k] <= ranges[first + k] < span[1, k]
    return found


@inlined
def changed(ranges, before, first, end, span):
    """Whether a return of one scan in a zone has come, gone or changed since the tick before."""
    found = False
    for k in range(end - first):
        now, then = ranges[first + k], before[first + k]
        found |= now != then and (span[0, k] <= now < span[1, k] or span[0, k] <= then < span[1, k])
    return found


@inlined
def left_freer(ranges, first, end, reach):
    """Whether no more beams of the left half of one scan than of the right half return within a reach (float32), m."""
    middle, more = first + (end - first) // 2, 0
    for k in range(first, end):
        if ranges[k] < reach:
            more += 1 if k >= middle else -1
    return more <= 0
