"""Drives: a robot drives leg by leg, up to a gate whose places it lacks or the robot ahead.

A drive leads along one line, and positions are coordinates along it that grow (`LINE`). A "leg" is
a part of a drive in which nothing changes. A "gate" is a point of a drive where the robot needs
places, or gives them back. A "train" is a robot with its bin.
"""

from math import ceil, floor

from orchard.event_model import codes as c
from orchard.event_model.kernel.batteries import delay_charge, note_rest, ticks_to_flat
from orchard.event_model.kernel.bay import be_held_up, begin_anew
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.failures import fail, is_repaired, may_fail
from orchard.event_model.kernel.motion import after_ticks, set_alarm
from orchard.event_model.kernel.places import (
    free_places,
    has_places,
    share_any,
    tick_of,
    ticks_to_answer,
    want_places,
)
from orchard.event_model.kernel.reports import (
    hear_failed,
    hear_repaired,
    see_leg,
    see_standing,
)
from orchard.event_model.kernel.roads import (
    CLEAR,
    NEAR,
    NOTICED,
    ONLY_BIN,
    enter,
    noticed_at,
    robot_ahead,
    room_in_steps,
    stop_short,
    tell_followers,
    ticks_to_swing_clear,
)
from orchard.field.scenario import TIME_STEP
from orchard.plans import driving, failures
from orchard.plans.robot import ASK, LOOK_AGAIN

asked_ahead = inner(driving.asked_ahead)
is_asked_for = inner(failures.is_asked_for)
is_freed = inner(failures.is_freed)

# m. In place of a coordinate: there is none, nothing is in the way.
FAR = 1e18
# The sign of a distance along the line of a drive, which leads where coordinates grow.
FORWARD = 1.0


@inner
def depart(m, robot):
    """Begin a drive. Return whether it is done at once."""
    me = m.robots[robot]
    op = m.ops[me.op]
    line = m.lines[op.line]
    me.here = line.sign * (me.x if line.axis == 0 else me.y)
    me.next_need = op.first_need
    me.next_free = op.first_free
    me.left_at = me.here
    if me.line != c.NONE and m.lines[me.line].axis != line.axis:
        # The line that it has left may be behind it.
        me.left_at = min(me.here, line.sign * m.lines[me.line].other)
    if me.line == c.NONE:
        arrive(m, robot, op.line)
    me.has_arrived = me.line == op.line
    me.stop = op.target
    me.fails = False
    me.bin_asked = c.NONE
    me.meeting = me.here + me.clear
    if op.mean_between > 0.0 or op.may_leave:
        may_fail(m, robot, speed_of(m, op))
    return drive_on(m, robot)


@inner
def stand_for(m, robot):
    """Stand for a person or an animal that is in the way."""
    me = m.robots[robot]
    see_standing(m, robot)
    me.state = c.MEETING
    set_alarm(m, robot, m.encounters[robot, me.meetings].ticks)


@inner
def go_on_alone(m, robot):
    """Drive on after a meeting. Return whether the drive is done."""
    end_meeting(m, robot)
    return drive_on(m, robot)


@inner
def end_meeting(m, robot):
    """Know where the next meeting is."""
    me = m.robots[robot]
    me.meetings += 1
    me.meeting = me.here + m.encounters[robot, me.meetings].metres
    if me.meetings == m.encounters.shape[1] - 1:
        m.desk[0].lacks_draws = True


@inner
def is_in_bay(m, robot):
    """Whether a carrier that is held up has come to a place of the bay, and unloads there."""
    me = m.robots[robot]
    return me.here >= m.ops[me.op].unloads_from - NEAR


@inner
def end_drive(m, robot):
    """Stand where the drive ends, or the robot fails. Return whether the drive is done."""
    me = m.robots[robot]
    me.clear = me.meeting - me.here
    if me.fails:
        fail(m, robot)
    return not me.fails


@inner
def speed_of(m, op):
    """Return the speed of a drive, m/s."""
    if op.speed == 0.0:
        return m.speeds[op.arg]
    return op.speed


@inner
def go_on_repaired(m, robot):
    """Drive on after a part of a repair, if it was the last. Return whether the drive is done."""
    if is_repaired(m, robot):
        return depart(m, robot)
    return False


@inner
def arrive(m, robot, line):
    """Be on a line from here on."""
    enter(m, robot, line, m.robots[robot].here)
    tell_followers(m, robot, m.desk[0].now)


@inner
def drive_on(m, robot):
    """Drive the next leg, or stand. Return whether the drive is done."""
    me = m.robots[robot]
    op = m.ops[me.op]
    if op.is_queueing and me.next_op != c.NONE:
        leave_queue(m, robot)
        return True
    if me.here > me.meeting - NEAR:
        return meet(m, robot)
    free_passed(m, robot)
    gate, ticks = next_gate(m, robot)
    come_onto_line(m, robot)
    ahead = robot_ahead(m, robot, op.line, me.here)
    free_to = free_behind(m, robot, ahead)
    goal = min(me.stop, gate, me.meeting)
    limit = min(goal, max(me.here, free_to))
    tell_limit(m, robot, limit)
    if limit - me.here <= NEAR:
        return halt(m, robot, ahead, free_to)
    me.leg_goal = goal
    me.leg_ahead = ahead
    begin_leg(m, robot, limit, ticks)
    return False


