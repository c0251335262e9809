"""The episodes of a batch, compiled: each goes on from decision to decision.

`orchard.gym.dispatch.DispatchEnv` does the same in Python, and asks a policy beside it.

Arguments: `b` is the batch, with the arrays of `batch.columns.ARRAYS`; `i` the number of a harvest
in it; `m` the model of that harvest. A decision sends carriers to bins one by one, an action each.
"""

from orchard.event_model import codes as c
from orchard.event_model import columns
from orchard.event_model.batch import columns as bc
from orchard.event_model.batch.compiled import inner, outer
from orchard.event_model.batch.draws import draw_first, draw_more
from orchard.event_model.kernel.drives import FAR
from orchard.event_model.kernel.entry import SIGNATURE as OF_MACHINE
from orchard.event_model.results import JAM, LONGEST, LOOK_AT
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.addresses import caller_by_address
from orchard.sim.kernels.arrays import ADDRESSES, ArrayRecord
from orchard.sim.kernels.jit import INTEGER

BATCH = ArrayRecord(bc.ARRAYS)
SIGNATURE = (ADDRESSES, INTEGER, INTEGER)

_opens_batch = BATCH.opens
_opens = ArrayRecord(columns.ARRAYS).opens
_run = caller_by_address(OF_MACHINE)


@outer
def step(batch, machine, first):
    """Let all harvests from the first one on do what they are to do, and go on to the next
    decision.

    `machine`: the address of the compiled machine. Return the first harvest that has no room for
    its draws, from which to call again; their number if all are done.
    """
    b = _opens_batch(batch)
    for i in range(first, len(b.episodes)):
        m = _opens(b.addresses[i])
        command = b.commands[i]
        b.commands[i] = bc.NOTHING
        if command == bc.BEGIN:
            begin(b, m, i)
        elif command == bc.ACT:
            act(b, m, i)
        if not carry_on(b, m, i, machine):
            return i
        note_what_happened(b, m, i)
        observe(b, m, i)
    return len(b.episodes)


# -- the start, and actions


@inner
def begin(b, m, i):
    """Begin an episode."""
    state = b.states[i]
    for at in range(len(state)):
        state[at] = b.initial[at]
    draw_first(b, i)
    for robot in range(len(m.robots)):
        clear = FAR
        if b.rules[0].has_people:
            # The draws of each robot stand behind those of the robot before.
            clear = b.encounters[i, robot * b.episodes[i].encounters].metres
        m.robots[robot].clear = clear
        b.chosen[i, robot] = c.NONE
    episode = b.episodes[i]
    episode.until = 0
    episode.done = 0
    episode.moved = 0.0
    episode.home_until = 0
    episode.home_done = -1
    episode.is_midway = False
    episode.is_finished = False
    episode.stage = bc.GOING_ON


@inner
def act(b, m, i):
    """Do an action: note an order, or take the decision.

    An action that cannot be sends no carrier.
    """
    if b.episodes[i].stage != bc.DECIDING:
        return
    action = b.actions[i]
    # Action 0 sends no further carrier.
    if action > 0 and b.masks[i, action]:
        place = (action - 1) // len(b.carriers)
        carrier = b.carriers[(action - 1) % len(b.carriers)]
        for picker in range(len(m.robots)):
            call = m.calls[picker]
            if call.is_asked and b.bin_places[call.bin] == place:
                call.is_asked = False
                b.chosen[i, picker] = carrier
        m.robots[carrier].is_told = False
        # Another carrier may be sent at the same decision.
        if is_open(m):
            return
    decide(b, m, i)
    b.episodes[i].stage = bc.GOING_ON
    b.episodes[i].until = m.desk[0].now // c.QUARTERS


@inner
def decide(b, m, i):
    """Make the decision at which the machine has stopped."""
    for picker in range(len(m.robots)):
        call = m.calls[picker]
        call.is_asked = b.chosen[i, picker] != c.NONE
        if call.is_asked:
            call.carrier = b.chosen[i, picker]
            b.chosen[i, picker] = c.NONE
    m.desk[0].state = c.DECIDED


@inner
def is_open(m):
    """Whether a carrier can be sent to a bin: some bin waits for it, and some carrier can leave."""
    waits = False
    can_leave = False
    for robot in range(len(m.robots)):
        waits |= m.calls[robot].is_asked
        can_leave |= m.robots[robot].is_told and m.robots[robot].is_ready
    return waits and can_leave


# -- on to the next decision


@inner
def carry_on(b, m, i, machine):
    """Carry a harvest on until something is to be decided, or its episode is over.

    Return False if there is no room for its draws.
    """
    episode = b.episodes[i]
    while episode.stage == bc.GOING_ON:
        if not look(b, m, i, machine):
            return False
    while episode.stage == bc.DRIVING_HOME:
        if not drive_home(b, m, i, machine):
            return False
    return True


@inner
def look(b, m, i, machine):
    """Carry a harvest on for a while, or up to a decision, and look whether robots move on."""
    episode = b.episodes[i]
    longest = b.rules[0].longest
    until = min(longest, episode.until + LOOK_AT)
    reason = advance(b, m, i, until, machine)
    if reason == c.LACKS_DRAWS:
        return False
    episode.until = until
    tick = float(until)
    if reason == c.ASKS_POLICY:
        tick = m.desk[0].now / c.QUARTERS
    goes_on = has_moved(m, episode, tick)
    if reason == c.ASKS_POLICY:
        if goes_on and is_open(m):
            episode.stage = bc.DECIDING
            return True
        decide(b, m, i)
    elif reason == c.ENDED or until == longest:
        goes_on = False
    if not goes_on:
        end(b, m, i)
    return True


