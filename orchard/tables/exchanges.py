"""What a run's events and messages tell of the exchange of bins: the calls for carriers, and the exchanges at the ends of rows."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP

Row = Mapping[str, Any]  # of the tables events and messages
CALLING = ("call", "fetch")  # messages of a bin that has no carrier yet


class CallRow(msgspec.Struct):
    """A row of the table calls."""

    bin: str
    picker: str | None
    row: int
    end: str
    called: int
    asked: int = 0
    carrier: str | None = None
    sent: int | None = None
    agreed: int | None = None
    fetched: int | None = None


class ExchangeRow(msgspec.Struct):
    """A row of the table exchanges."""

    row: int
    picker: str
    full_bin: str
    full: int
    empty_bin: str | None = None
    carrier: str | None = None
    left: int | None = None
    brought: int | None = None
    supplied: int | None = None
    fetched: int | None = None
    unloaded: int | None = None
    waited_seconds: float | None = None


def calls(events: Iterable[Row], messages: Iterable[Row]) -> list[CallRow]:
    """Return the calls of all bins, in the order of their first messages. A call ends when a carrier couples the bin."""
    made: list[CallRow] = []
    open_: dict[str, CallRow] = {}
    coupled = [event for event in events if event["what"] == "coupled" and kind_of(event["who"]) == "carrier"]
    for said in sorted([*messages, *coupled], key=lambda row: row["tick"]):
        if "what" in said:
            if call := open_.pop(said["whom"], None):
                call.carrier, call.fetched = said["who"], said["tick"]
        elif said["type"] in CALLING:
            _calls(said, made, open_)
        elif said["type"] == "come" and (call := open_.get(said["sender"])) and call.carrier != said["recipient"]:
            call.carrier, call.sent, call.agreed = said["recipient"], said["tick"], None
        elif said["type"] == "yes" and (call := open_.get(said["recipient"])) and call.carrier == said["sender"]:
            call.agreed = said["tick"] if call.agreed is None else call.agreed
    return made


def _calls(said: Row, made: list[CallRow], open_: dict[str, CallRow]) -> None:
    """A bin asks for a carrier, for the first time or again; many carriers may hear it at once."""
    content, name = msgspec.json.decode(said["content"]), said["sender"]
    if name not in open_:
        open_[name] = CallRow(name, content.get("picker"), content["lane"], content["side"], said["tick"])
        made.append(open_[name])
    open_[name].asked += 1


def exchanges(events: Iterable[Row]) -> list[ExchangeRow]:
    """Return the exchanges of bins, in the order in which the rows were picked."""
    made: list[ExchangeRow] = []
    waiting: dict[str, ExchangeRow] = {}  # picker -> its exchange until it has an empty bin
    filled: dict[str, ExchangeRow] = {}  # full bin -> its exchange until it is unloaded
    brought: dict[str, tuple[str, int]] = {}  # empty bin -> the carrier that left it, and when
    for event in events:
        what, who, whom, tick = event["what"], event["who"], event["whom"], event["tick"]
        if what == "row picked" and whom is not None:
            made.append(ExchangeRow(int(event["detail"].removeprefix("row ")), who, whom, tick))
            waiting[who] = filled[whom] = made[-1]
        elif what == "uncoupled" and kind_of(who) == "picker" and (one := filled.get(whom)):
            one.left = tick
        elif what == "uncoupled" and kind_of(who) == "carrier":
            brought[whom] = who, tick
        elif what == "coupled" and (one := waiting.get(who)) and whom != one.full_bin:
            one.empty_bin, one.supplied, one.waited_seconds = whom, tick, (tick - one.full) * TIME_STEP
            one.carrier, one.brought = brought.get(whom, (None, None))
            del waiting[who]
        elif what == "coupled" and kind_of(who) == "carrier" and (one := filled.get(whom)):
            one.fetched = tick
        elif what == "unloaded" and who in filled:
            filled.pop(who).unloaded = tick
    return made
