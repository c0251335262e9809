"""Drive a robot with your own agent, in a run of other processes.

    with connect("tcp/127.0.0.1:7447") as orchard:
        orchard.play("picker_01", MyAgent())

The agent runs in this process. `orchard.net` sends it what it observes, and physics its actions.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from orchard.contract.agent import Agent
from orchard.field.layout import Layout
from orchard.net.bus import Bus, Inbox
from orchard.net.endpoints import BusError
from orchard.net.host import Host, HostEnded
from orchard.net.requests import fetch_layout
from orchard.net.zenoh_bus import client
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX, Keys
from orchard.wire.messages import RunInfo


class Remote:
    """A connection to a run.

    `layout`: the place of each thing at the start. `names`: the agents of the run, which `play`
    accepts.
    """

    def __init__(self, bus: Bus, keys: Keys, known: RunInfo, layout: Layout) -> None:
        self._bus = bus
        self._keys = keys
        self.run = known.run
        self.mode = known.mode
        self.names = known.agents
        self.layout = layout

    def play(self, name: str, agent: Agent) -> str:
        """Drive a robot until the run ends; return why.

        Raises BusError if it is unknown or another session's, or if physics is gone.
        """
        if name not in self.names:
            raise BusError(f"{name}: no such agent; there are {', '.join(self.names)}")
        host = Host(
            self._bus,
            self._keys,
            run=self.run,
            mode=self.mode,
            layout=self.layout,
            agents={name: agent},
        )
        host.listen()
        try:
            host.run()
        except HostEnded as end:
            if end.code:
                raise BusError(str(end)) from None
            return str(end)


@contextmanager
def connect(endpoint: str, prefix: str = PREFIX, secure: str | None = None) -> Iterator[Remote]:
    """Connect to the run at an endpoint, such as tcp/127.0.0.1:7447, and close the connection at
    the end of the `with` block.

    A secured run requires `secure`: the directory with the certificate of a role
    (docs/security.md). Raises BusError if no router answers or no run is there. Raises ValueError
    if the directory is not valid.
    """
    keys = Keys(prefix)
    with client(endpoint, Inbox(), identity=identity_in(secure, prefix)) as bus:
        run, layout = fetch_layout(bus, keys)
        yield Remote(bus, keys, run, layout)