@inner
def has_moved(m, episode, tick):
    """Note whether a robot has moved on by a tick. Return False if none has for long."""
    done = steps_done(m)
    if done > episode.done or drives(m):
        episode.done = done
        episode.moved = tick
        return True
    return tick - episode.moved <= JAM


@inner
def end(b, m, i):
    """End an episode. If all bins are unloaded, the last robots drive home."""
    episode = b.episodes[i]
    episode.stage = bc.OVER
    if is_finished(b, m):
        episode.stage = bc.DRIVING_HOME


@inner
def drive_home(b, m, i, machine):
    """Let the last robots drive home for a while, as `EventHarvest.run` does."""
    episode = b.episodes[i]
    longest = LONGEST * b.rules[0].bins
    if not episode.is_midway:
        done = steps_done(m)
        goes_on = done > episode.home_done or drives(m)
        if episode.home_until >= longest or not goes_on:
            episode.stage = bc.OVER
            return True
        episode.home_done = done
        episode.home_until = min(longest, episode.home_until + JAM)
    reason = advance(b, m, i, episode.home_until, machine)
    episode.is_midway = reason == c.LACKS_DRAWS
    if reason == c.ENDED:
        episode.stage = bc.OVER
    return not episode.is_midway


@inner
def advance(b, m, i, until, machine):
    """Carry a harvest on to a tick, exclusive. Return why it stopped: see `codes.PAUSED`."""
    reason = _run(machine, b.addresses[i], c.QUARTERS * until)
    while reason == c.LACKS_DRAWS and draw_more(b, m, i):
        reason = _run(machine, b.addresses[i], c.QUARTERS * until)
    return reason


# -- how a harvest is: as `EventHarvest` tells it


@inner
def steps_done(m):
    """Return the steps that all robots have done."""
    done = 0
    for robot in range(len(m.robots)):
        done += m.robots[robot].done
    return done


@inner
def drives(m):
    """Whether a robot is on its way, charges, is at the load-out, or waits in the bay."""
    now = m.desk[0].now
    for robot in range(len(m.robots)):
        me = m.robots[robot]
        if me.is_charging or me.state in (c.DRIVING, c.LASTING):
            return True
        if c.QUARTERS * me.back >= now:
            return True
    for trailer in range(len(m.trailers)):
        if c.QUARTERS * m.trailers[trailer].back >= now:
            return True
    return False


@inner
def is_finished(b, m):
    """Whether all bins were unloaded, and no battery is flat."""
    for robot in range(len(m.robots)):
        if m.robots[robot].charge <= 0.0:
            return False
    return m.desk[0].deliveries == b.rules[0].bins


@inner
def last_tick(m):
    """Return the tick at which the last robot stood, or was back."""
    last = 0
    for robot in range(len(m.robots)):
        me = m.robots[robot]
        last = max(last, min(me.stood, me.parked), me.back)
    for trailer in range(len(m.trailers)):
        last = max(last, m.trailers[trailer].back)
    return last


@inner
def waited_ticks(m):
    """Return the ticks for which all pickers together have had no bin to fill so far."""
    now = m.desk[0].now / c.QUARTERS
    ticks = 0.0
    for number in range(m.desk[0].exchanges):
        ticks += m.exchanges[number].without
    for robot in range(len(m.robots)):
        since = m.robots[robot].full_since
        if since != c.NONE:
            ticks += max(0.0, now - since)
    return ticks


# -- what is told


@inner
def note_what_happened(b, m, i):
    """Note what happened in this step, and so far."""
    episode = b.episodes[i]
    episode.is_finished = is_finished(b, m)
    seconds = m.desk[0].now / c.QUARTERS * TIME_STEP
    if episode.is_finished:
        seconds = last_tick(m) * TIME_STEP
    waited = waited_ticks(m) * TIME_STEP
    delivered = m.desk[0].deliveries
    b.happened[i, bc.SECONDS] = seconds - episode.seconds
    b.happened[i, bc.WAITED] = waited - episode.waited
    b.happened[i, bc.DELIVERED] = delivered - episode.delivered
    episode.seconds = seconds
    episode.waited = waited
    episode.delivered = delivered


@inner
def observe(b, m, i):
    """Tell what there is to decide about, and which actions can be: as `gym.Dispatching`."""
    b.seconds_seen[i, 0] = (m.desk[0].now // c.QUARTERS) * TIME_STEP
    bins = b.bins_seen[i]
    carriers = b.carriers_seen[i]
    mask = b.masks[i]
    bins[:] = 0.0
    carriers[:] = 0.0
    mask[:] = 0
    mask[0] = 1
    if b.episodes[i].stage != bc.DECIDING:
        return
    for place in range(len(b.carriers)):
        me = m.robots[b.carriers[place]]
        if me.is_told:
            carriers[place, bc.CAN_LEAVE] = me.is_ready
            carriers[place, bc.TO_HEAD] = me.metres_to_head
    tick = m.desk[0].now // c.QUARTERS
    for picker in range(len(m.robots)):
        call = m.calls[picker]
        if call.is_asked:
            place = b.bin_places[call.bin]
            lane_end = m.ends[call.end]
            bins[place, bc.IS_WAITING] = 1.0
            # Lanes have two ends.
            bins[place, bc.ROW] = call.end // 2 + 1
            bins[place, bc.SINCE_CALL] = (tick - call.since) * TIME_STEP
            bins[place, bc.UNTIL_FULL] = call.seconds
            bins[place, bc.TO_REACH] = lane_end.seconds
            bins[place, bc.METRES] = lane_end.metres
            note_actions(mask, carriers, place)


@inner
def note_actions(mask, carriers, place):
    """Note which carriers can be sent to a bin."""
    for carrier in range(len(carriers)):
        if carriers[carrier, bc.CAN_LEAVE] > 0.0:
            mask[1 + place * len(carriers) + carrier] = 1
