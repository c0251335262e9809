"""What all messages of VDA 5050 are made of, in both directions: parts, names and numbers."""

from typing import Annotated

import msgspec
from msgspec import Meta

# Characters of the name of an order or an action.
LONGEST_ID = 200
Count = Annotated[int, Meta(ge=0, lt=2**32)]
Name = Annotated[str, Meta(max_length=LONGEST_ID)]


class MessagePart(msgspec.Struct, rename="camel", gc=False):
    """A part of a message. Its fields have the names of VDA 5050, in camel case there.

    There are many, and none refers back to what holds it: they need no garbage collection.
    """
