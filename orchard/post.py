"""Mail between agents, repeatable because a tick is a superstep.

What is asked in tick k is heard in tick k + 1, sorted by kind, sender and number; it is answered in that tick or never;
the asker hears of it in tick k + 2, with an answer or without. Physics knows nothing of mail.
"""

import hashlib

from orchard.agent import Action, Heard, Mail, Reply
from orchard.messages import Answer, Request, pack


def in_hearing_order(requests: list[Heard]) -> list[Heard]:
    """Requests as every agent hears them: never in order of arrival."""
    return sorted(requests, key=lambda heard: (type(heard.body).__name__, heard.sender, heard.tick, heard.number))


def digest_of(mail: Mail) -> bytes:
    """What the run's hash holds of one agent's mail at one tick; empty for no mail."""
    if not mail.requests and not mail.replies:
        return b""
    heard = [(h.sender, h.tick, h.number, h.body) for h in mail.requests]
    replies = [(r.sender, r.number, r.body) for r in mail.replies]
    return hashlib.blake2b(pack([heard, replies]), digest_size=16).digest()


class PostOffice:
    """Carries mail within one process, as the bus does between several."""

    def __init__(self) -> None:
        self._asked: dict[str, list[tuple[int, int, str, Request]]] = {}  # sender -> (tick, number, to, request), of the last two ticks
        self._requests: dict[str, list[Heard]] = {}  # recipient -> what it hears next
        self._answers: dict[tuple[str, int, int], Answer] = {}  # (sender, tick, number) -> answer

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Everybody's mail at a tick; those without any are absent."""
        mail: dict[str, Mail] = {}
        for recipient, requests in self._requests.items():
            mail.setdefault(recipient, Mail()).requests = in_hearing_order(requests)
        self._requests = {}
        for sender, asked in self._asked.items():
            due = [entry for entry in asked if entry[0] == tick - 2]
            if due:
                mail.setdefault(sender, Mail()).replies = [
                    Reply(to, number, request, self._answers.pop((sender, asked_at, number), None)) for asked_at, number, to, request in due
                ]
            self._asked[sender] = [entry for entry in asked if entry[0] > tick - 2]
        return mail

    def collect(self, sender: str, tick: int, action: Action) -> None:
        """Take what an agent has written at a tick."""
        for number, (to, request) in enumerate(action.requests):
            self._asked.setdefault(sender, []).append((tick, number, to, request))
            self._requests.setdefault(to, []).append(Heard(sender, tick, number, request))
        for heard, answer in action.answers:
            self._answers[heard.sender, heard.tick, heard.number] = answer
