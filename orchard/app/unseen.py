"""Pages for which no browser has come yet.

A page holds some megabytes, and a request alone makes one.
"""

from nicegui import Client

# Pages that wait for their browsers.
MOST = 8


class UnseenPages:
    """The pages that were built, and to which no browser has connected yet: at most MOST.

    Beyond that the oldest one is deleted. A browser that still comes for it loads the page again.
    """

    def __init__(self) -> None:
        self._clients: dict[str, Client] = {}

    def add(self, client: Client) -> None:
        """Count a page that is being built."""
        while len(self._clients) >= MOST:
            # A dict keeps its keys in the order in which they came.
            oldest, *_ = self._clients
            self._clients.pop(oldest).delete()
        self._clients[client.id] = client
        client.on_connect(self._forget)
        client.on_delete(self._forget)

    def _forget(self, client: Client) -> None:
        self._clients.pop(client.id, None)
