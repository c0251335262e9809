"""What a host needs to take over agents: their memories, and the mail of the last two ticks."""

from collections.abc import Iterable, Mapping

from orchard.contract.messages import Written
from orchard.wire.messages import AskedOf, Velocity

Letters = Iterable[tuple[int, dict[str, Written]]]  # (tick, sender -> what it wrote)


class RecoveryLog:
    """What a newcomer must know, unread: of each agent the newest memory that it sent, and the letters of the last two ticks."""

    def __init__(self, memories: Mapping[str, bytes | None] | None = None, letters: Letters = ()) -> None:
        self.memories = dict(memories or {})
        self.letters: dict[int, dict[str, Written]] = dict(letters)  # tick -> sender -> what it wrote

    def keep(self, tick: int, velocities: Mapping[str, Velocity]) -> None:
        """Take what came with the velocities of a tick, the last one that was stepped."""
        written = {}
        for name, velocity in velocities.items():
            if velocity.report is None:
                continue
            if velocity.report.memory is not None:
                self.memories[name] = velocity.report.memory
            if velocity.report.letters is not None:
                written[name] = velocity.report.letters
        self.letters = {at: letters for at, letters in self.letters.items() if at >= tick - 1}
        if written:
            self.letters[tick] = written

    def asked(self, tick: int) -> list[AskedOf]:
        """All requests of a tick."""
        written = self.letters.get(tick, {}).items()
        return [AskedOf(to, sender, number) for sender, letters in written for number, (to, _) in enumerate(letters.requests)]
