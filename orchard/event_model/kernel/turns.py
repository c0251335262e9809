"""Turns: a bin on the bar swings clear of the robot behind, or a robot turns off its line."""

from orchard.event_model import codes as c
from orchard.event_model.kernel.batteries import note_rest
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import set_alarm, x_now, y_now
from orchard.event_model.kernel.places import share_roads, tick_of
from orchard.event_model.kernel.roads import (
    BESIDE,
    NEAR,
    NOTICED,
    OFF_THE_LINE,
    leave,
    noticed_at,
    tell_driver_behind,
    tell_followers,
    ticks_of_parts,
)
from orchard.event_model.swing import ASIDE, CARRIER
from orchard.field.kinds import KINDS
from orchard.plans.sense import TURN_MARGIN, sweep_radius

# m. Only carriers tow at this distance: it tells them from pickers.
CARRIER_TOWS = CARRIER.tows
CARRIER_HALF = CARRIER.length / 2
CARRIER_HALF_WIDTH = CARRIER.width / 2
# m from the middle of a carrier to the furthest corner of its bin, and the margin of a turn.
SWEEP = sweep_radius(CARRIER, towing=True) + TURN_MARGIN
# m by which the corner of another carrier seems further away: the beams of a bin's laser are 6
# degrees apart.
UNSEEN = 0.15
# m from the middle of a carrier to the other side of its bin after a quarter turn.
BIN_SIDE = KINDS["bin"].width / 2 + TURN_MARGIN - UNSEEN


@inner
def turn(m, robot):
    """Begin a turn, once nobody is near."""
    me = m.robots[robot]
    note_rest(m, robot)
    me.moved += m.ops[me.op].ticks
    me.moved_at = tick_of(m) + m.ops[me.op].ticks
    ticks = ticks_to_look(m, robot)
    if ticks == 0:
        return swing(m, robot)
    me.state = c.LOOKING_AROUND
    set_alarm(m, robot, ticks)
    return False


@inner
def ticks_to_look(m, robot):
    """Return for how many ticks a robot stands before a turn; 0 if nobody is about."""
    draws = m.looks.shape[1]
    if draws == 0:
        return 0
    me = m.robots[robot]
    look = m.looks[robot, me.turns]
    me.turns += 1
    if me.turns == draws:
        m.desk[0].lacks_draws = True
    if me.bin == c.NONE:
        return look.ticks
    return look.ticks_towing


@inner
def is_barred(m, robot):
    """Whether another carrier stands where the bin of a carrier would swing.

    It is a quarter of a circle: from behind the carrier to the side from which it turns away.
    """
    op = m.ops[m.robots[robot].op]
    is_towing = m.robots[robot].tows == CARRIER_TOWS and m.robots[robot].bin != c.NONE
    if not is_towing or op.faced_x == op.faced_y:
        return False
    for neighbour in range(len(m.robots)):
        is_carrier = m.robots[neighbour].tows == CARRIER_TOWS
        if is_carrier and share_roads(m, robot, neighbour) and swings_into(m, robot, neighbour, op):
            return True
    return False


@inner
def swings_into(m, robot, neighbour, op):
    """Whether the bin of a carrier would swing into another carrier. `op`: the turn."""
    x = x_now(m, neighbour) - m.robots[robot].x
    y = y_now(m, neighbour) - m.robots[robot].y
    # How far the other one is behind the carrier, and on the side from which that turns away, m.
    behind = -(x * op.faced_x + y * op.faced_y)
    aside = -(x * op.faces_x + y * op.faces_y)
    # Half of its box along both directions, m.
    half_behind = CARRIER_HALF
    half_aside = CARRIER_HALF_WIDTH
    if is_across(m, neighbour, op):
        half_behind = CARRIER_HALF_WIDTH
        half_aside = CARRIER_HALF
    nearest_behind = max(0.0, behind - half_behind)
    nearest_aside = max(0.0, aside - half_aside)
    is_beside = behind + half_behind > -BIN_SIDE and aside > -half_aside
    return is_beside and nearest_behind**2 + nearest_aside**2 < SWEEP**2


@inner
def is_across(m, robot, op):
    """Whether a robot is on a line across the one on which another one faces before a turn.

    `op`: the turn.
    """
    line = m.robots[robot].line
    return line != c.NONE and (m.lines[line].axis == 0) != (op.faced_y == 0.0)


@inner
def swing(m, robot):
    """Turn, once no other carrier is in the way. A bin on the bar swings clear of the robot behind,
    or the robot off its line.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    if is_barred(m, robot):
        me.state = c.LOOKING_AROUND
        set_alarm(m, robot, 1)
        return False
    if me.bin != c.NONE and not me.is_across:
        me.state = c.SWINGING_BIN
        set_alarm(m, robot, op.swings)
        if me.tows == CARRIER_TOWS:
            swing_bin(m, robot, False)
    elif me.is_across and is_beside_line(m, robot):
        me.state = c.SWINGING_OFF
        set_alarm(m, robot, op.swings)
        if turns_back(m, robot):
            set_alarm(m, robot, min(op.ticks, ticks_of_parts(m, OFF_THE_LINE)))
            swing_bin(m, robot, True)
    else:
        me.state = c.LASTING
        set_alarm(m, robot, op.ticks)
    return False


@inner
def swing_bin(m, robot, is_aside):
    """Begin to swing a bin. A robot behind it sees that from the next tick on."""
    me = m.robots[robot]
    noticed = m.desk[0].now + c.QUARTERS * NOTICED
    me.swings_since = tick_of(m)
    me.swings_aside = is_aside
    tell_followers(m, robot, noticed)
    tell_driver_behind(m, robot, noticed)


@inner
def turns_back(m, robot):
    """Whether a carrier turns in a line of the queue beside the one that it has left, along it."""
    me = m.robots[robot]
    is_towing = me.tows == CARRIER_TOWS and me.bin != c.NONE
    return is_towing and leads_back(m, me.op, me.line)


@inner
def leads_back(m, turn_op, left_line):
    """Whether a turn leads into a line of the queue beside the line that was left, along it."""
    after = turn_op + 1
    while m.ops[after].kind == c.HOME or m.ops[after].kind == c.CHARGE:
        after += 1
    following = m.ops[after]
    if following.kind != c.DRIVE:
        return False
    left = m.lines[left_line]
    line = m.lines[following.line]
    is_along = line.axis == left.axis and line.sign == left.sign
    return is_along and abs(abs(line.other - left.other) - ASIDE) < NEAR


@inner
def is_beside_line(m, robot):
    """Whether a robot is clear of the line on which it was."""
    me = m.robots[robot]
    if me.line == c.NONE:
        return False
    line = m.lines[me.line]
    across = me.y if line.axis == 0 else me.x
    return abs(across - line.other) > BESIDE


@inner
def swung(m, robot):
    """Tell the robots behind that the bin is out of their way, or the robot is, and turn on."""
    me = m.robots[robot]
    op = m.ops[me.op]
    swung_for = op.swings
    noticed = noticed_at(m, robot)
    if me.state == c.SWINGING_BIN:
        me.is_across = True
    else:
        leave(m, robot)
    if me.swings_since != c.NEVER:
        swung_for = tick_of(m) - me.swings_since
        noticed = m.desk[0].now
    tell_followers(m, robot, noticed)
    me.state = c.LASTING
    set_alarm(m, robot, op.ticks - swung_for)
    return False
