"""Which carrier fetches which bin: calls that ask all carriers, or the dispatcher and its policy.

A bin is known here by its picker: `m.calls[picker]` is the call of the bin that a picker fills or
has left. A carrier is "booked" from the decision that sends it until it hears that. Letters take
time: the constants below add up the ticks. `ranks` has the rules of the policies.
"""

from math import floor

from orchard.behaviour.bin import CALL_AGAIN
from orchard.behaviour.carrier import AT_HEAD, CHOOSING, MOVING_UP, REMEMBERED
from orchard.behaviour.dispatcher import BOOKED_TICKS, POLL_TICKS
from orchard.event_model import codes as c
from orchard.event_model.kernel.batteries import use_battery
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.motion import is_moving, x_now
from orchard.event_model.kernel.places import tick_of
from orchard.event_model.kernel.ranks import first_bin, is_due, nearest_carrier, remember
from orchard.event_model.kernel.reports import (
    HEARD,
    ORDERED,
    REPORTED,
    begin_call,
    drop_order,
    forgotten_at,
    is_early,
    is_silent,
    last_report,
    plan_order,
    report_again,
    seconds_to_full,
)
from orchard.plans.robot import ASK

# Ticks from a call or a question until carriers hear it.
BY_CARRIERS = 1
# Ticks from a call that carriers hear until the chosen one hears that: the bin hears their offers
# after one tick, and sends for it at once.
SENT_FOR = 1 + BY_CARRIERS
# Ticks from an order that a carrier refuses until carriers hear the bin's next call: the bin hears
# the refusal after one tick, and calls again at once.
REFUSED = 1 + BY_CARRIERS


@inner
def can_leave(m, robot):
    """Whether a free carrier is at its line's head, or drives up to it."""
    behind = m.desk[0].head - x_now(m, robot)
    return behind < AT_HEAD or (is_moving(m, robot) and behind < MOVING_UP)


@inner
def is_home(m, robot):
    """Whether a carrier has no job, and was back from the load-out before this tick."""
    return m.robots[robot].is_free and tick_of(m) > m.robots[robot].back


@inner
def job_of(m, carrier, picker):
    """Return the op at which a carrier's job for a picker's call begins; NONE: it is not
    translated.
    """
    return m.jobs[m.robots[carrier].queue_line, m.calls[picker].end]


@inner
def start_job(m, carrier, picker):
    """Let a carrier leave the queue for a picker's bin."""
    me = m.robots[carrier]
    me.is_free = False
    me.customer = picker
    me.job_bin = m.calls[picker].bin
    me.knows_left = False
    me.next_op = job_of(m, carrier, picker)
    use_battery(m, carrier, 0.0)
    me.charge_before = me.charge
    me.away = c.NEVER
    me.parked = c.NEVER
    # It waits in its line or drives up, and hears the order there.
    drives = me.state == c.DRIVING or me.state == c.STANDING
    if me.state == c.IDLE or (drives and m.ops[me.op].is_queueing):
        m.timers[c.WAKE, carrier] = m.desk[0].now


# -- bins


@inner
def call_carriers(m, picker, end):
    """Let a bin call that its picker has just left full."""
    me = m.robots[picker]
    tick = tick_of(m)
    call = m.calls[picker]
    if is_early(m):
        report_again(m, picker, tick)
        return
    begin_call(m, picker, me.left_bin, end)
    call.since = tick
    call.reports_from = tick
    call.full = tick
    call.measured = c.NONE
    call.stood_until = c.NONE
    if m.desk[0].policy == c.BY_CALLS:
        m.timers[c.CALL_HEARD, picker] = c.QUARTERS * (tick + BY_CARRIERS)
    else:
        open_call(m, picker)


# -- calls that ask all carriers


@inner
def asks_ways(m):
    """Whether Python must first tell how far the free carriers are from the bins that call.

    If so, note where these carriers are.
    """
    desk = m.desk[0]
    if not desk.asks_ways or desk.knows_ways:
        return False
    for carrier in range(len(m.robots)):
        if m.robots[carrier].is_free:
            m.robots[carrier].x_at_call = x_now(m, carrier)
    return True


@inner
def hear_calls(m):
    """Let all carriers hear the calls of the last tick, and let each bin choose one that offers to
    come.
    """
    tick = m.desk[0].now // c.QUARTERS
    m.desk[0].knows_ways = False
    for picker in range(len(m.robots)):
        if is_calling(m, picker):
            call = m.calls[picker]
            call.carrier = c.NONE
            m.bins[call.bin].since = call.since
            m.bins[call.bin].called = tick
    for carrier in range(len(m.robots)):
        if is_home(m, carrier) and can_leave(m, carrier):
            offer(m, carrier, tick)
    for picker in range(len(m.robots)):
        if is_calling(m, picker):
            choose(m, picker)


@inner
def is_calling(m, picker):
    """Whether carriers hear the call of a picker's bin now."""
    return m.timers[c.CALL_HEARD, picker] == m.desk[0].now


