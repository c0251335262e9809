"""What stands in for the network and the clock in the tests of lockstep's and realtime's rules: queries, letters, owners, time."""

from recorded_messages import Query as AnyQuery

from orchard.contract.messages import StateRequest, pack
from orchard.server.roster import Roster
from orchard.wire.messages import Answered, Letter, Received, read

RUN = "run1"


class Query(AnyQuery):
    """A query whose replies are read."""

    def __init__(self, payload):
        super().__init__("", payload)

    def reply(self, payload):
        self.replies.append(read(payload, Received | Answered))


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def letter(sender="bin_01", tick=4, number=0):
    return pack(Letter(RUN, tick, sender, number, StateRequest()))


def roster(*held):
    one = Roster(["bin_01", "picker_01"])
    for name, owner in held:
        one.token(name, owner, True)
        one.join(name, owner)
    return one


def heard_at(box, tick, name="picker_01"):
    mail = box.deliver(tick).get(name)
    return [] if mail is None else mail.requests
