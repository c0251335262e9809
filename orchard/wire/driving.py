"""Agents to physics: how the robots shall move, and what their hosts report with it."""

from typing import Annotated

import msgspec
from msgspec import Meta

from orchard.messages import Deed, Written
from orchard.wire.geometry_msgs import Angular, Linear
from orchard.wire.vocabulary import MOST_BODIES, MOST_DEEDS, Holder, Known, Message, Once, Part, Text


class Report(Part):
    """What an agent's host says besides the velocity. A client that only drives leaves it out."""

    deeds: Annotated[
        list[Deed], Meta(max_length=MOST_DEEDS, description="couple, uncouple, flatten: physics decides whether it happens")
    ] = msgspec.field(default_factory=list)
    doing: Annotated[Text, Meta(description="a short present participle: 'picking row 3'")] = ""
    waits_for: Annotated[Text, Meta(description="whom or what, when it cannot go on")] = ""
    steps_done: Annotated[int, Meta(ge=0, lt=2**53, description="steps of its plan that it has finished")] = 0
    mail: Annotated[bytes, Meta(max_length=64, description="digest of the mail that was delivered at this tick; empty for none")] = b""
    memory: Annotated[bytes | None, Meta(description="the agent's memory, for whoever runs it next; nil: as before")] = None
    letters: Annotated[Written | None, Meta(description="a copy of what it asked and answered at this tick; nil: nothing")] = None


class Drive(Part):
    """A velocity among several."""

    linear: Linear
    angular: Angular
    once: Once = False
    report: Annotated[Report | None, Meta(description="the agent's report")] = None


class Velocities(Message):
    """The velocities of all agents of one session: its answer to what it has seen of this tick."""

    holder: Holder
    velocities: Annotated[dict[Known, Drive], Meta(max_length=MOST_BODIES, description="name -> its velocity")]


class Velocity(Message):
    """geometry_msgs/Twist, in the body's own frame: the answer to the pose and scan of the same tick."""

    linear: Linear
    angular: Angular
    holder: Holder = ""
    once: Once = False
    report: Annotated[Report | None, Meta(description="the agent's report; who only drives leaves it out")] = None
