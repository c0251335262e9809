"""The network of one run: physics is the router, or a process of its own is.

The latter stands behind a relay, through which every link goes, so that links can be damaged.
"""

import socket
import time
from contextlib import ExitStack, suppress

from chaos.relay import Relay
from orchard.launch.supervisor import ProcessSpec, Supervisor, free_port

ROUTER = "router"
START_SECONDS = 30.0  # s within which the router must listen
DELAY_SECONDS = 0.03  # s by which a slow link delays each chunk


class Network:
    """The network of one run. Use it with `with`.

    `arguments`: options of run.py that lead its processes to this network. `endpoint`: the router's
    own endpoint, without the relay. `relay`: None where physics is the router.
    """

    def __init__(self, is_routed: bool) -> None:
        """`is_routed`: whether there is a router process of its own, behind a relay."""
        self._port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self._port}"
        self.relay: Relay | None = None
        self.arguments = ["--listen", self.endpoint]
        if is_routed:
            self.relay = Relay(self._port)
            self.arguments = ["--connect", self.relay.endpoint]
        self._stack = ExitStack()

    def __enter__(self) -> "Network":
        if self.relay is not None:
            self._supervisor = self._stack.enter_context(Supervisor(say=lambda line: None))
            self.start_router()
            self._wait_for_router()
            self._stack.enter_context(self.relay)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start_router(self) -> None:
        """Start the router process."""
        self._supervisor.start(
            ProcessSpec(ROUTER, "orchard.processes.router", ["--listen", self.endpoint])
        )

    def kill_router(self) -> bool:
        """Kill the router process. Return whether it was running."""
        was_running = self._supervisor.exit_code(ROUTER) is None
        self._supervisor.kill(ROUTER)
        return was_running

    def take_port(self) -> socket.socket | None:
        """Listen at the port of physics, which has just died.

        Return None if physics is there again already.
        """
        with suppress(OSError):
            return socket.create_server(("127.0.0.1", self._port))
        return None

    def _wait_for_router(self) -> None:
        """Return when the router listens. Raises RuntimeError if it does not in time."""
        deadline = time.monotonic() + START_SECONDS
        while time.monotonic() < deadline:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self._port), 1.0):
                return
            time.sleep(0.05)
        raise RuntimeError(f"{self.endpoint}: the router does not listen after {START_SECONDS:g} s")
