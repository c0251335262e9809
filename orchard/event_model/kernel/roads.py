"""Robots that follow each other on a line, where no places keep them apart.

A line keeps the order of its robots: each knows the one ahead and the one behind, and the line
knows the last one. A robot sees the one ahead where that is at the beginning of a tick, and drives
a whole step, or not.
"""

from math import ceil, inf

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.places import tick_of
from orchard.event_model.swing import ASIDE, reaches_back
from orchard.field.kinds import KINDS
from orchard.field.repeatable import PI
from orchard.plans.sense import SIDE_MARGIN, STOP_DISTANCE

BIN_HALF = KINDS["bin"].length / 2
# m, after each part of a turn off a line, and of the turn beside it that follows: a part is the
# angle of a tick at the usual rate.
REACHES_BACK = reaches_back()
REACHES_FROM_ASIDE = reaches_back(ASIDE, -0.5 * PI)
# Parts of that second turn after which nothing is on the line.
OFF_THE_LINE = REACHES_FROM_ASIDE.index(-inf)
# m that a train drives to be off a line.
CLEAR = KINDS["carrier"].tows + BIN_HALF + KINDS["carrier"].width / 2 + SIDE_MARGIN
# m that a robot drives to be off a line itself, so that only its bin is there.
ONLY_BIN = KINDS["carrier"].length / 2 + KINDS["carrier"].width / 2 + SIDE_MARGIN
# m from a line at which a robot is clear of it.
BESIDE = KINDS["carrier"].width / 2 + KINDS["bin"].width / 2 + SIDE_MARGIN
# Ticks until the robot behind drives on, and one more if it sees the bin, which follows its robot.
NOTICED = 1
# m of rounding: what is nearer counts as reached.
NEAR = 1e-6


@inner
def enter(m, robot, line, at):
    """Leave the line before, and enter a line at a coordinate in its direction."""
    leave(m, robot)
    me = m.robots[robot]
    rears = m.rears[me.roads]
    behind = c.NONE
    ahead = rears[line]
    while ahead != c.NONE and m.robots[ahead].line_end < at:
        behind = ahead
        ahead = m.robots[ahead].ahead
    me.line = line
    me.line_end = at
    me.is_across = False
    me.ahead = ahead
    me.behind = behind
    if ahead != c.NONE:
        m.robots[ahead].behind = robot
    if behind != c.NONE:
        m.robots[behind].ahead = robot
    else:
        rears[line] = robot


@inner
def leave(m, robot):
    """Leave the line, if the robot is on one."""
    me = m.robots[robot]
    if me.line == c.NONE:
        return
    if me.ahead != c.NONE:
        m.robots[me.ahead].behind = me.behind
    if me.behind != c.NONE:
        m.robots[me.behind].ahead = me.ahead
    else:
        m.rears[me.roads, me.line] = me.ahead
    me.line = c.NONE
    me.ahead = c.NONE
    me.behind = c.NONE


@inner
def robot_ahead(m, robot, line, at):
    """Return the robot that one at a coordinate of a line follows there, or would follow."""
    me = m.robots[robot]
    if me.line == line:
        return me.ahead
    ahead = m.rears[me.roads, line]
    while ahead != c.NONE and m.robots[ahead].line_end < at:
        ahead = m.robots[ahead].ahead
    return ahead


@inner
def room(m, robot, ahead):
    """Return up to where a robot may drive behind another one, along its line, m."""
    return room_at(m, robot, ahead, tick_of(m))


@inner
def room_at(m, robot, ahead, tick):
    """Return up to where a robot may drive at a tick behind another one, along its line, m."""
    other = m.robots[ahead]
    if other.swings_since != c.NEVER and other.swings_aside:
        tail = REACHES_FROM_ASIDE[min(parts_swung(m, ahead, tick), OFF_THE_LINE)]
    elif other.swings_since != c.NEVER:
        tail = REACHES_BACK[min(parts_swung(m, ahead, tick), len(REACHES_BACK) - 1)]
    elif (
        other.is_across and not other.has_arrived and other.here - other.left_at >= ONLY_BIN - NEAR
    ):
        tail = BIN_HALF
    elif other.is_across:
        tail = other.width / 2
    elif other.bin != c.NONE:
        tail = other.tows + BIN_HALF
    else:
        tail = other.length / 2
    return other.line_end - tail - STOP_DISTANCE - m.robots[robot].length / 2


