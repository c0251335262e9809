"""Failures: on a drive a robot may fail, and is repaired where it stands.

`orchard.plans.failures` says how a failure splits the drive. Python fills the draws.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import set_alarm, whole_ticks
from orchard.event_model.kernel.reports import hear_failed, hear_repaired, see_standing
from orchard.plans import failures

first_part = inner(failures.first_part)
stop_of = inner(failures.stop_of)
work_left = inner(failures.work_left)


@inner
def may_fail(m, robot, speed):
    """Decide, before a robot drives at a speed, whether it fails on the way, and where."""
    me = m.robots[robot]
    op = m.ops[me.op]
    draw = m.failures[robot, me.failures]
    distance = op.target - me.here
    needed = distance / speed
    work = work_left(op.mean_between * draw.until, me.worked)
    if work >= needed:
        me.worked += needed
        return
    me.failures += 1
    me.worked = 0.0
    me.fails = True
    me.stop = stop_of(me.here, distance, work, needed)
    me.repair = op.mean_repair * draw.repair
    if me.failures == m.failures.shape[1]:
        m.desk[0].lacks_draws = True


@inner
def fail(m, robot):
    """Begin a repair where the robot stands."""
    if m.ops[m.robots[robot].op].picks:
        hear_failed(m, robot)
    see_standing(m, robot)
    await_repair(m, robot)


@inner
def await_repair(m, robot):
    """Stand for a part of the repair. Each part is a step that is done."""
    me = m.robots[robot]
    part = first_part(me.repair)
    me.repair -= part
    me.done += 1
    me.state = c.REPAIRED
    set_alarm(m, robot, whole_ticks(part))


@inner
def is_repaired(m, robot):
    """Whether the robot is repaired. If not, it stands for the next part."""
    if m.robots[robot].repair > 0.0:
        await_repair(m, robot)
        return False
    if m.ops[m.robots[robot].op].picks:
        hear_repaired(m, robot)
    return True
