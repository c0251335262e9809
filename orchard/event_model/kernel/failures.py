"""Failures and absences: on a drive a robot may fail, or leave, and stands until it goes on.

`orchard.plans.failures` says how a failure splits the drive. Python fills the draws.
"""

from math import inf

from orchard.event_model import codes as c
from orchard.event_model.kernel.bay import begin_anew, go_on_emptying, may_be_emptied
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import whole_ticks
from orchard.event_model.kernel.places import tick_of
from orchard.event_model.kernel.reports import hear_failed, hear_repaired, see_standing
from orchard.field.ticks import TIME_STEP
from orchard.plans import failures

last_leave = inner(failures.last_leave)
first_part = inner(failures.first_part)
off_the_road = inner(failures.off_the_road)
stop_of = inner(failures.stop_of)
work_left = inner(failures.work_left)
work_until_away = inner(failures.work_until_away)


@inner
def may_fail(m, robot, speed):
    """Decide, before a robot drives at a speed, whether it fails or leaves on the way, and
    where.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    distance = op.target - me.here
    needed = distance / speed
    present = inf
    if op.may_leave:
        present = until_away(m, robot, speed)
    sound = inf
    if op.mean_between > 0.0:
        sound = work_left(op.mean_between * m.failures[robot, me.failures].until, me.worked)
    work = min(present, sound)
    if work >= needed:
        me.worked += needed
        return
    me.fails = True
    me.stop = stop_of(me.here, distance, work, needed)
    if present <= sound:
        me.worked += present
        return
    me.repair = op.mean_repair * m.failures[robot, me.failures].repair
    me.failures += 1
    me.worked = 0.0
    if me.failures == m.failures.shape[1]:
        m.desk[0].lacks_draws = True


@inner
def until_away(m, robot, speed):
    """Return the time of work up to an absence, s; infinity if none begins on this drive.

    It leaves with the robot for how long it is away then.
    """
    me = m.robots[robot]
    op = m.ops[me.op]
    needed = (op.target - me.here) / speed
    first = 0.0
    for number in range(op.first_free, op.last_free):
        first = max(first, off_the_road(m.frees[number].at - me.here, speed))
    last = last_leave(needed)
    for number in range(op.first_need, op.last_need):
        last = min(last, (m.needs[number].at - me.here) / speed)
    now = tick_of(m) * TIME_STEP
    for number in range(m.absences.shape[1]):
        absence = m.absences[robot, number]
        work = work_until_away(absence.begin, absence.end, now, first, last)
        if work < needed:
            me.repair = absence.end - now - work
            return work
    return inf


@inner
def fail(m, robot):
    """Begin a repair where the robot stands."""
    op = m.ops[m.robots[robot].op]
    if op.picks or op.is_seen:
        hear_failed(m, robot)
    see_standing(m, robot)
    may_be_emptied(m, robot)
    begin_repair(m, robot)
    await_repair(m, robot)


@inner
def begin_repair(m, robot):
    """Begin a part of the repair. Each part is a step that is done."""
    me = m.robots[robot]
    part = first_part(me.repair)
    me.repair -= part
    me.done += 1
    me.state = c.REPAIRED
    me.part_ends = tick_of(m) + whole_ticks(part)


@inner
def await_repair(m, robot):
    """Stand until the part of the repair ends, or the bay goes on with the robot's bin."""
    me = m.robots[robot]
    m.timers[c.WAKE, robot] = min(c.QUARTERS * me.part_ends, me.emptied_next)


@inner
def is_repaired(m, robot):
    """Whether the robot is repaired. If not, it stands on."""
    me = m.robots[robot]
    if me.emptied_next <= m.desk[0].now:
        go_on_emptying(m, robot)
    is_part_over = me.part_ends <= tick_of(m)
    if is_part_over and me.repair > 0.0:
        begin_repair(m, robot)
    elif is_part_over:
        end_repair(m, robot)
        return True
    await_repair(m, robot)
    return False


@inner
def end_repair(m, robot):
    """Be repaired. The bay begins anew with a bin that it has not emptied."""
    begin_anew(m, robot)
    op = m.ops[m.robots[robot].op]
    if op.picks or op.is_seen:
        hear_repaired(m, robot)
