"""Where all processes of a run meet: at physics itself, or at a router of its own, behind a relay through which every link goes."""

import socket
import time
from contextlib import ExitStack, suppress

from chaos.relay import Relay
from orchard.launch.supervisor import ProcessSpec, Supervisor, free_port

ROUTER = "router"
START_SECONDS = 30.0  # for which the router may take to listen
DELAY_SECONDS = 0.03  # by which a slow link delays what passes


class Place:
    """A meeting place; use it with `with`. `words` are those by which run.py finds it; at `endpoint` is who goes by no relay."""

    def __init__(self, is_routed: bool) -> None:
        self._port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self._port}"
        self.relay = Relay(free_port(), self._port) if is_routed else None
        self.words = ["--listen", self.endpoint] if self.relay is None else ["--connect", f"tcp/127.0.0.1:{self.relay.port}"]
        self._stack = ExitStack()

    def __enter__(self) -> "Place":
        if self.relay is not None:
            self._fleet = self._stack.enter_context(Supervisor(say=lambda words: None))
            self.start_router()
            self._wait_for_router()
            self._stack.enter_context(self.relay)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start_router(self) -> None:
        self._fleet.start(ProcessSpec(ROUTER, "processes.router", ["--listen", self.endpoint]))

    def kill_router(self) -> bool:
        """Whether there was one to kill."""
        is_there = self._fleet.exit_code(ROUTER) is None
        self._fleet.kill(ROUTER)
        return is_there

    def _wait_for_router(self) -> None:
        deadline = time.monotonic() + START_SECONDS
        while time.monotonic() < deadline:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self._port), 1.0):
                return
            time.sleep(0.05)
        raise RuntimeError(f"{self.endpoint}: the router does not listen there")
