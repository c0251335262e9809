"""Drive robots of a run that goes on elsewhere with an agent of your own.

with connect("tcp/127.0.0.1:7447") as orchard:
    orchard.play("picker_01", MyAgent())
"""

from collections.abc import Iterator
from contextlib import contextmanager

from orchard.contract.agent import Agent
from orchard.field.layout import lay_out
from orchard.field.scenario import check
from orchard.net.bus import Bus, Inbox, client
from orchard.net.endpoints import BusError
from orchard.net.host import Host, HostEnded
from orchard.net.requests import fetch_run
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX, Keys
from orchard.wire.messages import RunInfo


class Remote:
    """A run, as one sees it who comes along. `layout` tells where everything stands, `names` whom an agent can drive."""

    def __init__(self, bus: Bus, keys: Keys, known: RunInfo) -> None:
        self._bus, self._keys = bus, keys
        self.run, self.mode, self.names = known.run, known.mode, known.agents
        self.layout = lay_out(check(known.scenario, "the scenario that physics sent"))

    def play(self, name: str, agent: Agent) -> str:
        """Drive a robot until the run ends; why it did. Raises BusError where the robot is somebody else's, or physics is gone."""
        if name not in self.names:
            raise BusError(f"{name}: no such agent; there are {', '.join(self.names)}")
        host = Host(self._bus, self._keys, self.run, self.mode, self.layout, {name: agent})
        host.listen()
        end = _end_of(host)
        if end.code:
            raise BusError(str(end))
        return str(end)


def _end_of(host: Host) -> HostEnded:
    try:
        host.run()
    except HostEnded as end:
        return end


@contextmanager
def connect(endpoint: str, prefix: str = PREFIX, secure: str | None = None) -> Iterator[Remote]:
    """The run that goes on at an endpoint; a secured one takes in who names its role's directory.

    Raises BusError where nobody listens, or no run is; ValueError where the directory is of no use.
    """
    keys = Keys(prefix)
    with client(endpoint, Inbox(), identity=identity_in(secure, prefix)) as bus:
        yield Remote(bus, keys, fetch_run(bus, keys))
