"""What a bin tells the dispatcher of an early policy, and when: it reports while it is filled.

It reports each CALL_AGAIN ticks. It is silent where its picker stands before what it does not pick,
and from the end of the row until it is left, as `orchard.plans.forecast.Forecast.of` has it. Then
it reports at once, or CALL_AGAIN ticks after its last report, and goes on in that rhythm.

A carrier that the policy sends is named in the answer to the bin's next report. If the bin falls
silent before it hears that, it does not send for the carrier. If it is silent for FORGET_TICKS, the
dispatcher forgets the bin and the order.
"""

from math import floor

from orchard.behaviour.bin import CALL_AGAIN
from orchard.behaviour.dispatcher import BOOKED_TICKS, FORGET_TICKS
from orchard.event_model import codes as c
from orchard.event_model.kernel.compiled import inner
from orchard.event_model.kernel.places import tick_of
from orchard.field.scenario import TIME_STEP
from orchard.plans.forecast import ALONG
from orchard.plans.robot import ASK

# Ticks from a report, by way of its answer, to the order that follows it.
HEARD = ASK
# Ticks from an order to the carrier.
ORDERED = 1
# Ticks from a report to the dispatcher, which takes it for new then.
REPORTED = 1
# Ticks from where a picker begins to pick until its bin knows how fast it does.
MEASURED = 2
# Ticks of rounding.
NEAR = 1e-6


@inner
def is_early(m):
    """Whether bins report before they are full."""
    policy = m.desk[0].policy
    is_predictive = policy == c.PREDICTIVE or policy == c.PREDICTIVE_FARTHEST
    is_python_early = policy == c.IN_PYTHON_EARLY or policy == c.IN_PYTHON_WHEN_DUE
    return is_predictive or is_python_early


@inner
def see_row(m, picker):
    """Let a picker's bin see that the picker begins a row, or to drive into it."""
    me = m.robots[picker]
    op = m.ops[me.op]
    drive = m.passes[op.arg]
    tick = tick_of(m)
    m.bins[me.bin].is_left = False
    if not is_early(m):
        return
    seen = tick
    if op.tells_on_drive and me.leg_ended != tick:
        seen = tick + 1
    full = tick + ticks_to_fill(m, op, drive, speed_seen(m, op))
    call = m.calls[picker]
    if call.bin != me.bin:
        begin_call(m, picker, me.bin, drive.end)
    call.full = full
    call.expected = tick + ticks_to_fill(m, op, drive, speed_before(m, op))
    call.measured = tick + MEASURED
    call.stood_until = c.NONE
    if not call.is_reported:
        begin_reports(m, picker, max(seen, first_report(m, full)))


@inner
def first_report(m, full):
    """Return the tick at which a bin begins to report: it is full in less than the horizon then.

    `full`: the tick at which it is full, perhaps between two.
    """
    return floor(full - m.desk[0].horizon / TIME_STEP + NEAR) + 1


@inner
def begin_call(m, picker, name, end):
    """Know a picker's next bin, of which no other robot knows yet.

    `name`: the bin. `end`: the lane's end at which it is left.
    """
    call = m.calls[picker]
    call.bin = name
    call.end = end
    call.is_reported = False
    call.is_open = False
    call.is_booked = False
    call.failed = c.NONE
    call.is_served = False
    call.silent_since = c.NEVER


@inner
def speed_seen(m, op):
    """Return the speed at which a bin takes its picker to pick, m/s.

    It sees that only where its picker picks.
    """
    if op.metres > 0.0:
        return speed_before(m, op)
    return m.speeds[op.arg]


@inner
def speed_before(m, op):
    """Return the speed that a bin takes for true before its picker picks, m/s.

    It is the speed at which it was filled last, or the mean speed if it is empty.
    """
    if m.passes[op.arg].fills_on:
        return m.speeds[op.arg - 1]
    return m.desk[0].mean_speed


@inner
def ticks_to_fill(m, op, drive, speed):
    """Return the ticks from an op at which a picker begins a row until its bin is full.

    `speed`: at which the row is picked, m/s.
    """
    return (drive.metres / speed + op.seconds) / TIME_STEP


@inner
def hear_failed(m, picker):
    """Let a picker's bin see that the picker stands: for now it fills no more, drives no nearer to
    the row's end, and does not begin to report.
    """
    call = m.calls[picker]
    if call.bin != m.robots[picker].bin or call.failed != c.NONE:
        return
    call.failed = tick_of(m)
    call.full += ticks_cut_off(m, picker)
    if not call.is_reported and call.since > call.failed:
        m.timers[c.REPORT, picker] = c.NEVER


@inner
def ticks_cut_off(m, picker):
    """Return by which part of a tick the last step was shorter of a picker that has just stopped
    in its row.
    """
    me = m.robots[picker]
    has_just_driven = me.leg_ended == tick_of(m) and me.leg_begun < me.leg_ended
    if not has_just_driven or me.leg_begun < m.calls[picker].measured - MEASURED:
        return 0.0
    return me.leg_ended - me.leg_begun - (me.here - me.leg_from) / me.leg_stride


@inner
def hear_repaired(m, picker):
    """Let a picker's bin see that the picker goes on: it will be full, and there, later."""
    call = m.calls[picker]
    if call.failed == c.NONE:
        return
    tick = tick_of(m)
    stood = tick - call.failed
    call.full += stood
    if not call.is_reported and call.since > call.failed:
        call.since = max(tick, first_report(m, call.full))
        if not is_silent(m, picker):
            begin_reports(m, picker, call.since)
    call.stood_since = call.failed
    call.stood_until = tick
    call.failed = c.NONE


