"""Which session owns which agent, and what a session needs to take over agents.

Theory of operation. A session is the connection of one process to the bus. It declares a liveliness
token for each agent that it wants: the token shows that it lives, and goes when it does not. With
the token it may join, and from then on it owns the agent. Physics keeps the newest memory of each
agent and the letters of the last two ticks, so another session can take over at any tick, and the
run keeps its hash.

    state of an agent | what happens                                   | next state
    ------------------+------------------------------------------------+----------------------------
    free              | a session with a token joins with it           | owned
    owned             | the token of the owner is gone                 | owned; others may join now
    owned             | another session joins while the token is there | owned; the join is refused
    owned             | another session joins after that               | owned by the other one
    owned             | the barrier gives its session up, or in        | free
                      | realtime the token is gone                     |

At the end of a run physics waits until each last owner has said that it leaves: a session that is
only cut off still has to hear the end.
"""

from collections.abc import Iterable, Mapping

from orchard.contract.messages import Written
from orchard.net.refusals import NO_TOKEN, TAKEN, Refused
from orchard.wire.keys import LOGGER
from orchard.wire.messages import AskedOf, Report

# Liveliness tokens that are stored at most: in an open run any client may declare some.
MOST_TOKENS = 10_000


class Roster:
    """The owner of each agent: a session, identified by the session id in its liveliness tokens."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        # Name -> session id.
        self.owners: dict[str, str] = {}
        self.tokens: set[tuple[str, str]] = set()  # (name, session id) of each liveliness token
        # Name -> session id, also of a session that has released its agents.
        self._last_owners: dict[str, str] = {}
        # Owners that have said that they leave.
        self._leaving: set[str] = set()

    def token(self, name: str, owner: str, up: bool) -> None:
        """Record a liveliness token that appeared (`up`) or is gone.

        A session whose token is gone keeps its agents until others take them. Raises Refused if
        there are too many tokens.
        """
        if up and len(self.tokens) >= MOST_TOKENS:
            raise Refused("too many", f"there are {MOST_TOKENS} liveliness tokens")
        if up:
            self.tokens.add((name, owner))
        else:
            self.tokens.discard((name, owner))

    def may_join(self, name: str, owner: str) -> str:
        """Return why a session cannot own an agent; '' if it can."""
        if name not in self.names:
            return "there is no such agent"
        if (name, owner) not in self.tokens:
            return NO_TOKEN
        before = self.owners.get(name, owner)
        # The agent is free, or the session's already, or its owner is gone.
        if before == owner or (name, before) not in self.tokens:
            return ""
        way_out = f"a run that is started --without {name} leaves it to others"
        return f"{TAKEN}, by session {before}; {way_out}"

    @property
    def sessions(self) -> set[str]:
        """The ids of all sessions that own agents."""
        return set(self.owners.values())

    @property
    def has_logger(self) -> bool:
        """Whether a logger is there."""
        return any(name == LOGGER for name, _ in self.tokens)

    def join(self, name: str, owner: str) -> None:
        """Let a session own an agent."""
        self.owners[name] = owner
        self._last_owners[name] = owner
        self._leaving.discard(owner)

    def leave(self, owner: str) -> None:
        """Record that a session has said that it leaves."""
        if owner in self._last_owners.values():
            self._leaving.add(owner)

    def all_have_left(self) -> bool:
        """Whether no token is there, and each agent's last owner has said that it leaves.

        An owner without a token that has not said so may only be cut off, and come back.
        """
        return not self.tokens and self._leaving.issuperset(self._last_owners.values())

    def release(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Remove the owners of these agents. Return session id -> its released names."""
        released: dict[str, list[str]] = {}
        for name in sorted(names):
            released.setdefault(self.owners.pop(name), []).append(name)
        return released


Letters = Iterable[tuple[int, dict[str, Written]]]  # (tick, sender -> its letters)


class RecoveryLog:
    """The newest memory of each agent, and the letters of the last two ticks.

    Physics does not interpret them.
    """

    def __init__(
        self, memories: Mapping[str, bytes | None] | None = None, letters: Letters = ()
    ) -> None:
        self.memories = dict(memories or {})
        self.letters: dict[int, dict[str, Written]] = dict(letters)  # tick -> sender -> its letters

    def keep(self, tick: int, reports: Mapping[str, Report]) -> None:
        """Store the memories and letters of the reports of a tick, agent -> report.

        A report without a memory says that the memory has not changed. Letters that are older than
        those of the tick before are forgotten.
        """
        written = {}
        for name, report in reports.items():
            if report.memory is not None:
                self.memories[name] = report.memory
            if report.requests or report.answers:
                written[name] = Written(report.requests, report.answers)
        self.letters = {at: letters for at, letters in self.letters.items() if at >= tick - 1}
        if written:
            self.letters[tick] = written

    def hearing(self, tick: int) -> set[str]:
        """Return the agents that hear mail at a tick.

        They hear requests of the last tick, and replies to those before.
        """
        names = set()
        for asked in self.asked(tick - 1):
            names.add(asked.to)
        for name, letters in self.letters.get(tick - 2, {}).items():
            if letters.requests:
                names.add(name)
        return names

    def asked(self, tick: int) -> list[AskedOf]:
        """Return the requests of a tick: recipient, sender, and the number among the sender's."""
        requests = []
        for sender, letters in self.letters.get(tick, {}).items():
            for number, (to, _) in enumerate(letters.requests):
                requests.append(AskedOf(to, sender, number))
        return requests
