"""Agents to agents: requests and answers; and physics' copies of them."""

from typing import Annotated, NamedTuple

from msgspec import Meta

from orchard.messages import Answer, Request, Written
from orchard.wire.vocabulary import Message, Name, Tick


class Letter(Message):
    """A request from one agent to another, stamped with the tick in which it is asked."""

    sender: Annotated[Name, Meta(description="who asks")]
    number: Annotated[int, Meta(ge=0, lt=2**31, description="of the sender's requests in that tick, from 0")]
    body: Annotated[Request, Meta(description="see below, 'The requests'")]


class AskedOf(NamedTuple):
    """A request of the tick before, without its words."""

    to: Name
    sender: Name
    number: int


class Received(Message, tag_field="type", tag="received"):
    """First reply to a request: it arrived and will be heard at the next tick."""


class Answered(Message, tag_field="type", tag="answered"):
    """Second reply to a request, stamped with the tick in which it was heard (asked + 1)."""

    body: Annotated[Answer | None, Meta(description="see below, 'The answers'; nil: it was heard and gets no answer")]


class Letters(Message):
    """All that was asked and answered at one tick."""

    letters: Annotated[
        dict[Name, Written], Meta(description="name -> `requests`, numbered from 0: [to, request]; `answers`: [to, tick, number, answer]")
    ]


class Recall(Message):
    """Which mail was for this tick? From one who was not there to hear it."""


class Recalled(Message):
    """All that was asked and answered at the two ticks before."""

    letters: Annotated[list[tuple[Tick, dict[Name, Written]]], Meta(description="[tick, name -> as in `letters`]")]
