"""An orchard in this process whose carriers are vehicles, and a line to a fleet control: in virtual
time, without a network.
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

HEADER = {"timestamp": "2026-01-01T00:00:00.000Z", "version": "3.0.0", "manufacturer": "orchard"}

EACH_SECOND = Timing()
QUIET = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}
SMALL = {"rows": 3, "row_length": 24.0, "picking_speed": 1.0, "pickers": 2, "carriers": 2} | QUIET


class Wire:
    """A port whose messages a test takes and gives.

    It writes and reads all of them as JSON, as a real line does.
    """

    def __init__(self, serial):
        self.serial, self.inbox, self.sent, self.headers, self.is_up = serial, [], [], count(), True

    def take(self):
        taken, self.inbox = self.inbox, []
        return taken

    def send(self, topic, message):
        if self.is_up:
            self.sent.append(
                (
                    topic,
                    json.loads(
                        json.dumps(
                            {"headerId": next(self.headers), **HEADER, "serialNumber": self.serial}
                            | message
                        )
                    ),
                )
            )

    @property
    def state_header_id(self):
        return 0

    def give(self, topic, message):
        if self.is_up:
            self.inbox.append((topic, json.dumps(message).encode()))


class Fleet:
    """The orchard, its vehicles and their fleet control.

    `names`: the robots that are vehicles, or their kinds.
    """

    def __init__(
        self, scenario, names=("carrier",), timing=EACH_SECOND, released=4, holds=Lookahead
    ):
        self.run = Local(Scenario(**{"dispatch": "nearest"} | scenario), holds=holds)
        layout = self.run.engine.layout
        graphs, self.wires = graphs_of(layout), {}
        self.graphs = {graph.kind: graph for graph in graphs}
        self.graph = self.graphs["carrier"]
        named = [
            name
            for name in layout.names
            if any(word in (name, name.rsplit("_", 1)[0]) for word in names)
        ]
        desk = [name for name in layout.agents if name == "dispatch"]
        agents = agents_of(
            layout,
            [*named, *desk],
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
        self.heard = []
        self.has_master = True

    def hear_calls(self, waiting):
        self.master.hear_calls(waiting)

    def tick(self):
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
        while not (found := condition()):
            assert self.run.engine.tick < end and not self.run.engine.over, (
                f"not within {seconds} s: {self.run.engine.over}"
            )
            self.tick()
        return found

    def state(self, name):
        """The newest state that a vehicle has sent."""
        return next(
            (
                message
                for who, topic, message in reversed(self.heard)
                if (who, topic) == (name, "state")
            ),
            {"nodeStates": []},
        )

    def pose(self, name):
        return self.run.seen[name].pose