@inner
def leave_queue(m, robot):
    """End a drive in the queue because of an order: the robot drives no further along its line."""
    me = m.robots[robot]
    me.clear = me.meeting - me.here
    if me.has_arrived and me.line_end > me.here + NEAR:
        stop_short(m, robot, me.here)


@inner
def meet(m, robot):
    """Stand for a person or an animal, unless in the bay. Return whether the drive is done."""
    if not is_in_bay(m, robot):
        stand_for(m, robot)
        return False
    end_meeting(m, robot)
    m.robots[robot].stood = tick_of(m)
    return end_drive(m, robot)


@inner
def come_onto_line(m, robot):
    """Be on the line of the drive once the train, or all but its bin, is off the line before."""
    me = m.robots[robot]
    if me.has_arrived:
        return
    driven = me.here - me.left_at
    if driven >= CLEAR - NEAR:
        arrive(m, robot, m.ops[me.op].line)
        me.has_arrived = True
    elif driven >= ONLY_BIN - NEAR:
        tell_followers(m, robot, m.desk[0].now)


@inner
def free_behind(m, robot, ahead):
    """Return up to where a robot may drive behind the one ahead, if there is one, m."""
    if ahead == c.NONE:
        return FAR
    return room_in_steps(m, robot, ahead, speed_of(m, m.ops[m.robots[robot].op]) * TIME_STEP)


@inner
def tell_limit(m, robot, limit):
    """Let the robots behind know up to where this one now drives on its line."""
    me = m.robots[robot]
    if not me.has_arrived:
        return
    if limit > me.line_end + NEAR:
        me.line_end = limit
        tell_followers(m, robot, noticed_at(m, robot))
    elif limit < me.line_end - NEAR:
        stop_short(m, robot, limit)


@inner
def halt(m, robot, ahead, free_to):
    """Stand where the drive ends, or before what is in the way. Return whether the drive is done.

    `free_to`: up to where the robot ahead lets it drive, m.
    """
    me = m.robots[robot]
    me.stood = tick_of(m)
    if me.bin != c.NONE and me.leg_ended == me.stood:
        # Its bin runs on for a tick, and a robot that stands behind the bin drives a step.
        tell_followers(m, robot, m.desk[0].now + c.QUARTERS * NOTICED)
    is_held_up = ahead != c.NONE and free_to <= me.here + NEAR
    if me.stop - me.here <= NEAR or (is_held_up and is_in_bay(m, robot)):
        return end_drive(m, robot)
    if is_held_up:
        stand(m, robot, ahead)
    else:
        stand(m, robot, c.NONE)
    return False


