"""Mail between agents, which physics does not interpret.

Letters are the requests and answers that one agent writes at one tick. Mail is what one agent hears
at one tick: requests, and replies to its own.

It is repeatable: it is heard in a fixed order. A request of tick k is heard in tick k + 1, sorted
by kind, sender and number. It is answered in that tick or never. The sender receives the reply in
tick k + 2, with an answer or without.
"""

import hashlib

from orchard.contract.agent import Action, Heard, Mail, Reply
from orchard.contract.messages import Answer, Given, Written, pack, type_of, unpack


def in_hearing_order(requests: list[Heard]) -> list[Heard]:
    """Return requests in the order in which agents hear them.

    It does not depend on the order of arrival.
    """
    return sorted(requests, key=_place_in_hearing)


def _place_in_hearing(heard: Heard) -> tuple[str, str, int, int]:
    """Return what a request is sorted by: kind, sender, tick and number."""
    return type_of(heard.body), heard.sender, heard.tick, heard.number


def digest_of(mail: Mail) -> bytes:
    """Return the digest of one agent's mail at one tick, for the run's hash.

    It has 16 bytes; it is empty without mail.
    """
    if not mail.requests and not mail.replies:
        return b""
    heard = [(h.sender, h.tick, h.number, h.body) for h in mail.requests]
    # The request of a reply is left out: it was in the digest of the agent that heard it.
    replies = [(r.sender, r.number, r.body) for r in mail.replies]
    return hashlib.blake2b(pack([heard, replies]), digest_size=16).digest()


def given_by(action: Action) -> list[Given]:
    """Return the answers of an action, each with the number of its request in place of the
    request.
    """
    answers = []
    for heard, answer in action.answers:
        answers.append(Given(heard.sender, heard.tick, heard.number, answer))
    return answers


def copy_of(mail: Mail) -> Mail:
    """Return mail with new lists and messages.

    An agent that changes them changes neither the sender nor other agents.
    """
    if not mail.requests and not mail.replies:
        return mail
    packed = pack((mail.requests, mail.replies))
    return Mail(*unpack(packed, tuple[list[Heard], list[Reply]]))


class LocalMail:
    """Carries mail within one process, as the bus does between processes.

    It keeps only the letters of the last two ticks.

    >>> from orchard.contract.messages import StateRequest
    >>> post = LocalMail()
    >>> post.collect("carrier_01", 5, Action(requests=[("bin_02", StateRequest())]))
    >>> heard = post.deliver(6)["bin_02"].requests[0]
    >>> heard.sender, heard.tick, heard.number
    ('carrier_01', 5, 0)
    """

    def __init__(self, written: dict[int, dict[str, Written]] | None = None) -> None:
        """`written`: tick -> sender -> its letters, of a run that goes on from a snapshot."""
        self.written = written or {}

    def collect(self, sender: str, tick: int, action: Action) -> None:
        """Take the letters of an agent's action at a tick."""
        if action.requests or action.answers:
            self.written.setdefault(tick, {})[sender] = Written(action.requests, given_by(action))

    def deliver(self, tick: int) -> dict[str, Mail]:
        """Return the mail of all agents at a tick, by name. Agents without mail are absent."""
        self.written = {sent: letters for sent, letters in self.written.items() if sent >= tick - 2}
        mail: dict[str, Mail] = {}
        self._deliver_requests(mail, tick - 1)
        self._deliver_replies(mail, tick - 2)
        return mail

    def _deliver_requests(self, mail: dict[str, Mail], sent: int) -> None:
        """Add the requests of a tick to the mail of their recipients."""
        for sender, letters in self.written.get(sent, {}).items():
            for number, (recipient, request) in enumerate(letters.requests):
                heard = Heard(sender, sent, number, request)
                mail.setdefault(recipient, Mail()).requests.append(heard)
        for of_recipient in mail.values():
            of_recipient.requests = in_hearing_order(of_recipient.requests)

    def _deliver_replies(self, mail: dict[str, Mail], asked: int) -> None:
        """Add to the mail of the agents that asked at a tick what the others answered since."""
        # Keys: the agent that answers, the agent that asked, its tick, the number of the request.
        # So an answer counts only from the agent that was asked.
        answers: dict[tuple[str, str, int, int], Answer] = {}
        for name, letters in self.written.get(asked + 1, {}).items():
            for sender, tick, number, answer in letters.answers:
                answers[name, sender, tick, number] = answer
        for sender, letters in self.written.get(asked, {}).items():
            if not letters.requests:
                continue
            replies = []
            for number, (recipient, request) in enumerate(letters.requests):
                key = (recipient, sender, asked, number)
                replies.append(Reply(recipient, number, request, answers.get(key)))
            mail.setdefault(sender, Mail()).replies = replies
