"""Which session holds which agent."""

from collections.abc import Iterable

from orchard.net.refusals import Refused

MOST_TOKENS = 10_000  # that are remembered
NO_TOKEN = "its liveliness token is missing"
TAKEN = "it is taken"


class Roster:
    """Who holds which agent. A holder is known by the session id in its liveliness tokens."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.holders: dict[str, str] = {}  # name -> session id
        self._by_holder: dict[str, list[str]] = {}  # made when it is asked for
        self._alive: set[tuple[str, str]] = set()

    def token(self, name: str, holder: str, up: bool) -> None:
        """A liveliness token came or went. Who is gone keeps its agents until someone takes them over, or they are released."""
        if up and len(self._alive) >= MOST_TOKENS:
            raise Refused("too many", f"{MOST_TOKENS} liveliness tokens stand")
        (self._alive.add if up else self._alive.discard)((name, holder))

    def may_join(self, name: str, holder: str) -> str:
        """Why a session cannot hold an agent; '' if it can."""
        if name not in self.names:
            return "there is no such agent"
        if (name, holder) not in self._alive:
            return NO_TOKEN
        if self.is_alive(name) and self.holders[name] != holder:
            return f"{TAKEN}, by session {self.holders[name]}"
        return ""

    def join(self, name: str, holder: str) -> None:
        self.holders[name], self._by_holder = holder, {}

    def is_alive(self, name: str) -> bool:
        return (name, self.holders.get(name, "")) in self._alive

    def is_there(self, name: str) -> bool:
        """Whether anybody's token of that name stands."""
        return any(there == name for there, _ in self._alive)

    def by_holder(self) -> dict[str, list[str]]:
        """Session id -> the names that it holds."""
        if not self._by_holder:
            for name in self.names:
                if name in self.holders:
                    self._by_holder.setdefault(self.holders[name], []).append(name)
        return self._by_holder

    def release(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Wait for these no longer; session id -> its names among them."""
        released: dict[str, list[str]] = {}
        self._by_holder = {}
        for name in sorted(names):
            released.setdefault(self.holders.pop(name), []).append(name)
        return released

    def anybody(self) -> bool:
        """Whether any token stands."""
        return bool(self._alive)
