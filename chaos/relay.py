"""A relay in front of a router, whose links can be cut, stalled and delayed one by one: the network of the soak."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

CHUNK = 1 << 16  # bytes


class _Link:
    """One connection through the relay, both ways."""

    def __init__(self, *writers: asyncio.StreamWriter) -> None:
        self.writers = writers
        self.open = asyncio.Event()  # not set: nothing passes, and nobody is told
        self.open.set()
        self.delay = 0.0  # s, for every piece

    async def pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while piece := await reader.read(CHUNK):
                await self.open.wait()
                await asyncio.sleep(self.delay)
                writer.write(piece)
                await writer.drain()
        self.cut()

    def cut(self) -> None:
        for writer in self.writers:
            writer.transport.abort()
        self.open.set()


class Relay:
    """Listens on one port of the loopback and passes everything on to another; use it with `with`. Its own thread does the work."""

    def __init__(self, port: int, to: int) -> None:
        self.port, self._to = port, to
        self._loop = asyncio.new_event_loop()
        self._links: list[_Link] = []
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

    def cut(self, which: int | None) -> None:
        """Drop a connection, without a word; any number names one of those that are there, None names all of them."""
        self._change(which, _Link.cut)

    def stall(self, which: int | None) -> None:
        """Let nothing pass, until all is healed; nothing is lost."""
        self._change(which, lambda link: link.open.clear())

    def delay(self, which: int | None, seconds: float) -> None:
        """Let every piece take so much longer, until all is healed."""
        self._change(which, lambda link: setattr(link, "delay", seconds))

    def heal(self) -> None:
        """Nothing is stalled or delayed any more."""

        def change(link: _Link) -> None:
            link.delay = 0.0
            link.open.set()

        self._change(None, change)

    def _change(self, which: int | None, change: Callable[[_Link], None]) -> None:
        """It is done when this returns."""

        async def do() -> None:
            for link in list(self._links) if which is None else self._links[which % max(1, len(self._links)) :][:1]:
                change(link)

        self._do(do())

    def _do(self, work: Any) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(10.0)

    # -- in the relay's thread

    async def _listen(self) -> None:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self._to)
        except OSError:  # the router is away
            writer.transport.abort()
            return
        link = _Link(writer, there_writer)
        self._links.append(link)
        await asyncio.gather(link.pump(reader, there_writer), link.pump(there_reader, writer))
        self._links.remove(link)

    async def _close(self) -> None:
        self._server.close()
        for link in list(self._links):
            link.cut()
        await asyncio.sleep(0.05)  # for those who pump to find that out