# -- when it reports


@inner
def begin_reports(m, picker, tick):
    """Let a bin report for the first time at a tick."""
    call = m.calls[picker]
    call.since = tick
    call.reports_from = tick
    m.timers[c.REPORT, picker] = c.QUARTERS * tick


@inner
def is_silent(m, picker):
    """Whether a picker's bin, which the picker fills, does not report now."""
    return m.calls[picker].silent_since != c.NEVER


@inner
def see_leg(m, picker, limit):
    """Let a picker's bin see that the picker drives up to a limit, and perhaps out of its row."""
    me = m.robots[picker]
    call = m.calls[picker]
    if not is_early(m) or call.bin != me.bin:
        return
    tells_to = m.ops[me.op].tells_to + ALONG
    if me.here > tells_to:
        return
    tick = tick_of(m)
    if is_silent(m, picker):
        report_again(m, picker, tick + 1)
    if limit > tells_to:
        fall_silent(m, picker, tick + 1 + floor((tells_to - me.here) / me.leg_stride))


@inner
def see_standing(m, picker):
    """Let a picker's bin see that the picker stands, if that keeps it from reporting."""
    if m.ops[m.robots[picker].op].tells_on_drive and is_early(m):
        fall_silent(m, picker, tick_of(m) + 1)


@inner
def fall_silent(m, picker, tick):
    """Let a bin report no longer from a tick on."""
    call = m.calls[picker]
    if call.bin != m.robots[picker].bin or is_silent(m, picker):
        return
    call.silent_since = tick
    if not call.is_reported and m.timers[c.REPORT, picker] >= c.QUARTERS * tick:
        m.timers[c.REPORT, picker] = c.NEVER
    if call.is_booked:
        ordered = m.timers[c.ORDER, picker] // c.QUARTERS
        plan_order(m, picker, ordered - ORDERED - HEARD)


@inner
def report_again(m, picker, tick):
    """Let a bin that has been silent report at a tick, or later if it has just done so."""
    call = m.calls[picker]
    if not is_silent(m, picker):
        return
    if not call.is_reported:
        call.silent_since = c.NEVER
        begin_reports(m, picker, max(tick, call.since))
        return
    forgotten = forgotten_at(m, picker, tick)
    call.reports_from = max(tick, last_report(m, picker, tick) + CALL_AGAIN)
    call.silent_since = c.NEVER
    if call.reports_from >= forgotten:
        call.is_open = False
    if call.is_booked:
        plan_order(m, picker, call.reports_from)
    elif not call.is_served:
        m.timers[c.REPORT, picker] = c.QUARTERS * call.reports_from


@inner
def last_report(m, picker, tick):
    """Return the tick of a bin's last report up to a tick."""
    call = m.calls[picker]
    latest = min(tick, call.silent_since - 1)
    return call.reports_from + CALL_AGAIN * ((latest - call.reports_from) // CALL_AGAIN)


@inner
def forgotten_at(m, picker, tick):
    """Return the tick at which the dispatcher forgets a bin, if that reports no more after a
    tick.
    """
    return last_report(m, picker, tick - REPORTED) + REPORTED + FORGET_TICKS


@inner
def plan_order(m, picker, report):
    """Let a booked carrier be sent once the bin hears the answer to a report at a tick.

    If it does not hear that, the carrier is free again once the dispatcher drops the order.
    """
    call = m.calls[picker]
    call.is_missed = report + HEARD >= call.silent_since
    # In a tick the dispatcher decides before orders happen. So that it finds an order dropped, that
    # happens in the tick before.
    if not call.is_missed:
        sent = report + HEARD + ORDERED
    elif report < call.silent_since:
        # The dispatcher takes it for told, and waits for a new report.
        call.is_booked = False
        call.is_open = False
        sent = report + REPORTED + BOOKED_TICKS - 1
    else:
        sent = forgotten_at(m, picker, c.NEVER) - 1
    m.timers[c.ORDER, picker] = c.QUARTERS * max(tick_of(m), sent)


@inner
def drop_order(m, picker):
    """Let the dispatcher drop an order that the bin has not heard, and forget the bin."""
    call = m.calls[picker]
    m.robots[call.carrier].is_booked = False
    call.is_booked = False
    call.is_missed = False


# -- what the dispatcher knows of it


@inner
def seconds_to_full(m, picker, tick):
    """Return the seconds until a bin is full, as the dispatcher knows them; 0 once it is.

    It has the bin's last report, and takes that for new when it hears it.
    """
    reported = last_report(m, picker, tick - REPORTED)
    left = max(0.0, ticks_left(m, picker, reported))
    return max(0.0, (left - (tick - REPORTED - reported)) * TIME_STEP)


@inner
def ticks_left(m, picker, tick):
    """Return the ticks until a bin is full, as it knew them at a tick."""
    call = m.calls[picker]
    if tick < call.measured:
        return call.expected - tick
    if call.failed != c.NONE:
        return call.full - min(tick, call.failed)
    if tick >= call.stood_until:
        return call.full - tick
    # The picker has picked on since then, so `full` is later by the time for which it stood. At
    # this tick the bin did not know of that time.
    before = call.full - (call.stood_until - call.stood_since)
    return before - min(tick, call.stood_since)
