"""The agent `dispatch` of a run in which fleet control sends the carriers.

Only a dispatch policy other than `nearest` needs it.
"""

from typing import Any

from orchard import Action, Layout, Mail, Observation
from orchard.behaviour.dispatcher import Booking, Dispatcher, DispatcherMemory
from orchard.dispatch.policy import CarrierReport
from orchard_vda5050.calls import Calls


class FleetDesk(Dispatcher):
    """Tells fleet control which full bins wait, and sends vehicles to those that orders name.

    Carriers with agents of their own are sent by the scenario's policy, as without it: a vehicle is
    never free.
    """

    holds = True

    def __init__(self, layout: Layout, name: str, calls: Calls) -> None:
        super().__init__(layout, name)
        self._calls = calls

    def tick(self, seen: Observation, mail: Mail, memory: Any) -> Action:
        """Dispatch carriers, and note which bins still wait."""
        action = super().tick(seen, mail, memory)
        bookings = action.memory.bookings
        waiting = [heard for heard in mail.requests if heard.sender not in bookings]
        self._calls.hear(waiting, seen.tick)
        return action

    def decide(self, memory: DispatcherMemory, carriers: list[CarrierReport], tick: int) -> None:
        """Book the vehicles that have an order for a full bin, and then all other carriers."""
        ordered = {}
        for carrier in carriers:
            report = memory.bins.get(carrier.job)
            if report is not None and not report.seconds_to_full:
                ordered[carrier.job] = Booking(carrier.name)
        memory.bookings = ordered | memory.bookings
        if any(carrier.is_next for carrier in carriers):
            super().decide(memory, carriers, tick)
