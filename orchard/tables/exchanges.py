"""The exchange of bins, by events and messages: calls for carriers, exchanges at the ends of rows."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP
from orchard.tables.columns import CALLS, EXCHANGES

Row = Mapping[str, Any]  # of the tables events and messages
NewRow = dict[str, Any]  # of the tables calls and exchanges
CALLING = ("call", "fetch")  # messages of a bin that has no carrier yet


def calls(events: Iterable[Row], messages: Iterable[Row]) -> list[NewRow]:
    """Return the calls of all bins, by their first messages. A call ends when a carrier couples the bin."""
    made: list[NewRow] = []
    open_: dict[str, NewRow] = {}
    coupled = [
        event
        for event in events
        if event["what"] == "coupled" and kind_of(event["who"]) == "carrier"
    ]
    for said in sorted([*messages, *coupled], key=lambda row: row["tick"]):
        if "what" in said:
            if call := open_.pop(said["whom"], None):
                call |= {"carrier": said["who"], "fetched": said["tick"]}
        elif said["type"] in CALLING:
            _calls(said, made, open_)
        elif (
            said["type"] == "come"
            and (call := open_.get(said["sender"]))
            and call["carrier"] != said["recipient"]
        ):
            call |= {"carrier": said["recipient"], "sent": said["tick"], "agreed": None}
        elif (
            said["type"] == "yes"
            and (call := open_.get(said["recipient"]))
            and call["carrier"] == said["sender"]
        ):
            call["agreed"] = said["tick"] if call["agreed"] is None else call["agreed"]
    return made


def _calls(said: Row, made: list[NewRow], open_: dict[str, NewRow]) -> None:
    content, name = msgspec.json.decode(said["content"]), said["sender"]
    if name not in open_:
        known = {
            "bin": name,
            "picker": content.get("picker"),
            "row": content["lane"],
            "end": content["side"],
            "called": said["tick"],
        }
        open_[name] = dict.fromkeys(CALLS.names) | known | {"asked": 0}
        made.append(open_[name])
    open_[name]["asked"] += 1


def exchanges(events: Iterable[Row]) -> list[NewRow]:
    """Return the exchanges of bins, in the order in which the bins were full."""
    made: list[NewRow] = []
    waiting: dict[str, NewRow] = {}  # picker -> its exchange until it has an empty bin
    filled: dict[str, NewRow] = {}  # full bin -> its exchange until it is unloaded
    brought: dict[str, NewRow] = {}  # empty bin -> the carrier that left it, and when
    for event in events:
        what, who, whom, tick = event["what"], event["who"], event["whom"], event["tick"]
        if what == "bin full" and whom is not None:
            row, metres = event["detail"].removeprefix("row ").removesuffix(" m").split(", ")
            known = {
                "row": int(row),
                "metres": float(metres),
                "picker": whom,
                "full_bin": who,
                "full": tick,
            }
            made.append(dict.fromkeys(EXCHANGES.names) | known)
            waiting[whom] = filled[who] = made[-1]
        elif what == "uncoupled" and kind_of(who) == "picker" and (one := filled.get(whom)):
            one["left"] = tick
        elif what == "uncoupled" and kind_of(who) == "carrier":
            brought[whom] = {"carrier": who, "brought": tick}
        elif what == "coupled" and (one := waiting.get(who)) and whom != one["full_bin"]:
            one |= {
                "empty_bin": whom,
                "supplied": tick,
                "waited_seconds": (tick - one["full"]) * TIME_STEP,
            }
            one |= brought.get(whom, {})
            del waiting[who]
        elif what == "coupled" and kind_of(who) == "carrier" and (one := filled.get(whom)):
            one["fetched"] = tick
        elif what == "unloaded" and who in filled:
            filled.pop(who)["unloaded"] = tick
    return made