@inner
def choose(m, picker):
    """Let a bin send for the carrier that it has chosen, or call again.

    Carriers have heard its call just now: they would hear its next one CALL_AGAIN ticks later.
    """
    now = m.desk[0].now
    if m.calls[picker].carrier == c.NONE:
        m.timers[c.CALL_HEARD, picker] = now + c.QUARTERS * CALL_AGAIN
    else:
        m.timers[c.CALL_HEARD, picker] = c.NEVER
        m.timers[c.COME, picker] = now + c.QUARTERS * SENT_FOR


@inner
def offer(m, carrier, tick):
    """Let a carrier offer itself to the bin that has called for longest, if that bin calls now."""
    first = first_call(m, carrier, tick)
    if first == c.NONE or m.bins[first].called != tick:
        return
    m.offers[carrier, first] = min(m.offers[carrier, first], tick)
    for picker in range(len(m.robots)):
        if m.calls[picker].bin == first and is_calling(m, picker):
            hear_offer(m, picker, carrier)


@inner
def first_call(m, carrier, tick):
    """Return the bin that a carrier fetches first of those that it has heard; NONE: none calls."""
    first = c.NONE
    for name in range(len(m.bins)):
        if tick - m.bins[name].called > REMEMBERED:
            continue
        if first == c.NONE or is_offered_first(m, carrier, name, first, tick):
            first = name
    return first


@inner
def hear_offer(m, picker, carrier):
    """Let a picker's bin hear that a carrier offers to come. It chooses the nearest one."""
    call = m.calls[picker]
    if call.carrier == c.NONE or is_nearer(m, carrier, call.carrier, call.end):
        call.carrier = carrier


@inner
def is_offered_first(m, carrier, name, other, tick):
    """Whether a carrier offers itself to one bin before another: as
    `orchard.behaviour.carrier.first_call`.
    """
    is_late = tick - m.offers[carrier, name] > CHOOSING
    is_other_late = tick - m.offers[carrier, other] > CHOOSING
    if is_late != is_other_late:
        return is_other_late
    return m.bins[name].since < m.bins[other].since


@inner
def is_nearer(m, carrier, other, end):
    """Whether one carrier in the queue is nearer to a lane's end than another, to a millimetre."""
    return millimetres_to(m, carrier, end) < millimetres_to(m, other, end)


@inner
def millimetres_to(m, carrier, end):
    """Return how far a carrier in the queue is from a lane's end by road, in whole millimetres."""
    if m.desk[0].asks_ways:
        return whole_millimetres(m.distances[carrier, end])
    way = m.ways[m.robots[carrier].queue_line, end]
    return whole_millimetres(way + m.desk[0].head - x_now(m, carrier))


@inner
def millimetres_to_head(m, carrier):
    """Return how far a carrier is from the head of its line, in whole millimetres."""
    return whole_millimetres(max(0.0, m.desk[0].head - x_now(m, carrier)))


@inner
def whole_millimetres(metres):
    """Return a way of so many m, 0 or more, in whole millimetres."""
    return floor(1000.0 * metres + 0.5)


@inner
def come(m, picker):
    """Let a carrier hear that a bin has chosen it. If it is busy by now, the bin calls again."""
    carrier = m.calls[picker].carrier
    if not is_home(m, carrier):
        m.timers[c.CALL_HEARD, picker] = m.desk[0].now + c.QUARTERS * REFUSED
        return
    # As in `orchard.behaviour.carrier.Carrier.accept`.
    for name in range(len(m.bins)):
        m.offers[carrier, name] = c.NEVER
    start_job(m, carrier, picker)


# -- the dispatcher


@inner
def open_call(m, picker):
    """Let a bin report to the dispatcher."""
    call = m.calls[picker]
    call.is_reported = True
    if not call.is_open:
        call.is_open = True
        call.known_since = tick_of(m)
    wake_dispatcher(m)


@inner
def wake_dispatcher(m):
    """Let the dispatcher ask the carriers, if it rests and bins wait."""
    desk = m.desk[0]
    if desk.state != c.RESTING:
        return
    next_poll = max(tick_of(m), desk.asked + POLL_TICKS)
    earliest = c.NEVER
    for picker in range(len(m.robots)):
        call = m.calls[picker]
        if call.is_open and not call.is_booked and not is_forgotten(m, picker, next_poll):
            earliest = min(earliest, call.known_since)
    if earliest == c.NEVER:
        return
    desk.asked = max(next_poll, earliest + REPORTED)
    desk.state = c.ABOUT_TO_ASK
    m.timers[c.DISPATCH, 0] = c.QUARTERS * (desk.asked + BY_CARRIERS)