@inner
def parts_swung(m, robot, tick):
    """Return the whole parts of its turn that a carrier has done at a tick."""
    return int((tick - m.robots[robot].swings_since) * m.desk[0].carrier_turning + NEAR)


@inner
def ticks_of_parts(m, parts):
    """Return the ticks in which a carrier does so many parts of a turn."""
    return ceil(parts / m.desk[0].carrier_turning - NEAR)


@inner
def whole_steps(here, end, step):
    """Return where a robot stops that drives in whole steps up to an end, or past it, m."""
    if end <= here + NEAR:
        return end
    return here + ceil((end - here) / step - NEAR) * step


@inner
def room_in_steps(m, robot, ahead, step):
    """Return up to where a robot drives in steps behind another one, along its line, m."""
    here = m.robots[robot].here
    end = room(m, robot, ahead)
    if end <= here + NEAR:
        end += run_on(m, ahead)
    if m.robots[ahead].swings_since == c.NEVER:
        return whole_steps(here, end, step)
    # It goes on behind the bin that swings out of its way, as long as that is fast enough.
    tick = tick_of(m)
    while end > here + NEAR:
        if end == inf:
            return end
        here += step
        tick += 1
        end = room_at(m, robot, ahead, tick)
    return here


@inner
def ticks_to_swing_clear(m, robot, ahead):
    """Return the ticks until a robot that stands behind a bin that swings may drive a step."""
    here = m.robots[robot].here
    tick = tick_of(m)
    longest = ticks_of_parts(m, len(REACHES_BACK))
    for ticks in range(1, longest):
        if room_at(m, robot, ahead, tick + ticks) > here + NEAR:
            return ticks
    return longest


@inner
def run_on(m, robot):
    """Return how far a robot's bin is ahead of its place now, m.

    In the tick in which its robot stands, a bin takes it that the robot drives on.
    """
    me = m.robots[robot]
    has_just_stood = me.state != c.DRIVING and me.leg_ended == tick_of(m) - 1
    if me.bin == c.NONE or me.is_across or not has_just_stood:
        return 0.0
    driven = me.here - me.leg_from
    return driven - (ceil(driven / me.leg_stride - NEAR) - 1) * me.leg_stride


@inner
def last_to_wake(m, robot):
    """Return the robot behind this one, or behind that and so on, that wakes at the same time.

    It acts first: in a tick no robot knows yet what the one ahead does in it.
    """
    behind = m.robots[robot].behind
    while behind != c.NONE and m.timers[c.WAKE, behind] == m.desk[0].now:
        robot = behind
        behind = m.robots[robot].behind
    return robot


@inner
def tell_followers(m, robot, when):
    """Let the robots that wait behind this one look again at a time."""
    for other in range(len(m.robots)):
        if m.robots[other].follows == robot:
            m.robots[other].follows = c.NONE
            m.timers[c.WAKE, other] = min(m.timers[c.WAKE, other], when)


@inner
def stop_short(m, robot, at):
    """Let a robot's way on its line end before it was to. A robot behind it looks again."""
    m.robots[robot].line_end = at
    tell_driver_behind(m, robot, noticed_at(m, robot))


@inner
def tell_driver_behind(m, robot, when):
    """Let the robot that drives behind this one look again at a time."""
    behind = m.robots[robot].behind
    if behind == c.NONE or m.robots[behind].state != c.DRIVING:
        return
    if m.robots[behind].leg_ahead == robot:
        m.timers[c.WAKE, behind] = min(m.timers[c.WAKE, behind], when)


@inner
def noticed_at(m, robot):
    """Return when the robot behind notices that this one drives on or stands."""
    noticed = NOTICED
    if m.robots[robot].bin != c.NONE:
        noticed += 1
    return m.desk[0].now + c.QUARTERS * noticed
