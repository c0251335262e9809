"""What all processes of a run have refused, added up."""

from collections import Counter
from collections.abc import Mapping

from orchard.lockstep import Refusals, Refused
from orchard.wire.course import Reason

MOST_SESSIONS = 1000  # whose refusals are added up


class Tally:
    """What physics refuses, and what each session says that it has refused."""

    def __init__(self) -> None:
        self.own = Refusals()
        self.there: dict[str, Mapping[Reason, int]] = {}  # session -> what it has refused so far

    def hear(self, session: str, counts: Mapping[Reason, int]) -> None:
        """A session's counts, in the place of its last ones. Raises Refused where there are too many sessions."""
        if len(self.there) >= MOST_SESSIONS and session not in self.there:
            raise Refused("too many", f"{MOST_SESSIONS} sessions have refused something")
        self.there[session] = counts

    def total(self) -> dict[str, int]:
        """By reason."""
        total: Counter[str] = Counter(self.own.counts)
        for counts in self.there.values():
            total.update(counts)
        return dict(sorted(total.items()))
