"""A TCP relay that simulates a bad network: it cuts, stalls and delays connections through it.

TCP hides the loss of single packets. What remains visible of a bad network is delay, silence, and
connections that break, also in the middle of a message.
"""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from orchard.launch.supervisor import free_port

CHUNK = 1 << 16  # bytes that are passed on at a time, at most
WORK_SECONDS = 10.0  # s that a change may take in the relay's thread


class Damage(Protocol):
    """What a relay does to the bytes that pass."""

    def carry(self, chunk: bytes) -> tuple[bytes, bool]:
        """Return what passes of a chunk, and whether the link breaks after it."""


class NoDamage:
    """All passes as it is."""

    def carry(self, chunk: bytes) -> tuple[bytes, bool]:
        """Return the chunk."""
        return chunk, False


class Change:
    """Some bytes pass as others, each time. They must be in one chunk: a small write is."""

    def __init__(self, sent: bytes, arrived: bytes) -> None:
        """Raises ValueError unless both are equally long: else all frames after them are torn."""
        if len(sent) != len(arrived):
            raise ValueError(f"{len(sent)} bytes cannot pass as {len(arrived)}")
        self._sent = sent
        self._arrived = arrived

    def carry(self, chunk: bytes) -> tuple[bytes, bool]:
        """Return the chunk with the other bytes."""
        return chunk.replace(self._sent, self._arrived), False


class Break:
    """A link breaks where some bytes begin, once. They must be in one chunk."""

    def __init__(self, where: bytes) -> None:
        self._where = where
        self._is_done = False

    def carry(self, chunk: bytes) -> tuple[bytes, bool]:
        """Return what stands before these bytes, and that the link breaks; else the chunk."""
        at = chunk.find(self._where)
        if self._is_done or at < 0:
            return chunk, False
        self._is_done = True
        return chunk[:at], True


class _Link:
    """One connection through the relay, both directions."""

    def __init__(self, *writers: asyncio.StreamWriter) -> None:
        """`writers`: to both ends."""
        self.writers = writers
        # While it is not set nothing passes, and neither end learns of it.
        self.open = asyncio.Event()
        self.open.set()
        self.delay = 0.0  # s, for each chunk

    def cut(self) -> None:
        """Break the connections to both ends."""
        for writer in self.writers:
            writer.transport.abort()
        # What waits for it goes on, and finds the connections broken.
        self.open.set()


class Relay:
    """A relay between a free port and another port of the loopback.

    Use it with `with`; it works in its own thread.

    `target`: the port to which each connection is passed on.
    """

    def __init__(self, target: int) -> None:
        self.port = free_port()
        self._target = target
        self._loop = asyncio.new_event_loop()
        self._links: list[_Link] = []
        self._damage: Damage = NoDamage()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> "Relay":
        self._thread.start()
        self._do(self._listen())
        return self

    def __exit__(self, *_: object) -> None:
        self._do(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    @property
    def endpoint(self) -> str:
        """The Zenoh endpoint at which clients reach the relay."""
        return f"tcp/127.0.0.1:{self.port}"

    def cut(self, which: int | None = None) -> None:
        """Break a link without notice.

        `which`: any number, it selects one of the present links; None: all links.
        """
        self._change(which, _Link.cut)

    def stall(self, which: int | None) -> None:
        """Let nothing pass through one link or all links until `heal`; nothing is lost."""

        def stall(link: _Link) -> None:
            link.open.clear()

        self._change(which, stall)

    def delay(self, which: int | None, seconds: float) -> None:
        """Delay each chunk of one link or of all links by so many seconds until `heal`."""

        def slow_down(link: _Link) -> None:
            link.delay = seconds

        self._change(which, slow_down)

    def damage(self, damage: Damage) -> None:
        """Let a damage happen to all that passes on each link from now on, until `heal`."""
        self._damage = damage

    def heal(self) -> None:
        """End all stalls, the delays set by `delay`, and the damage."""
        self._damage = NoDamage()

        def change(link: _Link) -> None:
            link.delay = 0.0
            link.open.set()

        self._change(None, change)

    def _change(self, which: int | None, change: Callable[[_Link], None]) -> None:
        """Change one link or all links. Return when that is done."""

        async def change_links() -> None:
            links = list(self._links)
            if which is not None and links:
                links = [links[which % len(links)]]
            for link in links:
                change(link)

        self._do(change_links())

    def _do(self, work: Any) -> None:
        """Do some work in the relay's thread. Return when it is done."""
        asyncio.run_coroutine_threadsafe(work, self._loop).result(WORK_SECONDS)

    # -- in the relay's thread

    async def _listen(self) -> None:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass on a new connection until it ends. `reader`, `writer`: from and to the client."""
        try:
            target_reader, target_writer = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            # The router is down.
            writer.transport.abort()
            return
        link = _Link(writer, target_writer)
        self._links.append(link)
        await asyncio.gather(
            self._pump(link, reader, target_writer), self._pump(link, target_reader, writer)
        )
        self._links.remove(link)

    async def _pump(
        self, link: _Link, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Pass on one direction of a link until an end closes it or it is cut."""
        with suppress(OSError):
            chunk = await reader.read(CHUNK)
            # An end that is closed gives an empty chunk.
            while chunk:
                await link.open.wait()
                await asyncio.sleep(link.delay)
                passed, is_end = self._damage.carry(chunk)
                writer.write(passed)
                await writer.drain()
                if is_end:
                    break
                chunk = await reader.read(CHUNK)
        link.cut()

    async def _close(self) -> None:
        self._server.close()
        for link in list(self._links):
            link.cut()
        await asyncio.sleep(0.05)  # the pumps need a moment to end
