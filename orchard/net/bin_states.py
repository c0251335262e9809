"""The states of the bins of a host, for clients that want to know them."""

from orchard.contract.agent import Observation
from orchard.contract.messages import pack
from orchard.net.bus import Bus, Query
from orchard.net.refusals import Refused
from orchard.wire.keys import Keys
from orchard.wire.messages import BinStatus


class StateBoard:
    """The states of the bins: published when they change, and sent in reply to queries."""

    def __init__(self, bus: Bus, keys: Keys, run: str) -> None:
        self._bus = bus
        self._keys = keys
        self._run = run
        # Bin -> its state.
        self._states: dict[str, BinStatus] = {}

    def update(self, seen: Observation) -> None:
        """Store the state of an observed bin. Publish it if `full` or `coupled_to` has changed."""
        if seen.hitch:
            robot = seen.hitch.name
        else:
            robot = ""
        state = BinStatus(self._run, seen.tick, seen.full, seen.fill, robot)
        old = self._states.get(seen.name)
        self._states[seen.name] = state
        if old is None or (old.full, old.coupled_to) != (state.full, state.coupled_to):
            self._bus.publish(self._keys.of("state", seen.name), pack(state))

    def tell(self, name: str, question: Query) -> None:
        """Reply to a query for the state of the bin `name`. Raises Refused if it has a payload."""
        if question.payload:
            question.refuse("malformed: a query for a state has no payload")
            raise Refused("malformed", "a query for a state has no payload")
        if name not in self._states:
            question.refuse("not known before the first tick")
            return
        question.reply(pack(self._states[name]))
        question.drop()
