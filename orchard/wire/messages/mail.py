"""Requests and answers between agents."""

from typing import Annotated

from msgspec import Meta

from orchard.contract.messages import Answer, Request, Tick, Written
from orchard.wire.messages.values import Message, Name

LETTERS = (
    "sender -> `requests`, numbered from 0: [to, request]; `answers`: [to, tick, number, answer]"
)


class Letter(Message):
    """A request from one agent to another, stamped with the tick in which it is sent."""

    sender: Annotated[Name, Meta(description="the agent that asks")]
    number: Annotated[
        int,
        Meta(
            ge=0,
            lt=2**31,
            description="its number among the requests of the sender in that tick, from 0",
        ),
    ]
    body: Annotated[Request, Meta(description="one of the requests")]


class Received(Message, tag_field="type", tag="received"):
    """First reply to a request: the request arrived, and will be heard at the next tick."""


class Answered(Message, tag_field="type", tag="answered"):
    """Second reply to a request. Its tick is the one in which the request was heard: the tick of
    the request + 1.
    """

    body: Annotated[
        Answer | None,
        Meta(description="one of the answers; nil: the request was heard and gets no answer"),
    ]


class Letters(Message):
    """All requests and answers of one tick."""

    letters: Annotated[dict[Name, Written], Meta(description=LETTERS)]


class Recall(Message):
    """A query for the mail of this tick, from a host that may have missed it."""


class Recalled(Message):
    """All requests and answers of the two ticks before."""

    letters: Annotated[
        list[tuple[Tick, dict[Name, Written]]],
        Meta(description="[tick, sender -> as in `letters`]"),
    ]
