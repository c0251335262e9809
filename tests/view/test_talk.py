"""What is said in the orchard, as lines that a person reads."""

from orchard.contract.events import Event
from orchard.view.talk import gathered, level_of, line_of


def test_events_read_like_sentences() -> None:
    assert line_of(Event(0, "call", "bin_01", "carrier_02", "lane 3 east")) == "bin_01 > carrier_02: call, lane 3 east"
    assert line_of(Event(0, "row picked", "picker_01", "", "row picked: 3")) == "picker_01: row picked: 3"
    assert (level_of("claim"), level_of("call"), level_of("collision")) == ("DEBUG", "INFO", "WARN")


def test_what_is_asked_of_many_and_answered_by_many_is_one_line_each() -> None:
    carriers = [f"carrier_{i:02d}" for i in range(1, 6)]
    calls = [Event(0, "Call", "bin_01", carrier, "who is free? row 1") for carrier in carriers]
    offers = [Event(0, "Offer", carrier, "bin_01", f"I am, {10 * i} m away") for i, carrier in enumerate(carriers)]
    come, full = Event(0, "Come", "bin_01", "carrier_02", "come, row 1"), Event(0, "bin full", "bin_02", "picker_02", "row 2")
    assert [line_of(event) for event in gathered([full, *calls, *offers, come])] == [
        "bin_02 > picker_02: bin full, row 2",
        "bin_01 > 5 carriers: Call, who is free? row 1",
        "5 carriers > bin_01: Offer",
        "bin_01 > carrier_02: come, row 1",
    ]
    (two,) = gathered(offers[1:3])
    assert line_of(two) == "carrier_02, carrier_03 > bin_01: Offer, I am, 10 m away; I am, 20 m away"


def test_questions_of_safety_do_not_crowd_out_the_harvest() -> None:
    assert {level_of(what) for what in ("Where", "Position", "State", "BinState", "Places")} == {"DEBUG"}
    assert {level_of(what) for what in ("Call", "Offer", "Come", "Here", "row picked", "unloaded")} == {"INFO"}
    assert (level_of("stopped"), level_of("nothing recorded"), level_of("lost")) == ("WARN", "WARN", "ERROR")