@inner
def dispatch(m):
    """Go on with a decision: note what carriers answer, or let the policy decide a tick later.

    Before a policy in Python decides the machine stops (`asks_python`). Python notes the orders,
    and sets the state DECIDED; then they are carried out here.
    """
    desk = m.desk[0]
    if desk.state == c.DECIDED:
        carry_out(m)
        desk.state = c.RESTING
        wake_dispatcher(m)
        return
    if desk.state == c.ABOUT_TO_ASK:
        for carrier in range(len(m.robots)):
            me = m.robots[carrier]
            # Whether it is booked counts at the decision, a tick later.
            me.is_ready = is_home(m, carrier) and can_leave(m, carrier)
            if me.is_ready:
                # What it answers now counts at the decision.
                me.millimetres_to_head = millimetres_to_head(m, carrier)
            # Of all robots only carriers have a line in the queue. Pickers are not asked: to know
            # where one is, its way would have to be added up tick by tick.
            is_carrier = me.queue_line != c.NONE
            if is_carrier and is_in_python(m):
                note_answer_in_full(m, carrier)
        desk.state = c.ABOUT_TO_DECIDE
        m.timers[c.DISPATCH, 0] = c.QUARTERS * (desk.asked + ASK)
        return
    decide(m)
    desk.state = c.RESTING
    wake_dispatcher(m)


@inner
def decide(m):
    """Send the free carriers to the bins that are due, the first by the policy's rank first."""
    tick = tick_of(m)
    for picker in range(len(m.robots)):
        call = m.calls[picker]
        call.is_asked = is_known_to_policy(m, picker, tick)
        if call.is_asked and is_early(m):
            remember(m, picker, tick)
            call.is_asked = is_due(m, picker, tick)
    while True:
        picker = first_bin(m)
        carrier = nearest_carrier(m)
        if picker == c.NONE or carrier == c.NONE:
            return
        order(m, carrier, picker, tick)


@inner
def is_known_to_policy(m, picker, tick):
    """Whether a bin waits at the dispatcher, and no carrier comes for it."""
    call = m.calls[picker]
    waits = call.is_open and not call.is_booked and call.known_since < tick
    return waits and not is_forgotten(m, picker, tick)


@inner
def is_forgotten(m, picker, tick):
    """Whether the dispatcher has forgotten a bin by a tick, because it has been silent."""
    return is_silent(m, picker) and forgotten_at(m, picker, tick) <= tick


# -- a policy in Python


@inner
def is_in_python(m):
    """Whether Python asks the policy."""
    return m.desk[0].policy >= c.IN_PYTHON


@inner
def note_answer_in_full(m, carrier):
    """Note what a carrier answers to a policy in Python.

    A carrier that was sent is left out as long as it is booked: until BOOKED_TICKS after the
    dispatcher heard the report of its bin, and answered it. One that was not sent yet is told if it
    is not booked at the decision.
    """
    me = m.robots[carrier]
    decides = m.desk[0].asked + ASK
    last_that_is_over = decides - BOOKED_TICKS - REPORTED
    has_no_job = is_home(m, carrier)
    me.is_told = has_no_job or me.bin_reported <= last_that_is_over
    me.told_job = c.NONE if has_no_job else me.job_bin
    me.metres_to_head = max(0.0, m.desk[0].head - x_now(m, carrier))


@inner
def asks_python(m):
    """Whether a policy in Python is to decide now. Then note what it is told of bins, and of which
    carriers.
    """
    if not is_in_python(m) or m.desk[0].state != c.ABOUT_TO_DECIDE:
        return False
    tick = tick_of(m)
    if m.desk[0].policy == c.IN_PYTHON_WHEN_DUE and not can_order(m, tick):
        return False
    for picker in range(len(m.robots)):
        call = m.calls[picker]
        call.is_asked = is_known_to_policy(m, picker, tick)
        if call.is_asked:
            call.seconds = seconds_to_full(m, picker, tick)
    for carrier in range(len(m.robots)):
        if m.robots[carrier].is_booked:
            m.robots[carrier].is_told = False
    return True


@inner
def can_order(m, tick):
    """Whether a carrier can leave for a bin that is due. If so, note when bins are full."""
    if nearest_carrier(m) == c.NONE:
        return False
    is_any_due = False
    for picker in range(len(m.robots)):
        if is_known_to_policy(m, picker, tick):
            remember(m, picker, tick)
            if is_due(m, picker, tick):
                is_any_due = True
    return is_any_due


@inner
def carry_out(m):
    """Book the carriers that a policy in Python has sent."""
    tick = tick_of(m)
    for picker in range(len(m.robots)):
        if m.calls[picker].is_asked:
            order(m, m.calls[picker].carrier, picker, tick)


# -- orders


@inner
def order(m, carrier, picker, tick):
    """Book a carrier for a bin.

    The bin hears it when it reports next, and sends for the carrier.
    """
    call = m.calls[picker]
    call.is_asked = False
    call.is_booked = True
    call.carrier = carrier
    m.robots[carrier].is_ready = False
    m.robots[carrier].is_booked = True
    plan_order(m, picker, last_report(m, picker, tick - 1) + CALL_AGAIN)


@inner
def send(m, picker):
    """Let a carrier hear the order, if the bin has heard of it."""
    call = m.calls[picker]
    if call.is_missed:
        drop_order(m, picker)
        return
    call.is_served = True
    me = m.robots[call.carrier]
    me.is_booked = False
    # It has perhaps answered the dispatcher in this tick, which leaves it out.
    me.is_ready = False
    me.is_told = False
    # The report, whose answer named this carrier, was sent so long before the order is heard.
    me.bin_reported = tick_of(m) - ORDERED - HEARD
    call.is_open = False
    call.is_booked = False
    start_job(m, call.carrier, picker)
