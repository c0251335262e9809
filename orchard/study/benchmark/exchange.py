"""The messages between the benchmark and the process of a policy: msgpack over two pipes.

The benchmark sends questions. It names the policy (`Load`), begins a harvest (`Begin`), asks for
each decision (`Ask`), and ends the harvest (`Over`). The orchard in `Begin` has nothing random in
it (`orchard.study.benchmark.seen`).

The process of a policy forks a process for each harvest. The forked process answers `Ready`, then
`Orders` to each question, or says what is wrong (`Fault`). When it has ended, the policy's process
says why: the harvest was over, or the policy made a fault (`Done`); the policy ended the process
itself (`Gone`); or the policy has used up its processor time (`Spent`).
"""

from typing import BinaryIO

import msgspec

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport

# Each message is preceded by its number of bytes, in so many bytes.
HEAD_BYTES = 4
# Bytes of an answer, at most: more than all orders of the largest orchard need.
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
    """Decide at a tick which carriers leave, by these reports."""

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
    """The process of the harvest has come to its regular end: the harvest was over, or it has
    answered `Fault`.
    """


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
    """Return the bytes of a message: its head, and its content."""
    body = _encoder.encode(message)
    return len(body).to_bytes(HEAD_BYTES, "big") + body


def answer_of(body: bytes) -> Answer:
    """Return the answer in some bytes. Raises ValueError if they are no answer."""
    answer: Answer = _answers.decode(body)
    return answer


def next_question(stream: BinaryIO) -> Question | None:
    """Return the next question; None if the benchmark has closed the pipe."""
    head = stream.read(HEAD_BYTES)
    if len(head) < HEAD_BYTES:
        return None
    question: Question = _questions.decode(stream.read(int.from_bytes(head, "big")))
    return question
