"""Mail between agents, which physics does not interpret. It is repeatable: it is heard in a fixed order.

A request of tick k is heard in tick k + 1, sorted by kind, sender and number. It is answered in that tick or never. The sender receives
the reply in tick k + 2, with an answer or without.
"""

import hashlib

from orchard.contract.agent import Action, Heard, Mail, Reply
from orchard.contract.messages import Given, Written, pack, type_of, unpack


def in_hearing_order(requests: list[Heard]) -> list[Heard]:
    """Return requests in the order in which agents hear them. It does not depend on the order of arrival."""
    return sorted(
        requests, key=lambda heard: (type_of(heard.body), heard.sender, heard.tick, heard.number)
    )


def digest_of(mail: Mail) -> bytes:
    """Return the digest of one agent's mail at one tick, 16 bytes, for the run's hash; empty without mail."""
    if not mail.requests and not mail.replies:
        return b""
    heard = [(h.sender, h.tick, h.number, h.body) for h in mail.requests]
    replies = [(r.sender, r.number, r.body) for r in mail.replies]
    return hashlib.blake2b(pack([heard, replies]), digest_size=16).digest()


def given_by(action: Action) -> list[Given]:
    """Return the answers of an action, each with the number of its request in place of the request."""
    return [
        Given(heard.sender, heard.tick, heard.number, answer) for heard, answer in action.answers
    ]


def copy_of(mail: Mail) -> Mail:
    """Return mail with new lists and messages: an agent that changes them changes neither the sender nor other agents."""
    return (
        Mail(*unpack(pack((mail.requests, mail.replies)), tuple[list[Heard], list[Reply]]))
        if mail.requests or mail.replies
        else mail
    )


class LocalMail:
    """Carries mail within one process, as the bus does between processes. It keeps only the letters of the last two ticks."""

    def __init__(self, written: dict[int, dict[str, Written]] | None = None) -> None:
        self.written = written or {}  # tick -> sender -> its letters

    def collect(self, sender: str, tick: int, action: Action) -> None:
        if action.requests or action.answers:
            self.written.setdefault(tick, {})[sender] = Written(action.requests, given_by(action))

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Return the mail of all agents at a tick, by name. Agents without mail are absent."""
        self.written = {at: letters for at, letters in self.written.items() if at >= tick - 2}
        mail: dict[str, Mail] = {}
        last = self.written.get(tick - 1, {}).items()
        for sender, letters in last:
            for number, (to, request) in enumerate(letters.requests):
                mail.setdefault(to, Mail()).requests.append(
                    Heard(sender, tick - 1, number, request)
                )
        for heard_by_one in mail.values():
            heard_by_one.requests = in_hearing_order(heard_by_one.requests)
        # the key names the agent that answers, so no other agent can answer for it
        answered = {
            (name, to, at, number): body
            for name, letters in last
            for to, at, number, body in letters.answers
        }
        for sender, letters in self.written.get(tick - 2, {}).items():
            if letters.requests:
                mail.setdefault(sender, Mail()).replies = [
                    Reply(to, number, request, answered.get((to, sender, tick - 2, number)))
                    for number, (to, request) in enumerate(letters.requests)
                ]
        return mail
