"""The full bins that wait for a carrier.

Fleet control must know them, and VDA 5050 has no message for that.
"""

from collections.abc import Callable, Sequence
from typing import Any

from orchard import Heard
from orchard.contract.messages import Call, Come, Fetch

Request = Call | Fetch | Come
# Ticks for which a request counts. A bin repeats its requests, so by then it has asked again,
# unless a carrier has it.
REMEMBERED: dict[type[Request], int] = {Call: 25, Fetch: 25, Come: 55}


class Calls:
    """Which full bins wait, by what a bridge hears from them.

    A bin asks for a carrier (Call, Fetch). Once a carrier is chosen, the bin sends for it (Come).
    A bin counts as waiting from its second request on: by then each carrier that has an agent of
    its own, and no orders, could have agreed to come.
    """

    def __init__(self, tell: Callable[[list[dict[str, Any]]], None]) -> None:
        """`tell`: is called with the list of the bins that wait, whenever it has changed."""
        self._tell = tell
        self._newest_list: list[dict[str, Any]] = []
        # Bin -> tick at which it asked first.
        self._asked_first: dict[str, int] = {}
        # Bin -> tick of its newest request, and the request.
        self._newest: dict[str, tuple[int, Request]] = {}
        # The newest tick at which a vehicle has called `hear`; -1: none has.
        self._tick = -1
        # Vehicle -> the full bin that it has promised to take along, having left its empty one
        # for it; '' for none.
        self._promised: dict[str, str] = {}

    def hear(self, requests: Sequence[Heard], tick: int) -> None:
        """Note what full bins request. Each vehicle calls this at each tick."""
        # Nothing is new, and another vehicle's call at this tick has forgotten old requests.
        if not requests and tick == self._tick:
            return
        self._tick = tick
        for heard in requests:
            self._hear_request(heard.sender, heard.body, tick)
        self._forget(tick)
        waiting = self._waiting()
        if waiting != self._newest_list:
            self._newest_list = waiting
            self._tell(waiting)

    def _hear_request(self, bin_name: str, body: object, tick: int) -> None:
        """Note a request of a bin. A bin that is not full yet does not wait."""
        if isinstance(body, Come):
            self._newest[bin_name] = tick, body
            self._asked_first.pop(bin_name, None)
        elif isinstance(body, Call) or (isinstance(body, Fetch) and body.seconds_to_full == 0):
            self._newest[bin_name] = tick, body
            self._asked_first.setdefault(bin_name, tick)

    def _forget(self, tick: int) -> None:
        """Forget the bins that have asked for nothing for some time."""
        for name, (heard_at, body) in list(self._newest.items()):
            if tick - heard_at > REMEMBERED[type(body)]:
                del self._newest[name]
                self._asked_first.pop(name, None)

    def _waiting(self) -> list[dict[str, Any]]:
        """Return the bins that wait, in the order in which they began to call.

        Each has its name `loadId`, its `station`, and the tick `since` which it calls.
        """
        waiting = []
        for name, (heard_at, body) in self._newest.items():
            # After `Come` a carrier is on its way.
            if not isinstance(body, Come) and heard_at > self._asked_first[name]:
                waiting.append({"loadId": name, "station": _station(body), "since": body.since})
        return sorted(waiting, key=_since_and_name)

    def bin_at(self, station: str) -> str:
        """Return the bin that calls from a station, or has sent for a vehicle; '' if none does."""
        for name, (_, body) in self._newest.items():
            if _station(body) == station:
                return name
        return ""

    def picker_of(self, bin_name: str) -> str:
        """Return the picker that waits for an empty bin beside a full one; '' if none does.

        The full bin must have sent for a vehicle.
        """
        _, body = self._newest.get(bin_name, (0, None))
        if not isinstance(body, Come) or bin_name in self._promised.values():
            return ""
        return body.picker

    def promise(self, vehicle: str, bin_name: str) -> None:
        """Note the full bin that a vehicle has promised to take along; '' for none."""
        self._promised[vehicle] = bin_name


def _station(body: Request) -> str:
    return f"{body.side}/{body.lane}"


def _since_and_name(waiting: dict[str, Any]) -> tuple[int, str]:
    return waiting["since"], waiting["loadId"]
