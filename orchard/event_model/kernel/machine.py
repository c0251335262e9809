"""The machine: it carries a harvest on from event to event.

Each robot follows a plan: ops, one after the other. An op that takes time sets the robot's state
and its alarm, or what else wakes it. All that a robot does lies between two alarms; so the state is
complete at any time, and can be copied.

    state               | begins with            | wakes it            | then it
    --------------------+------------------------+---------------------+----------------------------
    idle                | the end of its plan    | an order            | takes its new plan
    driving             | drive                  | the leg's end, a    | drives the next leg, or
                        |                        | grant, an order     | stands
    standing            | a gate whose places it | a grant, that robot | drives on
                        | lacks, a bin that is   | drives on, alarm    |
                        | not left, a robot      | each 20 or when an  |
                        | ahead                  | answer of the bin   |
                        |                        | comes, an order     |
    swinging its bin    | turn, with a bin       | alarm               | tells the one behind
    swinging off        | turn, beside its line  | alarm               | leaves its line
    lasting             | pause, unload, turn    | alarm               | does the next op
    waiting for places  | need                   | a grant             | does the next op
    waiting for partner | alone in               | alarm, every 5      | does the next op, if it is
    leaving a bin       | leave bin              | alarm               | lets the bin call
    dropping a bin      | deliver                | alarm               | tells the picker
    handing over        | after that             | alarm, every 5      | goes on, if it is taken
    waiting for a bin   | fetch empty            | a carrier's letter  | couples
    coupling            | after that             | alarm               | takes the lane's place
    taking a place      | after that             | a grant             | does the next op
    taking a bin        | take bin               | alarm               | does the next op
    meeting             | somebody on its way    | alarm               | drives on
    looking around      | turn, with people, or  | alarm               | turns
                        | beside a carrier       |                     |
    repaired            | a drive on which it    | alarm, each 300 s   | drives on to the drive's
                        | fails                  |                     | end, or to a next failure
    waiting for charge  | charged                | its battery is full | is free for the next call
    flat                | its battery is flat    | it is full again,   | goes on
                        |                        | in a charging line  |

A carrier's job in ops, as plans/route.py and plans/carrier_ways.py make it: `pause` (it asks the
bin whether that still wants it), drives and turns to the lane, before whose place it waits until
the picker has left its bin; `deliver`, at the end of which it has handed the empty bin over; `need`
and the loop to the full bin, on whose first drive it gives the lane's place back; `take bin`,
drives to the bay, `unload` and `pause` (until it knows), perhaps `haul` and `may charge`; drives to
its line, `home`, and a drive to the line's head that the next order ends. From `may charge` another
plan may go on: drives to a charging line, `charge`, `charged` and `home`.

Events of one time happen by their kind, and of one kind by the robots' names; but of robots that
wake on one line the last one acts first. `codes` lists the
kinds in that order. A robot wakes in whole ticks; traffic hears claims half a tick later, and
robots hear its answers a quarter after the next tick.
"""

from orchard.event_model import codes as c
from orchard.event_model.kernel.batteries import (
    ask_for_charger,
    await_charge,
    end_charging,
    haul,
    is_flat,
    may_charge,
    park,
)
from orchard.event_model.kernel.bay import go_on_unloading, unload
from orchard.event_model.kernel.calls import (
    asks_python,
    asks_ways,
    come,
    dispatch,
    hear_calls,
    job_of,
    open_call,
    send,
)
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.drives import (
    depart,
    drive_on,
    end_leg,
    go_on_alone,
    go_on_charged,
    go_on_repaired,
    stop_flat,
)
from orchard.event_model.kernel.handling import (
    ask_for_lone_place,
    await_bin,
    await_partner_gone,
    await_taken,
    come_home,
    couple,
    hand_over,
    handle,
    hear_of_bin,
    leave_bin,
    note_full,
    seize,
    take_bin,
    take_place,
)
from orchard.event_model.kernel.motion import set_alarm
from orchard.event_model.kernel.places import free_places, hear_claims, hear_grant, tick_of
from orchard.event_model.kernel.reports import see_row
from orchard.event_model.kernel.roads import last_to_wake
from orchard.event_model.kernel.turns import swing, swung, turn

# Notes in the log, at most, of what a robot begins in one tick.
MOST_NOTES = 64


@inner
def run(m, until):
    """Carry a harvest on to a time, exclusive, and return why it stopped: see `codes.PAUSED`."""
    while True:
        kind, robot = next_event(m)
        time = m.timers[kind, robot]
        if time == c.NEVER:
            return c.ENDED
        if time >= until:
            return c.PAUSED
        m.desk[0].now = time
        lack = what_lacks(m, kind, robot)
        if lack != c.NONE:
            return lack
        happen(m, kind, robot)