@inner
def begin_leg(m, robot, limit, ticks):
    """Drive up to a limit, or to where something changes before it.

    The robot knows the leg's goal, and the robot ahead. `ticks`: until it asks for places.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    stride = speed_of(m, op) * TIME_STEP
    until = min(limit, next_place_freed(m, robot))
    if not me.has_arrived:
        until = min(until, me.left_at + off_the_line_before(me))
    ticks = min(ceil((until - me.here) / stride - NEAR), ticks)
    if me.wanted != 0:
        me.hears_grants = True
        if limit < me.leg_goal:
            ticks = min(ticks, ticks_to_answer(m, robot))
    if op.picks or op.is_seen:
        hear_repaired(m, robot)
    note_rest(m, robot)
    begin_anew(m, robot)
    ticks = min(ticks, ticks_to_flat(m, robot))
    me.leg_begun = tick_of(m)
    me.leg_from = me.here
    me.leg_stride = stride
    if op.is_seen:
        see_leg(m, robot, limit)
    me.state = c.DRIVING
    set_alarm(m, robot, ticks)


@inner
def off_the_line_before(me):
    """Return how far a robot drives from the line before until less of it is there, m: only its
    bin, and then nothing.
    """
    if me.here - me.left_at >= ONLY_BIN - NEAR:
        return CLEAR
    return ONLY_BIN


@inner
def end_leg(m, robot):
    """Be where the leg has led to by now."""
    me = m.robots[robot]
    me.leg_ended = tick_of(m)
    ticks = me.leg_ended - me.leg_begun
    me.moved += me.leg_ended - max(me.leg_begun, me.counted)
    me.moved_at = me.leg_ended
    if me.is_charging:
        delay_charge(m, robot, ticks)
    me.here = after_ticks(me.leg_from, me.leg_goal, me.leg_stride, ticks)
    line = m.lines[m.ops[me.op].line]
    place = line.sign * me.here
    if line.axis == 1:
        me.y = place
        return
    me.x = place
    gone = m.desk[0].exit
    if me.leg_from <= gone < me.here and me.away == c.NEVER:
        me.away = me.leg_begun + (gone - me.leg_from) / me.leg_stride


@inner
def stand(m, robot, ahead):
    """Stand until the robot ahead drives on, a bin answers that it is left, or places are
    granted.
    """
    me = m.robots[robot]
    me.state = c.STANDING
    me.follows = ahead
    op = m.ops[me.op]
    if op.picks or op.is_seen:
        hear_failed(m, robot)
    see_standing(m, robot)
    ticks = c.NEVER
    if me.bin_asked != c.NONE and not me.knows_left:
        ticks = ticks_to_word(m, robot)
    if me.wanted != 0:
        me.hears_grants = True
        if ahead != c.NONE:
            ticks = ticks_to_answer(m, robot)
    if ahead != c.NONE and m.robots[ahead].swings_since != c.NEVER:
        ticks = min(ticks, ticks_to_swing_clear(m, robot, ahead))
    if ticks != c.NEVER:
        set_alarm(m, robot, ticks)
    be_held_up(m, robot)
    m.timers[c.WAKE, robot] = min(m.timers[c.WAKE, robot], me.emptied_next)


@inner
def stop_flat(m, carrier):
    """Stand with a flat battery, and ask for no places. Return that the op is not done."""
    me = m.robots[carrier]
    if me.state == c.FLAT:
        return False
    if me.state == c.DRIVING:
        me.stood = tick_of(m)
        if me.has_arrived:
            stop_short(m, carrier, me.here)
        if me.bin != c.NONE:
            tell_followers(m, carrier, m.desk[0].now + c.QUARTERS * NOTICED)
    me.state = c.FLAT
    me.wanted = 0
    me.wish = 0
    return False


@inner
def go_on_charged(m, carrier):
    """Go on after the battery was flat, and is full. Return whether the op is done."""
    if m.ops[m.robots[carrier].op].kind == c.DRIVE:
        return drive_on(m, carrier)
    return True


@inner
def free_passed(m, robot):
    """Give back the places of the gates that the robot has come to."""
    me = m.robots[robot]
    last = m.ops[me.op].last_free
    while me.next_free < last and me.here > m.frees[me.next_free].at - NEAR:
        gate = m.frees[me.next_free]
        if not me.fails or is_freed(gate.at, me.stop):
            free_places(m, robot, gate.places)
        me.next_free += 1


@inner
def next_place_freed(m, robot):
    """Return where the robot gives back the next place that it has, m."""
    me = m.robots[robot]
    for number in range(me.next_free, m.ops[me.op].last_free):
        gate = m.frees[number]
        is_kept = me.fails and not is_freed(gate.at, me.stop)
        if not is_kept and share_any(m.places[gate.places], m.sets[c.OWN, robot]):
            return gate.at
    return FAR


@inner
def next_gate(m, robot):
    """Ask for the places of the next gate that the robot lacks, if it is time.

    Return where that gate is, m, and in how many ticks the robot asks for its places, or hears
    whether it may.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    while me.next_need < op.last_need:
        gate = m.needs[me.next_need]
        is_ahead = me.here <= gate.at + NEAR and not has_places(m, robot, gate.places)
        if is_ahead and (not me.fails or is_asked_for(gate.at, me.stop, FORWARD)):
            break
        me.next_need += 1
    if me.next_need == op.last_need:
        return FAR, c.NEVER
    gate = m.needs[me.next_need]
    ahead = asked_ahead(speed_of(m, op))
    is_near = gate.at - me.here < ahead
    if not is_near:
        before = gate.at - me.here - ahead
        stride = speed_of(m, op) * TIME_STEP
        return gate.at, max(1, floor(before / stride - NEAR) + 1)
    if gate.after_bin and not is_told_left(m, robot):
        return gate.at, ticks_to_word(m, robot)
    want_places(m, robot, gate.places, c.NONE)
    return gate.at, c.NEVER


@inner
def is_told_left(m, robot):
    """Whether a carrier has heard that its full bin is left. It asks the bin again and again."""
    me = m.robots[robot]
    tick = tick_of(m)
    if me.bin_asked == c.NONE:
        me.bin_asked = tick
    full_bin = m.bins[me.job_bin]
    # The bin heard the question a tick before its answer came.
    is_answer = tick > me.bin_asked and (tick - me.bin_asked - ASK) % LOOK_AGAIN == 0
    if is_answer and full_bin.is_left and full_bin.left_at < tick:
        me.knows_left = True
    return me.knows_left


@inner
def ticks_to_word(m, robot):
    """Return the ticks until a carrier hears the next answer of its full bin."""
    asked = tick_of(m) - m.robots[robot].bin_asked
    return LOOK_AGAIN - (asked - ASK) % LOOK_AGAIN
