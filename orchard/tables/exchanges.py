"""The tables `calls` and `exchanges`, computed from the tables `events` and `messages` of a run.

A call: a bin asks for a carrier, sends for one, and the carrier agrees and fetches it. An exchange:
a picker leaves a full bin and gets an empty one. `orchard.tables.columns` describes the columns.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP
from orchard.tables.columns import CALLS, EXCHANGES

# A row of the tables events and messages.
Row = Mapping[str, Any]
# A row of the tables calls and exchanges.
NewRow = dict[str, Any]
# Messages of a bin that has no carrier yet.
CALLING = ("call", "fetch")


def calls(events: Iterable[Row], messages: Iterable[Row]) -> list[NewRow]:
    """Return the calls of all bins, in the order of their first messages.

    A call ends when a carrier couples the bin.
    """
    coupled = [event for event in events if event["what"] == "coupled"]
    book = _CallBook()
    for row in sorted([*messages, *coupled], key=lambda row: row["tick"]):
        # Only events have this column.
        if "what" in row:
            book.take_coupling(row)
        else:
            book.take_message(row)
    return book.calls


class _CallBook:
    """The calls of all bins, while messages and events are read in their order."""

    def __init__(self) -> None:
        self.calls: list[NewRow] = []
        # Bin -> its call that has not ended.
        self._open: dict[str, NewRow] = {}

    def take_coupling(self, event: Row) -> None:
        """End the call of a bin that a carrier couples."""
        call = self._open.get(event["whom"])
        if call is not None and kind_of(event["who"]) == "carrier":
            call["carrier"] = event["who"]
            call["fetched"] = event["tick"]
            del self._open[event["whom"]]

    def take_message(self, message: Row) -> None:
        """Take a bin's question, its order, or a carrier's agreement."""
        if message["type"] in CALLING:
            self._take_call(message)
        elif message["type"] == "come":
            self._take_order(message)
        elif message["type"] == "yes":
            self._take_agreement(message)

    def _take_call(self, message: Row) -> None:
        """Begin a call, or count one question more."""
        name = message["sender"]
        if name not in self._open:
            content = msgspec.json.decode(message["content"])
            call = dict.fromkeys(CALLS.names)
            call |= {
                "bin": name,
                "picker": content.get("picker"),
                "row": content["lane"],
                "end": content["side"],
                "called": message["tick"],
                "asked": 0,
            }
            self._open[name] = call
            self.calls.append(call)
        self._open[name]["asked"] += 1

    def _take_order(self, message: Row) -> None:
        """Note for which carrier a bin sends. The bin repeats that: the first message counts."""
        call = self._open.get(message["sender"])
        if call is not None and call["carrier"] != message["recipient"]:
            call["carrier"] = message["recipient"]
            call["sent"] = message["tick"]
            call["agreed"] = None

    def _take_agreement(self, message: Row) -> None:
        """Note when the carrier agreed. It repeats that: the first message counts."""
        call = self._open.get(message["recipient"])
        if call is not None and call["carrier"] == message["sender"] and call["agreed"] is None:
            call["agreed"] = message["tick"]


def exchanges(events: Iterable[Row]) -> list[NewRow]:
    """Return the exchanges of bins, in the order in which the bins were full."""
    book = _ExchangeBook()
    for event in events:
        book.take(event)
    return book.exchanges


class _ExchangeBook:
    """The exchanges of bins, while events are read in their order."""

    def __init__(self) -> None:
        self.exchanges: list[NewRow] = []
        # Picker -> its exchange until it has an empty bin.
        self._waiting: dict[str, NewRow] = {}
        # Full bin -> its exchange until it is unloaded.
        self._filled: dict[str, NewRow] = {}
        # Empty bin -> the columns `carrier` and `brought`: which carrier left it, and at which
        # tick.
        self._brought: dict[str, NewRow] = {}

    def take(self, event: Row) -> None:
        """Take an event. Events of other things change nothing."""
        who = event["who"]
        match event["what"]:
            case "bin full" if event["whom"] is not None:
                self._begin(event)
            case "uncoupled" if kind_of(who) == "carrier":
                self._brought[event["whom"]] = {"carrier": who, "brought": event["tick"]}
            case "uncoupled" if kind_of(who) == "picker":
                self._note(event["whom"], "left", event["tick"])
            case "coupled" if who in self._waiting:
                self._supply(event)
            case "coupled" if kind_of(who) == "carrier":
                self._note(event["whom"], "fetched", event["tick"])
            case "unloaded":
                self._note(who, "unloaded", event["tick"])
                self._filled.pop(who, None)

    def _begin(self, event: Row) -> None:
        """Begin the exchange of a bin that a picker has filled."""
        # As the event says it: "row 3, 17.5 m".
        row, metres = event["detail"].removeprefix("row ").removesuffix(" m").split(", ")
        exchange: NewRow = dict.fromkeys(EXCHANGES.names)
        exchange |= {
            "row": int(row),
            "metres": float(metres),
            "picker": event["whom"],
            "full_bin": event["who"],
            "full": event["tick"],
        }
        self.exchanges.append(exchange)
        self._waiting[event["whom"]] = exchange
        self._filled[event["who"]] = exchange

    def _supply(self, event: Row) -> None:
        """Note the empty bin that a picker couples.

        A picker may lose its full bin and couple it anew: that ends no exchange.
        """
        exchange = self._waiting[event["who"]]
        bin_ = event["whom"]
        if bin_ == exchange["full_bin"]:
            return
        exchange["empty_bin"] = bin_
        exchange["supplied"] = event["tick"]
        exchange["waited_seconds"] = (event["tick"] - exchange["full"]) * TIME_STEP
        exchange |= self._brought.get(bin_, {})
        del self._waiting[event["who"]]

    def _note(self, full_bin: str, column: str, tick: int) -> None:
        """Note a tick in the exchange of a full bin, if there is one."""
        if full_bin in self._filled:
            self._filled[full_bin][column] = tick
