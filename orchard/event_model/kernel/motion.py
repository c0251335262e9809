"""What a robot's motion is at the present time, and its alarm."""

from orchard.event_model import columns as c
from orchard.event_model.kernel.compiled import inner


@inner
def set_alarm(m, robot, ticks):
    """Let a robot go on after so many ticks."""
    m.timers[c.WAKE, robot] = m.desk[0].now + c.QUARTERS * ticks


@inner
def x_now(m, robot):
    """Return a robot's x now, m, also on its way."""
    me = m.robots[robot]
    if me.state != c.DRIVING:
        return me.x
    line = m.lines[m.ops[me.op].line]
    if line.axis == 1:
        return me.x
    driven = (m.desk[0].now / c.QUARTERS - me.leg_begun) * me.leg_stride
    return line.sign * min(me.leg_limit, me.leg_from + driven)


@inner
def is_moving(m, robot):
    """Whether a robot has begun to drive."""
    me = m.robots[robot]
    return me.state == c.DRIVING and m.desk[0].now > c.QUARTERS * me.leg_begun
