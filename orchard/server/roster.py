"""Which session owns which agent, and what a session needs to take over agents: their memories and their mail."""

from collections.abc import Iterable, Mapping

from orchard.contract.messages import Written
from orchard.net.refusals import NO_TOKEN, TAKEN, Refused
from orchard.wire.keys import LOGGER
from orchard.wire.messages import AskedOf, Report

MOST_TOKENS = 10_000  # liveliness tokens that are stored


class Roster:
    """The owner of each agent: a session, identified by the session id in its liveliness tokens."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.owners: dict[str, str] = {}  # name -> session id
        self.tokens: set[tuple[str, str]] = set()  # (name, session id) of each liveliness token
        self._last_owners: dict[
            str, str
        ] = {}  # name -> session id, also of one whose agents are released
        self._leaving: set[str] = set()  # owners that have said that they leave

    def token(self, name: str, owner: str, up: bool) -> None:
        """Record a liveliness token that appeared (`up`) or is gone: its session keeps its agents. Raises Refused."""
        if up and len(self.tokens) >= MOST_TOKENS:
            raise Refused("too many", f"there are {MOST_TOKENS} liveliness tokens")
        (self.tokens.add if up else self.tokens.discard)((name, owner))

    def may_join(self, name: str, owner: str) -> str:
        """Return why a session cannot own an agent; '' if it can."""
        if name not in self.names:
            return "there is no such agent"
        if (name, owner) not in self.tokens:
            return NO_TOKEN
        before = self.owners.get(name, owner)
        words = f"{TAKEN}, by session {before}; a run that is started --without {name} leaves it to others"
        return words if before != owner and (name, before) in self.tokens else ""

    @property
    def has_logger(self) -> bool:
        return any(name == LOGGER for name, _ in self.tokens)

    def join(self, name: str, owner: str) -> None:
        self.owners[name] = self._last_owners[name] = owner
        self._leaving.discard(owner)

    def leave(self, owner: str) -> None:
        if owner in self._last_owners.values():
            self._leaving.add(owner)

    def all_have_left(self) -> bool:
        """Whether no token is there, and each agent's last owner has said that it leaves: another may only be cut off."""
        return not self.tokens and self._leaving.issuperset(self._last_owners.values())

    def release(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Remove the owners of these agents. Return session id -> its released names."""
        released: dict[str, list[str]] = {}
        for name in sorted(names):
            released.setdefault(self.owners.pop(name), []).append(name)
        return released


Letters = Iterable[tuple[int, dict[str, Written]]]  # (tick, sender -> its letters)


class RecoveryLog:
    """The newest memory of each agent, and the letters of the last two ticks; physics does not interpret them."""

    def __init__(
        self, memories: Mapping[str, bytes | None] | None = None, letters: Letters = ()
    ) -> None:
        self.memories = dict(memories or {})
        self.letters: dict[int, dict[str, Written]] = dict(letters)  # tick -> sender -> its letters

    def keep(self, tick: int, reports: Mapping[str, Report]) -> None:
        """Store the memories and letters in the reports of the tick that was stepped last."""
        self.memories |= {
            name: report.memory for name, report in reports.items() if report.memory is not None
        }
        spoken = {
            name: report for name, report in reports.items() if report.requests or report.answers
        }
        written = {
            name: Written(report.requests, report.answers) for name, report in spoken.items()
        }
        self.letters = {at: letters for at, letters in self.letters.items() if at >= tick - 1}
        if written:
            self.letters[tick] = written

    def hearing(self, tick: int) -> set[str]:
        """Return the agents that hear mail at a tick: requests of the last tick, and replies to those before."""
        asked = {
            to for letters in self.letters.get(tick - 1, {}).values() for to, _ in letters.requests
        }
        return asked | {
            name for name, letters in self.letters.get(tick - 2, {}).items() if letters.requests
        }

    def asked(self, tick: int) -> list[AskedOf]:
        written = self.letters.get(tick, {}).items()
        return [
            AskedOf(to, sender, number)
            for sender, letters in written
            for number, (to, _) in enumerate(letters.requests)
        ]
