"""What a robot's motion is at the present time, and its alarm."""

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.field import ticks
from orchard.field.scenario import TIME_STEP

whole_ticks = inner(ticks.whole_ticks)


@inner
def set_alarm(m, robot, ticks):
    """Let a robot go on after so many ticks."""
    m.timers[c.WAKE, robot] = m.desk[0].now + c.QUARTERS * ticks


@inner
def after_ticks(here, goal, step, ticks):
    """Return where a robot is that has driven towards a goal for some ticks, m.

    It is added up tick by tick as physics does, to the last bit: whether a robot is nearer to a
    gate than the distance at which it asks is often a matter of rounding. `step`: m in a tick.
    """
    # Whole steps that surely end before the goal. The rest are cut off there, as physics does it:
    # by a velocity that is less in the last tick.
    whole = min(ticks, int((goal - here) / step) - 1)
    for _ in range(whole):
        here += step
    for _ in range(max(0, whole), ticks):
        here += min(step, TIME_STEP * (max(0.0, goal - here) / TIME_STEP))
    return here


@inner
def x_now(m, robot):
    """Return a robot's x now, m, also on its way."""
    return coordinate_now(m, robot, 0, m.robots[robot].x)


@inner
def y_now(m, robot):
    """Return a robot's y now, m, also on its way."""
    return coordinate_now(m, robot, 1, m.robots[robot].y)


@inner
def coordinate_now(m, robot, axis, noted):
    """Return a coordinate of a robot now, m.

    `axis`: 0 is x, 1 is y. `noted`: the coordinate where it began what it does.
    """
    me = m.robots[robot]
    if me.state != c.DRIVING:
        return noted
    line = m.lines[m.ops[me.op].line]
    if line.axis != axis:
        return noted
    ticks = m.desk[0].now // c.QUARTERS - me.leg_begun
    return line.sign * after_ticks(me.leg_from, me.leg_goal, me.leg_stride, ticks)


@inner
def is_moving(m, robot):
    """Whether a robot has begun to drive."""
    me = m.robots[robot]
    return me.state == c.DRIVING and m.desk[0].now > c.QUARTERS * me.leg_begun
