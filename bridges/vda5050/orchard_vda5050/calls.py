"""The full bins that wait for a carrier: what fleet control must know, and VDA 5050 has no message
for.
"""

from collections.abc import Callable, Sequence
from typing import Any

from orchard import Heard
from orchard.contract.messages import Call, Come, Fetch

REMEMBERED = {
    Call: 25,
    Fetch: 25,
    Come: 55,
}  # ticks for which a request counts: by then the bin has asked again, unless a carrier has it


class Calls:
    """What a bridge hears from full bins.

    A bin that calls again waits: no carrier with an agent of its own came.
    """

    def __init__(self, tell: Callable[[list[dict[str, Any]]], None]) -> None:
        """`tell`: what is called with the list of those that wait, when it has changed."""
        self._tell = tell
        self._told: list[dict[str, Any]] = []
        self._first: dict[str, int] = {}  # bin -> tick at which it was heard first
        self._last: dict[
            str, tuple[int, Call | Fetch | Come]
        ] = {}  # bin -> tick at which it was heard last, its request
        self._heard_at = -1  # tick at which a vehicle was heard last
        self._owed: dict[
            str, str
        ] = {}  # vehicle -> the full bin for which it has left its empty one

    def hear(self, requests: Sequence[Heard], tick: int) -> None:
        """Note what full bins request. Each vehicle calls this at each tick."""
        if not requests and tick == self._heard_at:
            return
        self._heard_at = tick
        for bin_, body in ((heard.sender, heard.body) for heard in requests):
            if isinstance(body, Come):
                self._last[bin_] = tick, body
                self._first.pop(bin_, None)
            elif isinstance(body, Call) or (isinstance(body, Fetch) and not body.seconds_to_full):
                self._last[bin_] = tick, body
                self._first.setdefault(bin_, tick)
        waiting = self._waiting(tick)
        if waiting != self._told:
            self._told = waiting
            self._tell(waiting)

    def bin_at(self, station: str) -> str:
        """Return the bin that calls from a station, or has sent for a vehicle; '' if none does."""
        return next(
            (
                name
                for name, (_, body) in self._last.items()
                if f"{body.side}/{body.lane}" == station
            ),
            "",
        )

    def picker_of(self, bin_name: str) -> str:
        """Return the picker that waits for an empty bin where a full one stands which has sent for
        a vehicle; '' if none does.
        """
        _, body = self._last.get(bin_name, (0, None))
        return body.picker if isinstance(body, Come) and bin_name not in self._owed.values() else ""

    def promise(self, vehicle: str, bin_name: str) -> None:
        """Note the full bin that a vehicle has promised to take along; '' for none."""
        self._owed[vehicle] = bin_name

    def _waiting(self, tick: int) -> list[dict[str, Any]]:
        """Return the bins that wait, in the order in which they began to call: `loadId`, the
        `station`, `since` which tick.
        """
        for name in [
            name for name, (at, body) in self._last.items() if tick - at > REMEMBERED[type(body)]
        ]:
            del self._last[name]
            self._first.pop(name, None)
        again = {
            name: body
            for name, (at, body) in self._last.items()
            if not isinstance(body, Come) and at > self._first[name]
        }
        calls = sorted(again.items(), key=lambda item: (item[1].since, item[0]))
        return [
            {"loadId": name, "station": f"{call.side}/{call.lane}", "since": call.since}
            for name, call in calls
        ]
