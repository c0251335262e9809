"""How a failure splits a drive: for the step `MayFail`, and for the event model, which compiles
these functions.

All positions are along the axis of the drive, m.
"""

# m past a gate at which a robot that stands is clear of one that turns behind it. No laser sees
# the front corner of the turning robot.
CLEAR_OF_TURNS = 3.0
# s in one step of a repair. A run is jammed after 600 s without progress.
LONGEST_WAIT = 300.0


def work_left(until: float, worked: float) -> float:
    """Return the time of work up to the next failure, s.

    `until`: from the last repair to the failure; `worked`: since that repair.
    """
    return max(0.0, until - worked)


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
