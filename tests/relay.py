"""A bad network for tests: carries connections to an endpoint, with delays, stalls and cuts, as a seed has it.

TCP mends what single packets suffer; what is left to see of a bad network is slowness, silence, and connections that break, also in the
middle of a message.
"""

import random
import socket
import threading
from contextlib import contextmanager, suppress

CHUNK = 4096  # bytes at a time
SECONDS = 30.0  # that any stall may last


class Relay:
    """Listens on a port of its own; every connection to it becomes one to the target. Use `relay`."""

    def __init__(self, target: int, seed: int, delay: float = 0.0, life: float = 0.0) -> None:
        """`delay`: at most so many seconds a chunk. `life`: bytes that a connection carries on average before it is cut; 0: it is not."""
        self._target, self._delay, self._life = target, delay, life
        self._chance = random.Random(seed)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._flows, self._ended = threading.Event(), threading.Event()
        self._flows.set()
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self.cuts = 0
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self._listening.getsockname()[1]}"

    def stall(self) -> None:
        """From now on nothing arrives, and no connection breaks."""
        self._flows.clear()

    def flow(self) -> None:
        """What was held up arrives, and all that comes."""
        self._flows.set()

    def calm(self) -> None:
        """From now on no connection breaks by itself."""
        self._life = 0.0

    def cut(self) -> None:
        """Break all connections that there are now."""
        for pair in self._pairs:
            _close(*pair)
        self._pairs.clear()

    def close(self) -> None:
        self._ended.set()
        self._flows.set()
        self._listening.close()
        self.cut()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                here, _ = self._listening.accept()
                threading.Thread(target=self._connect, args=(here,), daemon=True).start()

    def _connect(self, here: socket.socket) -> None:
        try:
            there = socket.create_connection(("127.0.0.1", self._target), timeout=SECONDS)
        except OSError:
            here.close()
            return
        there.settimeout(None)
        self._pairs.append((here, there))
        for source, sink in ((here, there), (there, here)):
            threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        """One direction, until either end closes or it is cut."""
        left = self._chance.expovariate(1.0 / self._life) if self._life else float("inf")
        with suppress(OSError):
            while chunk := source.recv(CHUNK):
                self._flows.wait(SECONDS)
                self._ended.wait(self._chance.random() * self._delay)
                sink.sendall(chunk[: int(min(left, len(chunk)))] if self._life else chunk)
                left -= len(chunk)
                if left <= 0 and self._life:
                    self.cuts += 1
                    break
        _close(source, sink)


def _close(*ends: socket.socket) -> None:
    for end in ends:
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()


@contextmanager
def relay(endpoint: str, seed: int = 1, **weather: float):
    """A relay to an endpoint of this machine, with `delay` and `life` of `Relay`."""
    carrier = Relay(int(endpoint.rpartition(":")[2]), seed, **weather)
    try:
        yield carrier
    finally:
        carrier.close()
