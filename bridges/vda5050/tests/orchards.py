"""An orchard in this process, whose carriers or pickers are vehicles of a fleet control.

It runs in virtual time and without a network: a test decides when a tick passes and which messages
arrive.
"""

import json
from itertools import count

from master import Master
from orchard_vda5050.calls import Calls
from orchard_vda5050.fleet import agents_of
from orchard_vda5050.vehicle import Timing

from orchard import Local, Scenario
from orchard.roads.lif import lif_of
from orchard.roads.pickers import graphs_of
from orchard.sim.lookahead import Lookahead

# What each message begins with, but for its number and the vehicle.
HEADER = {"timestamp": "2026-01-01T00:00:00.000Z", "version": "3.0.0", "manufacturer": "orchard"}

EACH_SECOND = Timing()  # the default: a state each second
# Scenarios. Nobody and nothing is in the way of the vehicles.
QUIET = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}
# A harvest that is short enough for a test.
SMALL = {"rows": 3, "row_length": 24.0, "picking_speed": 1.0, "pickers": 2, "carriers": 2} | QUIET


class Wire:
    """The line of a vehicle to fleet control, whose messages a test takes and gives.

    It writes and reads all of them as JSON, as a real line does. What is given while the line is
    cut is lost, on both sides.
    """

    def __init__(self, serial):
        self.serial = serial
        # Pairs of a topic and bytes that the vehicle has not taken yet.
        self.inbox = []
        # Pairs of a topic and a message that the vehicle has sent.
        self.sent = []
        self.headers = count()
        self.is_up = True

    # -- what the vehicle calls

    def take(self):
        taken = self.inbox
        self.inbox = []
        return taken

    def send(self, topic, message):
        if self.is_up:
            header = {"headerId": next(self.headers), **HEADER, "serialNumber": self.serial}
            self.sent.append((topic, json.loads(json.dumps(header | message))))

    @property
    def state_header_id(self):
        return 0

    # -- what a test calls

    def give(self, topic, message):
        """Send the vehicle a message."""
        if self.is_up:
            self.inbox.append((topic, json.dumps(message).encode()))


class Fleet:
    """The orchard, its vehicles and their fleet control.

    Parameters
    ----------
    scenario
        The fields of the scenario that differ from its defaults.
    names
        The robots that are vehicles, or their kinds.
    timing
        How often a vehicle sends, and how long it waits for fleet control before it goes home.
    released
        How many nodes fleet control releases at once.
    holds
        The class that decides which robots need not be asked in a tick.

    """

    def __init__(
        self, scenario, names=("carrier",), timing=EACH_SECOND, released=4, holds=Lookahead
    ):
        self.run = Local(Scenario(**{"dispatch": "nearest"} | scenario), holds=holds)
        layout = self.run.engine.layout
        graphs = graphs_of(layout)
        self.graphs = {graph.kind: graph for graph in graphs}
        self.graph = self.graphs["carrier"]
        self.wires = {}
        vehicles = [
            name for name in layout.names if name in names or name.rsplit("_", 1)[0] in names
        ]
        desk = [name for name in layout.agents if name == "dispatch"]
        agents = agents_of(
            layout,
            [*vehicles, *desk],
            lambda name: self.wires.setdefault(name, Wire(name)),
            Calls(self.hear_calls),
            timing,
        )
        for name, agent in agents.items():
            self.run.play(name, agent)
        self.master = Master(
            lif_of(graphs, "test", HEADER["timestamp"]),
            lambda name, *message: self.wires[name].give(*message),
            released,
        )
        # All messages of vehicles so far: the vehicle, the topic and the message.
        self.heard = []
        # Whether fleet control hears and acts.
        self.has_master = True

    def hear_calls(self, waiting):
        self.master.hear_calls(waiting)

    def tick(self):
        """Let 0.1 s pass, then let fleet control hear and act. Return the events of the tick."""
        events = self.run.tick()
        for name, wire in self.wires.items():
            for topic, message in wire.sent:
                self.heard.append((name, topic, message))
                if self.has_master:
                    self.master.hear(name, topic, message)
            wire.sent.clear()
        if self.has_master:
            self.master.assign()
        return events

    def cut(self, name, is_up=False):
        """Cut the line of a vehicle, or mend it. Its broker says so to fleet control."""
        self.wires[name].is_up = is_up
        self.master.hear(
            name, "connection", {"connectionState": "ONLINE" if is_up else "CONNECTION_BROKEN"}
        )

    def until(self, condition, seconds=600.0):
        """Tick until a condition is true. Return what it is."""
        end = self.run.engine.tick + 10 * seconds
        while not (value := condition()):
            assert self.run.engine.tick < end and not self.run.engine.over, (
                f"not within {seconds} s: {self.run.engine.over}"
            )
            self.tick()
        return value

    def state(self, name):
        """The newest state that a vehicle has sent, or one without nodes if it has sent none."""
        for vehicle, topic, message in reversed(self.heard):
            if (vehicle, topic) == (name, "state"):
                return message
        return {"nodeStates": []}

    def pose(self, name):
        """Where a vehicle is."""
        return self.run.seen[name].pose
