"""What a host tells of its bins, and what it knows of physics by tokens."""

from msgspec.structs import replace
from recorded_messages import KEYS, RUN, Net, StandIn

from orchard.contract.agent import Hitch
from orchard.field.geometry import STILL
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.net.bin_states import StateBoard
from orchard.net.ending import Ending
from orchard.wire.messages import BinStatus, End, read

# What a bin sees of the robot on its bar: picker_01, which stands and faces east.
HITCH = Hitch("picker_01", 0.0, 0.0, (0.0, 1.0), STILL, None)


def test_a_bin_tells_when_it_couples_and_when_it_is_full():
    net = Net()
    board = StateBoard(StandIn(net, "host1"), KEYS, RUN)
    alone = Local(Scenario(rows=3)).engine.observe()["bin_01"]
    alone = replace(alone, hitch=None)
    coupled = replace(alone, hitch=HITCH)
    full = replace(coupled, full=True)
    for seen in (alone, alone, coupled, coupled, full, full, alone):
        board.update(seen)
    statuses = [read(payload, BinStatus) for _, payload in net.sent]
    assert [(state.full, state.coupled_to) for state in statuses] == [
        (False, ""),
        (False, "picker_01"),
        (True, "picker_01"),
        (False, ""),
    ]


def test_physics_is_there_while_one_of_two_tokens_is():
    """The router may take a dead physics for alive while the new one has a token, too.

    The message `end` counts only when no token is left.
    """
    ending = Ending(lambda: 0.0)
    ending.track("dead", True)
    ending.track("new", True)
    ending.track("dead", False)
    ending.hear(End(RUN, 3, True, "harvested", "0" * 64, {}))
    assert ending.end is None
    ending.track("new", False)
    assert ending.end is not None
