"""The tables of calls and of exchanges, made of events and messages.

A call of a bin ends when a carrier fetches it. An exchange is that of a full bin for an empty one.
Rows have the ticks at which their steps happened; what did not happen is None.
"""

from orchard.tables.exchanges import calls, exchanges


def message(tick, sender, recipient, type_, content="{}"):
    """Return a row of the table of messages."""
    return {
        "tick": tick,
        "sender": sender,
        "recipient": recipient,
        "type": type_,
        "content": content,
    }


def test_a_carrier_that_does_not_come_is_followed_by_the_next():
    """carrier_01 says yes and does not come, so bin_01 sends for carrier_02.

    The row has the carrier that fetched the bin. At the third message, carrier_01 is on its way.
    """
    called = '{"type":"call","lane":2,"side":"west","since":3}'
    said = [
        message(3, "bin_01", "carrier_01", "call", called),
        message(23, "bin_01", "carrier_01", "call", called),
        message(25, "bin_01", "carrier_01", "come"),
        message(26, "carrier_01", "bin_01", "yes"),
        message(75, "bin_01", "carrier_02", "come"),
        message(76, "carrier_02", "bin_01", "yes"),
        message(86, "carrier_02", "bin_01", "yes"),
    ]
    coupled = {"tick": 90, "what": "coupled", "who": "carrier_02", "whom": "bin_01", "detail": None}
    (call,) = calls([coupled], said)
    told = {"bin": "bin_01", "row": 2, "end": "west", "called": 3, "asked": 2}
    found = {"carrier": "carrier_02", "sent": 75, "agreed": 76, "fetched": 90}
    assert {name: value for name, value in call.items() if value is not None} == told | found
    (under_way,) = calls([], said[:3])
    chosen = {"carrier": "carrier_01", "sent": 25}
    assert {name: value for name, value in under_way.items() if value is not None} == told | chosen


def test_a_picker_that_couples_its_full_bin_has_no_empty_one():
    """It couples its own full bin anew, at tick 100. Only another bin is the empty one."""

    def event(tick, what, who, whom, detail=None):
        return {"tick": tick, "what": what, "who": who, "whom": whom, "detail": detail}

    full = event(90, "bin full", "bin_01", "picker_01", "row 2, 70.00 m")
    anew = event(100, "coupled", "picker_01", "bin_01")
    empty = event(120, "coupled", "picker_01", "bin_02")
    (exchange,) = exchanges([full, anew, empty])
    assert exchange["empty_bin"] == "bin_02"
    assert exchange["supplied"] == 120


def test_tables_from_the_middle_have_no_false_rows():
    """The events before are missing, in which the bins were full and left."""
    coupled = {"tick": 90, "what": "coupled", "who": "picker_02", "whom": "bin_01", "detail": None}
    assert exchanges([coupled, {**coupled, "what": "unloaded", "who": "bin_09"}]) == []
