"""The full bins that wait for a carrier: what fleet control must know, and VDA 5050 has no message for."""

from collections.abc import Callable
from typing import Any

from orchard import Mail
from orchard.contract.messages import Call

REMEMBERED = 25  # ticks for which a call counts: by then the bin has called again, unless a carrier comes


class Calls:
    """The calls that the vehicles of a bridge hear. A bin that calls again waits: no carrier with an agent of its own came."""

    def __init__(self, tell: Callable[[list[dict[str, Any]]], None]) -> None:
        """`tell`: what is called with the list of those that wait, when it has changed."""
        self._tell = tell
        self._told: list[dict[str, Any]] = []
        self._first: dict[str, int] = {}  # bin -> tick at which it was heard first
        self._last: dict[str, tuple[int, Call]] = {}  # bin -> tick at which it was heard last, its call

    def hear(self, mail: Mail, tick: int) -> None:
        """Note the calls in the mail of a vehicle."""
        for heard in mail.requests:
            if isinstance(heard.body, Call):
                self._first.setdefault(heard.sender, tick)
                self._last[heard.sender] = tick, heard.body
        waiting = self._waiting(tick)
        if waiting != self._told:
            self._told = waiting
            self._tell(waiting)

    def bin_at(self, station: str) -> str:
        """Return the bin that calls from a station; '' if none does."""
        return next((name for name, (_, call) in self._last.items() if f"{call.side}/{call.lane}" == station), "")

    def _waiting(self, tick: int) -> list[dict[str, Any]]:
        """Return the bins that wait, in the order in which they began to call: `loadId`, the `station`, `since` which tick."""
        for name in [name for name, (at, _) in self._last.items() if tick - at > REMEMBERED]:
            del self._last[name], self._first[name]
        again = {name: call for name, (at, call) in self._last.items() if at > self._first[name]}
        calls = sorted(again.items(), key=lambda item: (item[1].since, item[0]))
        return [{"loadId": name, "station": f"{call.side}/{call.lane}", "since": call.since} for name, call in calls]
