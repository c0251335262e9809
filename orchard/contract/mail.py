"""Mail between agents, repeatable because a tick is a superstep.

What is asked in tick k is heard in tick k + 1, sorted by kind, sender and number; it is answered in that tick or never;
the asker hears of it in tick k + 2, with an answer or without. Physics knows nothing of mail.
"""

import hashlib

from orchard.contract.agent import Action, Heard, Mail, Reply
from orchard.contract.messages import Answer, Given, Written, kind_of_message, pack


def in_hearing_order(requests: list[Heard]) -> list[Heard]:
    """Requests as every agent hears them: never in order of arrival."""
    return sorted(requests, key=lambda heard: (kind_of_message(heard.body), heard.sender, heard.tick, heard.number))


def digest_of(mail: Mail) -> bytes:
    """What the run's hash holds of one agent's mail at one tick; empty for no mail."""
    if not mail.requests and not mail.replies:
        return b""
    heard = [(h.sender, h.tick, h.number, h.body) for h in mail.requests]
    replies = [(r.sender, r.number, r.body) for r in mail.replies]
    return hashlib.blake2b(pack([heard, replies]), digest_size=16).digest()


def written_by(action: Action) -> Written | None:
    """The letters of an action; None when there are none."""
    if not action.requests and not action.answers:
        return None
    return Written(action.requests, [Given(heard.sender, heard.tick, heard.number, answer) for heard, answer in action.answers])


class LocalMail:
    """Carries mail within one process, as the bus does between several.

    All that it must remember is what was written in the last two ticks: from that follows what is heard at the next one.
    """

    def __init__(self, written: dict[int, dict[str, Written]] | None = None) -> None:
        self.written = written or {}  # tick -> sender -> what it wrote

    def collect(self, sender: str, tick: int, action: Action) -> None:
        """Take what an agent has written at a tick."""
        if (written := written_by(action)) is not None:
            self.keep(sender, tick, written)

    def keep(self, sender: str, tick: int, written: Written) -> None:
        """The same, as it was sent."""
        self.written.setdefault(tick, {})[sender] = written

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Everybody's mail at a tick; those without any are absent."""
        self.written = {at: letters for at, letters in self.written.items() if at >= tick - 2}
        mail: dict[str, Mail] = {}
        for recipient, requests in self._requests(tick - 1).items():
            mail[recipient] = Mail(requests=in_hearing_order(requests))
        answered = self._answers(tick - 1)
        for sender, letters in self.written.get(tick - 2, {}).items():
            if letters.requests:
                mail.setdefault(sender, Mail()).replies = [
                    Reply(to, number, request, answered.get((to, sender, tick - 2, number)))
                    for number, (to, request) in enumerate(letters.requests)
                ]
        return mail

    def _answers(self, tick: int) -> dict[tuple[str, str, int, int], Answer]:
        """(Who answers, who asked, tick, number) -> what was answered at a tick: nobody answers in another's place."""
        written = self.written.get(tick, {}).items()
        return {(name, to, at, number): body for name, letters in written for to, at, number, body in letters.answers}

    def _requests(self, tick: int) -> dict[str, list[Heard]]:
        """Recipient -> what was asked of it at a tick."""
        asked: dict[str, list[Heard]] = {}
        for sender, letters in self.written.get(tick, {}).items():
            for number, (to, request) in enumerate(letters.requests):
                asked.setdefault(to, []).append(Heard(sender, tick, number, request))
        return asked
