"""How a failure or an absence splits a drive: for the step `MayFail`, and for the event model,
which compiles these functions.

All positions are along the axis of the drive, m.
"""

from math import inf

# m past a gate at which a robot that stands is clear of one that turns behind it. No laser sees
# the front corner of the turning robot.
CLEAR_OF_TURNS = 3.0
# m past such a gate at which a robot has given its places back, so that it may leave.
OFF_THE_ROAD = CLEAR_OF_TURNS + 0.1
# s before its bin is full from which on a picker fills it before it leaves: a carrier may be on its
# way, and would wait there. On a drive of less than twice as long, it is the second half.
FILLED_FIRST = 600.0
# s in one step of a repair. A run is jammed after 600 s without progress.
LONGEST_WAIT = 300.0
# s. A robot that comes back stands up to the tick, so of an absence less than this may remain.
OVER = 1.0


def work_left(until: float, worked: float) -> float:
    """Return the time of work up to the next failure, s.

    `until`: from the last repair to the failure; `worked`: since that repair.
    """
    return max(0.0, until - worked)


def last_leave(needed: float) -> float:
    """Return until when a picker leaves on a drive, s of work. `needed`: for the drive, s."""
    return max(needed - FILLED_FIRST, needed / 2.0)


def off_the_road(metres: float, speed: float) -> float:
    """Return from when on a robot keeps no place of a gate that it passes, s of work.

    `metres`: to the gate, in the direction of the drive; `speed`: m/s.
    """
    return (metres + OFF_THE_ROAD) / speed


def work_until_away(begin: float, end: float, now: float, first: float, last: float) -> float:
    """Return the time of work up to an absence, s; infinity if it does not begin on this drive.

    `begin`, `end`: of the absence, and `now`: when the drive begins, s since the harvest began.
    `first`, `last`: s of the drive between which the robot keeps no place on a road: one that
    is away for long must not bar it.
    """
    work = max(first, begin - now)
    if work > last or end - now - work < OVER:
        return inf
    return work


def stop_of(here: float, distance: float, work: float, needed: float) -> float:
    """Return where a robot stops that fails on a drive.

    `distance`: of the drive, with its sign; `work`: before it fails, s; `needed`: for the drive, s.
    """
    return here + distance * work / needed


def is_asked_for(gate: float, stop: float, distance: float) -> bool:
    """Whether the robot asks for the places of a gate: it asks for none that it does not come
    to.
    """
    return (stop - gate) * distance > 0.0


def is_freed(gate: float, stop: float) -> bool:
    """Whether the robot gives the places of a gate back: it keeps what it stands near."""
    return abs(stop - gate) > CLEAR_OF_TURNS


def first_part(seconds: float) -> float:
    """Return the time for which a repair is first waited for, s."""
    return min(seconds, LONGEST_WAIT)
