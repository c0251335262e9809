"""The router of the simulated network, which each session is linked to (link.py)."""

from functools import lru_cache, partial

import zenoh

from chaos.simulated.link import CONTROL, DATA, DOWN, Link
from chaos.simulated.scheduler import Scheduler


@lru_cache(maxsize=100_000)
def meets(one: str, other: str) -> bool:
    """Whether two key expressions have a key in common."""
    return bool(zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other)))


class Router:
    """A router: it passes on what the sessions that are linked to it send and declare."""

    def __init__(self, scheduler: Scheduler, owner: str = "", late: float = 0.0) -> None:
        """`owner`: the name of the process that has it; '' for a router of its own. `late`: s by
        which it passes on tokens late.
        """
        self.scheduler = scheduler
        self.owner = owner
        self._late = late
        # Session id -> its link.
        self.links: dict[str, Link] = {}
        # Session id -> the keys to which it subscribes, of which it answers queries, of which it
        # watches tokens, and of its own tokens.
        self._subscribers: dict[str, list[str]] = {}
        self._queryables: dict[str, list[str]] = {}
        self._watchers: dict[str, list[str]] = {}
        self._tokens: dict[str, list[str]] = {}
        # Key -> ids of the sessions that subscribe to it. It is computed on demand.
        self._receivers: dict[str, list[str]] = {}
        # Sessions that ask which sessions subscribe.
        self._interested: set[str] = set()
        # Number of a query -> the session that asks, and those that are to reply.
        self._pending: dict[int, tuple[str, list[str]]] = {}
        self.is_open = True

    @property
    def pending(self) -> int:
        """The number of queries that are under way."""
        return len(self._pending)

    def connect(self, link: Link) -> None:
        session = link.session.id
        self.links[session] = link
        for table in (self._subscribers, self._queryables, self._watchers, self._tokens):
            table[session] = []
        self._receivers = {}

    def lose(self, link: Link) -> None:
        """Forget a session whose link is closed."""
        session = link.session.id
        if self.links.get(session) is not link:
            return
        del self.links[session]
        self._interested.discard(session)
        for table in (self._subscribers, self._queryables, self._watchers):
            table.pop(session)
        for token in self._tokens.pop(session):
            self._tell_unless_known(token, False)
        for number, (asker, repliers) in list(self._pending.items()):
            if asker == session:
                del self._pending[number]
            elif session in repliers:
                self.finish(number, session)
        self._tell_subscribers()

    def close(self, share: float = 1.0) -> None:
        """End: all links are closed. `share`: how much of what it has sent still arrives."""
        if self.is_open:
            self.is_open = False
            for link in list(self.links.values()):
                link.end(DOWN, share)

    # -- declarations

    def subscribe(self, link: Link, keys: str) -> None:
        if self._is_linked(link):
            self._subscribers[link.session.id].append(keys)
            self._tell_subscribers()

    def answer(self, link: Link, key: str) -> None:
        if self._is_linked(link):
            self._queryables[link.session.id].append(key)

    def interest(self, link: Link) -> None:
        """Tell a session from now on which sessions subscribe to what."""
        if self._is_linked(link):
            self._interested.add(link.session.id)
            self._tell_subscribers()

    def watch(self, link: Link, tokens: str) -> None:
        if not self._is_linked(link):
            return
        self._watchers[link.session.id].append(tokens)
        for present in self._tokens.values():
            for token in present:
                if meets(tokens, token):
                    link.send(DOWN, partial(link.session.hear_token, token, True), CONTROL)

    def knows(self, token: str) -> bool:
        """Whether a liveliness token is there."""
        return any(token in tokens for tokens in self._tokens.values())

    def token(self, link: Link, token: str, up: bool) -> None:
        if not self._is_linked(link):
            return
        tokens = self._tokens[link.session.id]
        if up:
            self._tell_unless_known(token, True)
            tokens.append(token)
        elif token in tokens:
            tokens.remove(token)
            self._tell_unless_known(token, False)

    def _is_linked(self, link: Link) -> bool:
        return self.links.get(link.session.id) is link

    def _tell_unless_known(self, token: str, up: bool) -> None:
        """Pass on a token that appears or goes, unless another one with the same key is there.

        Others cannot tell such tokens apart.
        """
        if self.knows(token):
            return
        if self._late:
            self.scheduler.after(self._late, partial(self._tell_token_now, token, up))
        else:
            self._tell_token_now(token, up)

    def _tell_token_now(self, token: str, up: bool) -> None:
        """Pass on a token to all that watch it."""
        for session, keys in list(self._watchers.items()):
            if any(meets(watched, token) for watched in keys):
                link = self.links[session]
                link.send(DOWN, partial(link.session.hear_token, token, up), CONTROL)

    def _tell_subscribers(self) -> None:
        """Tell each session that wants to know it to which keys the others subscribe."""
        self._receivers = {}
        for session in sorted(self._interested & self.links.keys()):
            link = self.links[session]
            keys = self.subscribers_beside(session)
            link.send(DOWN, partial(link.session.hear_subscribers, keys), CONTROL)

    def subscribers_beside(self, session: str) -> list[str]:
        """Return the keys to which other sessions subscribe."""
        found: list[str] = []
        for other, keys in self._subscribers.items():
            if other != session:
                found += keys
        return found

    # -- data

    def publish(self, link: Link, key: str, payload: bytes, may_drop: bool) -> None:
        payload = link.carried(key, payload)
        if key not in self._receivers:
            self._receivers[key] = [
                session
                for session, keys in self._subscribers.items()
                if any(meets(one, key) for one in keys)
            ]
        for session in self._receivers[key]:
            if session != link.session.id:
                to = self.links[session]
                arrives = partial(to.session.hear_sample, key, to.carried(key, payload))
                to.send(DOWN, arrives, DATA, may_drop, len(payload))

    def ask(self, link: Link, number: int, key: str, payload: bytes) -> None:
        asker = link.session.id
        payload = link.carried(key, payload)
        repliers = [
            session
            for session, keys in self._queryables.items()
            if session != asker and any(meets(one, key) for one in keys)
        ]
        self._pending[number] = asker, list(repliers)
        for session in repliers:
            to = self.links[session]
            arrives = partial(to.session.hear_query, to, number, key, to.carried(key, payload))
            to.send(DOWN, arrives, size=len(payload))
        if not repliers:
            self.finish(number, "")

    def reply(self, number: int, key: str, payload: bytes, error: str) -> None:
        """Pass on a reply to the query of a key."""
        if number not in self._pending:
            return
        asker, _ = self._pending[number]
        link = self.links.get(asker)
        if link is None:
            return
        carried = link.carried(key, payload, is_reply=True)
        arrives = partial(link.session.hear_reply, number, carried, error)
        link.send(DOWN, arrives, size=len(payload))

    def finish(self, number: int, session: str) -> None:
        """Record that a session has sent all its replies to a query."""
        if number not in self._pending:
            return
        asker, repliers = self._pending[number]
        if session in repliers:
            repliers.remove(session)
        if not repliers:
            del self._pending[number]
            link = self.links.get(asker)
            if link is not None:
                link.send(DOWN, partial(link.session.hear_final, number))

    def forget_query(self, number: int) -> None:
        """Drop a query whose time is over."""
        self._pending.pop(number, None)