@inner
def what_lacks(m, kind, robot):
    """Return what Python must do before an event can happen, as a reason to stop; NONE: nothing."""
    if (kind == c.COME or kind == c.ORDER) and lacks_job(m, robot):
        return c.LACKS_JOB
    if m.desk[0].lacks_draws:
        return c.LACKS_DRAWS
    if kind == c.DISPATCH and asks_python(m):
        return c.ASKS_POLICY
    if kind == c.CALL_HEARD and asks_ways(m):
        return c.ASKS_WAYS
    if len(m.log) > 0 and m.desk[0].logged + MOST_NOTES > len(m.log):
        return c.LOG_IS_FULL
    return c.NONE


@inner
def next_event(m):
    """Return the kind and the robot of the next event."""
    soonest = c.NEVER
    first = 0
    for kind in range(c.EVENTS):
        # The compiler makes a few instructions of a loop that does nothing but this.
        soonest_of_kind = c.NEVER
        for robot in range(m.timers.shape[1]):
            soonest_of_kind = min(soonest_of_kind, m.timers[kind, robot])
        if soonest_of_kind < soonest:
            soonest = soonest_of_kind
            first = kind
    for robot in range(m.timers.shape[1]):
        if m.timers[first, robot] == soonest:
            return first, robot
    # Never reached, for a robot has the soonest time: the compiler wants a result.
    return 0, 0


@inner
def happen(m, kind, robot):
    """Let an event happen. Claims and calls of one time are heard together."""
    if kind == c.CLAIM:
        hear_claims(m)
        return
    if kind == c.CALL_HEARD:
        hear_calls(m)
        return
    if kind == c.WAKE:
        robot = last_to_wake(m, robot)
    m.timers[kind, robot] = c.NEVER
    if kind == c.WAKE:
        wake(m, robot)
    elif kind == c.GRANT:
        hear_grant(m, robot)
    elif kind == c.REPORT:
        open_call(m, robot)
    elif kind == c.COME:
        come(m, robot)
    elif kind == c.ORDER:
        send(m, robot)
    elif kind == c.DISPATCH:
        dispatch(m)
    elif kind == c.PARK:
        park(m, robot)
    elif kind == c.FULLY_CHARGED:
        end_charging(m, robot)
    else:
        hear_of_bin(m, robot)


@inner
def lacks_job(m, picker):
    """Whether the job that is about to be ordered is not translated yet."""
    carrier = m.calls[picker].carrier
    if job_of(m, carrier, picker) != c.NONE:
        return False
    m.desk[0].missing_line = m.robots[carrier].queue_line
    m.desk[0].missing_end = m.calls[picker].end
    return True


@inner
def wake(m, robot):
    """Let a robot go on with its op, and begin the ops after it, up to one that takes time."""
    me = m.robots[robot]
    me.follows = c.NONE
    me.hears_grants = False
    is_done = go_on(m, robot)
    while is_done:
        me.done += 1
        me.op += 1
        if me.next_op != c.NONE:
            me.op = me.next_op
            me.next_op = c.NONE
        is_done = begin(m, robot)
        note(m, robot)


@inner
def begin(m, robot):
    """Begin an op. Return whether it is done at once."""
    kind = m.ops[m.robots[robot].op].kind
    if kind == c.DRIVE:
        return depart(m, robot)
    if kind == c.TURN:
        return turn(m, robot)
    if kind == c.PAUSE:
        return pause(m, robot)
    if kind == c.NEED:
        return await_places(m, robot)
    if kind == c.ALONE_IN:
        return ask_for_lone_place(m, robot)
    if kind == c.UNLOAD:
        return unload(m, robot)
    if kind == c.CHARGED:
        return await_charge(m, robot)
    if c.DELIVER <= kind <= c.LEAVE_BIN:
        return begin_to_handle(m, robot, kind)
    if kind == c.END:
        m.robots[robot].state = c.IDLE
        return False
    do_at_once(m, robot, kind)
    return True


@inner
def pause(m, robot):
    """Stand for as long as the op says. Return that it is not done."""
    me = m.robots[robot]
    me.state = c.LASTING
    set_alarm(m, robot, m.ops[me.op].ticks + me.hears_later)
    me.hears_later = 0
    return False


