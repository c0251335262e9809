"""Claims of places at a moment: what robots have told traffic, and what it has granted.

The terms claim, wish and partner are those of orchard/behaviour/traffic.py.
"""

from orchard.behaviour.traffic import PendingClaim, ReservationTable
from orchard.contract.messages import Claim, Places
from orchard.event_model.begun.moment import RunMoment
from orchard.field.kinds import TRAFFIC


class Claims:
    """The claims and answers that are under way, and traffic's table."""

    def __init__(self, moment: RunMoment) -> None:
        self._moment = moment
        table: ReservationTable = moment.memories.get(TRAFFIC) or ReservationTable()
        self._reserved = table.reserved
        self._wishes = table.wishes

    def reserved(self, name: str) -> list[str]:
        """Return the places that traffic has reserved for a robot."""
        return self._reserved.get(name, [])

    def wish(self, name: str) -> PendingClaim | None:
        """Return the claim that traffic has not granted to a robot yet; None if there is none."""
        return self._wishes.get(name)

    def sent(self, name: str, age: int = 1) -> Claim | None:
        """Return the claim that a robot sent `age` ticks ago. One of age 1 is not heard yet."""
        for request in self._moment.requests(name, age):
            if isinstance(request, Claim):
                return request
        return None

    def newest(self, name: str) -> Claim | None:
        """Return the newest claim that a robot has sent in the last two ticks.

        An older one is in traffic's table.
        """
        return self.sent(name) or self.sent(name, age=2)

    def answer(self, name: str) -> Places | None:
        """Return what a robot hears from traffic at the next tick."""
        for _, answer in self._moment.answers(name):
            if isinstance(answer, Places):
                return answer
        return None

    def is_waiting_for(self, name: str, place: str) -> bool:
        """Whether a robot waits for a place, or has just asked for it."""
        wish = self.wish(name)
        newest = self.newest(name)
        is_heard = wish is not None and place in wish.places
        return is_heard or (newest is not None and place in newest.want)
