"""For those who look on: what happened, what is to be seen, and how the run goes."""

from typing import Annotated, Any

from msgspec import Meta

from orchard.wire.vocabulary import Body, Fill, Message, Name, Part, Text, Tick


class Happened(Part):
    """One thing that happened."""

    tick: Tick
    what: Text
    who: Annotated[Text, Meta(description="whose deed, or whose step it was")]
    whom: Annotated[Text, Meta(description="'' or the other body")]
    detail: Annotated[str, Meta(max_length=1000)]


class Events(Message):
    """What happened in the step from this tick to the next."""

    events: Annotated[list[Happened], Meta(description="maps of `tick`, `what`, `who`, `whom` ('' or the other body), `detail`")]


class State(Message):
    """A bin's, published whenever `full` or `coupled_to` changes."""

    full: Annotated[bool, Meta(description="it holds a whole row")]
    fill: Annotated[Fill, Meta(description="m of row in it, 0 to 70")]
    coupled_to: Annotated[str, Meta(description="the robot that tows it; '' when it stands by itself")]


class Picture(Message):
    """The whole orchard after the step that ends at this tick, for those who look on. `nil`: as before; every 5 s, and when a logger
    comes, nothing is nil."""

    poses: Annotated[bytes, Meta(description="x, y (m), yaw (rad) of every body, in the scenario's order, as little-endian float64")]
    scans: Annotated[list[bytes] | None, Meta(description="twice a second: every body's ranges, m, as little-endian float32")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does; those that do something new")]
    coupled: Annotated[list[Body] | None, Meta(description="of every body, the number of the one at the other end of its bar, or -1")]
    fill: Annotated[list[Fill] | None, Meta(description="of every bin, m of row in it; 0 of other bodies")]
    alive: Annotated[list[bool] | None, Meta(description="false for a weed that is flattened")]
    row_picked: Annotated[list[Fill] | None, Meta(description="m of every row that are picked, 0 to 70")]
    delivered: Annotated[int, Meta(ge=0, description="bins unloaded so far")]


class Figures(Message):
    """How the run goes."""

    figures: Annotated[dict[str, Any], Meta(description="name -> number, or a map of them")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does")]
    waits_for: Annotated[dict[Name, str], Meta(description="name -> for whom or what it waits; those that wait for nothing are left out")]
    messages_refused: Annotated[dict[str, int], Meta(description="reason -> how many, since the beginning")]