@inner
def await_places(m, robot):
    """Stand until the op's places are granted. Return whether the robot has them already."""
    m.robots[robot].state = c.WAITING_FOR_PLACES
    return seize(m, robot, c.NONE)


@inner
def begin_to_handle(m, robot, kind):
    """Begin to couple or uncouple a bin, or to wait for one. Return that it is not done."""
    if kind == c.LEAVE_BIN:
        return handle(m, robot, c.LEAVING_BIN)
    if kind == c.DELIVER:
        return handle(m, robot, c.DROPPING_BIN)
    if kind == c.TAKE_BIN:
        return handle(m, robot, c.TAKING_BIN)
    return await_bin(m, robot)


@inner
def do_at_once(m, robot, kind):
    """Do an op that takes no time."""
    if kind == c.FREE:
        free_places(m, robot, m.ops[m.robots[robot].op].places)
    elif kind == c.HOME:
        come_home(m, robot)
    elif kind == c.HAUL:
        haul(m, robot)
    elif kind == c.MAY_CHARGE:
        may_charge(m, robot)
    elif kind == c.CHARGE:
        ask_for_charger(m, robot)
    elif kind == c.BEGIN_ROW:
        see_row(m, robot)
    else:
        note_full(m, robot)


@inner
def go_on(m, robot):
    """Go on with an op that took time. Return whether it is done."""
    state = m.robots[robot].state
    if state == c.DRIVING:
        end_leg(m, robot)
    if is_flat(m, robot):
        return get_flat(m, robot)
    if state == c.DRIVING or state == c.STANDING:
        return drive_on(m, robot)
    if c.LEAVING_BIN <= state <= c.TAKING_BIN:
        return go_on_handling(m, robot, state)
    if c.SWINGING_BIN <= state <= c.LASTING or state == c.LOOKING_AROUND:
        return go_on_turning(m, robot, state)
    if state == c.WAITING_FOR_PLACES:
        return seize(m, robot, c.NONE)
    if state == c.WAITING_FOR_PARTNER:
        return await_partner_gone(m, robot)
    return go_on_delayed(m, robot, state)


@inner
def get_flat(m, robot):
    """Stand with a flat battery. Return that the op is not done.

    The bay takes the bin of a carrier that cannot leave it.
    """
    me = m.robots[robot]
    is_in_bay = me.state == c.LASTING and m.ops[me.op].kind == c.UNLOAD
    if is_in_bay and not end_lasting(m, robot):
        return False
    return stop_flat(m, robot)


@inner
def go_on_handling(m, robot, state):
    """Go on to couple or uncouple a bin, or to hand it over. Return whether the op is done."""
    if state == c.LEAVING_BIN:
        return leave_bin(m, robot)
    if state == c.DROPPING_BIN:
        return hand_over(m, robot)
    if state == c.HANDING_OVER:
        return await_taken(m, robot)
    if state == c.WAITING_FOR_BIN:
        return await_bin(m, robot)
    if state == c.COUPLING:
        return couple(m, robot)
    if state == c.TAKING_PLACE:
        return take_place(m, robot)
    return take_bin(m, robot)


@inner
def go_on_turning(m, robot, state):
    """Go on with a turn, or with what else lasts for a time. Return whether the op is done."""
    if state == c.LASTING:
        return end_lasting(m, robot)
    if state == c.LOOKING_AROUND:
        return swing(m, robot)
    return swung(m, robot)


@inner
def go_on_delayed(m, robot, state):
    """Go on after a meeting, a repair or a charge, or with a new plan. Return whether the op is
    done.
    """
    if state == c.MEETING:
        return go_on_alone(m, robot)
    if state == c.REPAIRED:
        return go_on_repaired(m, robot)
    if state == c.WAITING_FOR_CHARGE:
        return await_charge(m, robot)
    if state == c.FLAT:
        return go_on_charged(m, robot)
    return True


@inner
def end_lasting(m, robot):
    """End an op that lasts for a time, if it is over. Return whether it is."""
    me = m.robots[robot]
    kind = m.ops[me.op].kind
    if kind == c.TURN:
        me.stood = tick_of(m)
        me.swings_since = c.NEVER
    elif kind == c.UNLOAD:
        return go_on_unloading(m, robot)
    return True


@inner
def note(m, robot):
    """Note in the log, if there is one, what a robot has begun."""
    if len(m.log) == 0:
        return
    me = m.robots[robot]
    entry = m.log[m.desk[0].logged]
    m.desk[0].logged += 1
    entry.tick = tick_of(m)
    entry.robot = robot
    entry.op = me.op
    entry.state = me.state
