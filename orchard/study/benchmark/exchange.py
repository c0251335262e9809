"""What the benchmark and the process of a policy say to each other: msgpack over two pipes.

The benchmark names the policy (`Load`), begins a harvest (`Begin`), asks for each decision (`Ask`),
and ends the harvest (`Over`). The orchard that it sends has nothing random in it: see
`nothing_drawn`. What the seed draws is hidden from the policy.

The process of a policy forks a process for each harvest. That one answers `Ready`, then to each
question `Orders`, or what is wrong (`Fault`). Once it has ended, the policy's process says how:
because the harvest was over, or at fault (`Done`), because the policy ended it (`Gone`), or because
the policy has used up its time of the processor (`Spent`).
"""

from typing import BinaryIO

import msgspec

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport

# Bytes before a message, which say how many it has.
HEAD_BYTES = 4
# Bytes. More than all orders of the largest orchard need.
LARGEST_ANSWER = 100_000


class Load(msgspec.Struct, tag=True, frozen=True):
    """Import the module of a policy."""

    policy: str
    #: Files that it may not read, where the system can hide them.
    hidden: list[str]


class Begin(msgspec.Struct, tag=True, frozen=True):
    """Begin a harvest."""

    #: As JSON, without all that the seed draws: as `nothing_drawn` returns it.
    scenario: str
    #: Processor time that the policy may take in all of the harvest, s.
    processor_seconds: int


class Ask(msgspec.Struct, tag=True, frozen=True):
    """Decide."""

    now: int  #: tick
    bins: list[BinReport]
    carriers: list[CarrierReport]


class Over(msgspec.Struct, tag=True, frozen=True):
    """The harvest is over."""


Question = Load | Begin | Ask | Over


class Ready(msgspec.Struct, tag=True, frozen=True):
    """The policy can be asked."""

    #: Whether bins report to it before they are full.
    is_early: bool
    #: What its class says in `version`; '' if it says nothing.
    version: str


class Orders(msgspec.Struct, tag=True, frozen=True):
    """A decision."""

    orders: list[Assignment]


class Done(msgspec.Struct, tag=True, frozen=True):
    """The process of the harvest has ended by itself: the harvest was over, or at fault."""


class Fault(msgspec.Struct, tag=True, frozen=True):
    """The policy cannot be used, or has decided what cannot be."""

    text: str


class Gone(msgspec.Struct, tag=True, frozen=True):
    """The policy has ended the process of the harvest."""

    #: The exit code; below 0, the signal that ended it.
    code: int


class Spent(msgspec.Struct, tag=True, frozen=True):
    """The policy has used up its processor time, and the process of the harvest was ended."""

    #: The time that the policy had, s.
    processor_seconds: int


Answer = Ready | Orders | Done | Fault | Gone | Spent

_encoder = msgspec.msgpack.Encoder()
_questions = msgspec.msgpack.Decoder(Question)
_answers = msgspec.msgpack.Decoder(Answer)


def framed(message: Question | Answer) -> bytes:
    """Return a message as it is sent."""
    body = _encoder.encode(message)
    return len(body).to_bytes(HEAD_BYTES, "big") + body


def answer_of(body: bytes) -> Answer:
    """Return an answer. Raises ValueError for what is none."""
    answer: Answer = _answers.decode(body)
    return answer


def next_question(stream: BinaryIO) -> Question | None:
    """Return the next question; None if there is none, because the benchmark is over."""
    head = stream.read(HEAD_BYTES)
    if len(head) < HEAD_BYTES:
        return None
    question: Question = _questions.decode(stream.read(int.from_bytes(head, "big")))
    return question
