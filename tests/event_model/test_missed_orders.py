"""A bin that falls silent misses its order: when is its carrier free again, in both models?"""

import numpy as np
import pytest
from quiet import NOBODY

from orchard.behaviour.bin import CALL_AGAIN
from orchard.behaviour.dispatcher import Dispatcher
from orchard.contract.agent import Heard, Mail, Observation, Reply
from orchard.contract.messages import CarrierQuery, CarrierStatus, Fetch
from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import reports
from orchard.event_model.plain import as_python
from orchard.field.geometry import STILL
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario

# Of the bin that misses its order, from its first report on: it would hear at the second tick that
# a carrier comes, and is silent by then.
TOLD = CALL_AGAIN + 1
# Tick up to which a carrier is sent to the other bin in each case.
LONGEST = 120


def one_carrier() -> Layout:
    return lay_out(Scenario(**NOBODY, rows=4, pickers=2, carriers=1, dispatch="predictive"))


def ordered_by_dispatcher(silent_from: int, second: int) -> int:
    """Return the tick at which the dispatcher sends the carrier to the second bin.

    The first bin reports from tick 0 on, and is silent from a tick on; the second one reports from
    tick `second` on.
    """
    dispatcher = Dispatcher(one_carrier(), "dispatch")
    memory = dispatcher.Memory()
    asked = -1
    for tick in range(LONGEST):
        mail = Mail()
        # What a bin sends at a tick is heard in the next one.
        sent = tick - 1
        if sent < silent_from and sent % CALL_AGAIN == 0:
            mail.requests.append(report_of(1, sent))
        if sent >= second and (sent - second) % CALL_AGAIN == 0:
            mail.requests.append(report_of(2, sent))
        if asked == tick - 2:
            status = CarrierStatus(job="", is_next=True, metres=0.0)
            mail.replies.append(Reply("carrier_01", 0, CarrierQuery(), status))
        dispatcher.tick(nothing_seen(tick), mail, memory)
        asked = memory.asked
        if "bin_02" in memory.bookings:
            return tick
    raise AssertionError("the carrier is sent to no other bin")


def report_of(number: int, tick: int) -> Heard:
    """Return the report of a bin that is full in the lane of its number."""
    fetch = Fetch(number, "east", f"picker_0{number}", 0, 0.0)
    return Heard(f"bin_0{number}", tick, 0, fetch)


def nothing_seen(tick: int) -> Observation:
    """Return what an agent without a body observes."""
    return Observation("dispatch", tick, np.nan, np.nan, (0.0, 1.0), STILL, np.zeros(0))


def ordered_by_machine(silent_from: int, second: int) -> int:
    """Return the tick at which the event model sends the carrier to the second bin."""
    harvest = EventHarvest(one_carrier())
    model = harvest.model
    carrier, first_picker, second_picker = range(3)
    model.timers[c.WAKE] = c.NEVER
    model.robots[carrier].x = model.desk[0].head
    for picker, tick in ((first_picker, 0), (second_picker, second)):
        as_python(reports.begin_call)(model, picker, model.robots[picker].bin, 0)
        as_python(reports.begin_reports)(model, picker, tick)
    as_python(reports.fall_silent)(model, first_picker, silent_from)
    for tick in range(LONGEST):
        harvest.advance(tick + 1)
        if model.calls[second_picker].is_booked:
            return tick
    raise AssertionError("the carrier is sent to no other bin")


@pytest.mark.parametrize("second", range(TOLD - 15, TOLD + 15))
def test_a_carrier_whose_bin_was_told_is_free_again(second: int) -> None:
    """The bin was told of it, but did not hear that: the dispatcher drops the order later."""
    ordered = ordered_by_machine(TOLD, second)
    assert ordered == ordered_by_dispatcher(TOLD, second)


@pytest.mark.parametrize("second", range(45, 75))
def test_a_carrier_whose_bin_was_not_told_is_free_again(second: int) -> None:
    """The dispatcher forgets the bin, because it no longer reports, and then its order."""
    ordered = ordered_by_machine(CALL_AGAIN, second)
    assert ordered == ordered_by_dispatcher(CALL_AGAIN, second)
