"""How a failure or an absence splits a drive: for the step `MayFail` of orchard/plans/steps.py, and
for the event model, which compiles these functions.

A robot that fails, or goes away, stops on its drive and stands for a while. Work is the time for
which it drives or picks. All positions are along the axis of the drive, m.
"""

from math import inf

# m past a gate at which a robot that stands is clear of one that turns behind it. No laser sees
# the front corner of the turning robot.
CLEAR_OF_TURNS = 3.0
# m past such a gate at which a robot has given its places back, so that it may go away: a little
# more than CLEAR_OF_TURNS, because within that it keeps them.
OFF_THE_ROAD = CLEAR_OF_TURNS + 0.1
# s. In the last 600 s before its bin is full a picker does not go away: a carrier may be on its way
# to the bin, and would wait there. On a drive of less than twice that time these are the second
# half of it.
FILLED_FIRST = 600.0
# s in one step of a repair. A run is jammed after 600 s without progress, so a step is shorter.
LONGEST_WAIT = 300.0
# s. An absence of which less remains is over: a robot stands for whole ticks, so a rest may remain.
OVER = 1.0


def work_left(until: float, worked: float) -> float:
    """Return the time of work up to the next failure, s.

    `until`: the work between the last repair and the failure; `worked`: that since the repair, s.
    """
    return max(0.0, until - worked)


def last_leave(needed: float) -> float:
    """Return until when a picker may go away on a drive, s of work. `needed`: for the drive, s."""
    return max(needed - FILLED_FIRST, needed / 2.0)


def off_the_road(metres: float, speed: float) -> float:
    """Return from when on a robot has no place of a gate any more, s of work on this drive.

    `metres`: to the gate, in the direction of the drive; `speed`: m/s.
    """
    return (metres + OFF_THE_ROAD) / speed


def work_until_away(begin: float, end: float, now: float, first: float, last: float) -> float:
    """Return the time of work up to an absence, s; infinity if it does not begin on this drive.

    `begin`, `end`: of the absence, and `now`: when the drive begins, s since the harvest began.
    `first`, `last`: s of work between which the robot may go away. It then has no place on a road:
    a robot that is away for long must not bar the road.
    """
    work = max(first, begin - now)
    if work > last or end - now - work < OVER:
        return inf
    return work


def stop_of(here: float, distance: float, work: float, needed: float) -> float:
    """Return the position at which a robot that fails on a drive stops.

    `here`: its position now. `distance`: of the drive, with its sign. `work`: before the failure,
    and `needed`: for the whole drive, s.
    """
    return here + distance * work / needed


def is_asked_for(gate: float, stop: float, distance: float) -> bool:
    """Whether a robot that stops on a drive asks for the places of a gate: it comes to the gate.

    `gate`, `stop`: positions. `distance`: of the drive, with its sign.
    """
    return (stop - gate) * distance > 0.0


def is_freed(gate: float, stop: float) -> bool:
    """Whether a robot that stops on a drive gives the places of a gate back.

    It keeps those of a gate near its stop. `gate`, `stop`: positions.
    """
    return abs(stop - gate) > CLEAR_OF_TURNS


def first_part(seconds: float) -> float:
    """Return the time of the first step of a repair, s. `seconds`: of the whole repair."""
    return min(seconds, LONGEST_WAIT)
