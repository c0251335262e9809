"""A run: what a client must know of it, which session owns which agent, and its end."""

from typing import Annotated, Any, Literal

from msgspec import Meta

from orchard.contract.messages import Metres
from orchard.field.survey import MOST_ROWS
from orchard.wire.messages.bodies import PoseMessage
from orchard.wire.messages.values import (
    MOST_BODIES,
    Box,
    Message,
    Name,
    Owner,
    RunMessage,
    Speed,
    SubMessage,
)

WALLS = (
    "x, y of the centre, half the size along x, half along y: four fences, then trunks and posts"
)
ROWS_OF_PICKER = "for a picker: the rows that it picks, in its order, numbered from 1 at the north"
WHY = (
    "why it ended: 'harvested', 'duration', 'stopped', 'broken' (all pickers), 'jammed' or "
    "'refused'; 'reset': it begins again"
)
Mode = Literal["lockstep", "realtime"]


class RunInfo(Message):
    """The reply to the scenario query: what a client must know before it joins."""

    mode: Annotated[
        Mode, Meta(description="whether physics waits for its agents or keeps to the wall clock")
    ]
    agents: Annotated[list[Name], Meta(description="the names of all agents")]
    scenario: Annotated[
        dict[str, Any], Meta(description="the scenario file as a map, with all default values")
    ]


class BodyStart(SubMessage):
    """A body at the start of the run."""

    name: Name
    kind: Annotated[Name, Meta(description="its kind, a name in `kinds`")]
    pose: PoseMessage
    bin: Annotated[str, Meta(description="the bin on its bar; '' for none")] = ""
    rows: Annotated[list[int], Meta(max_length=MOST_ROWS, description=ROWS_OF_PICKER)] = []


class LaserOfKind(SubMessage):
    """The laser of a kind of body. Its frame has the directions of the body's."""

    x: Annotated[
        Metres,
        Meta(
            description=(
                "m from the body's centre forward to the laser; it is in the middle of the width"
            )
        ),
    ]
    beams: Annotated[int, Meta(ge=1, description="number of ranges of a scan")]
    angle_min: Annotated[Metres, Meta(description="rad, as in `scan`")]
    angle_increment: Annotated[Metres, Meta(description="rad, as in `scan`")]
    range_min: Annotated[Metres, Meta(description="m, as in `scan`")]
    range_max: Annotated[Metres, Meta(description="m, as in `scan`")]


class KindOfBody(SubMessage):
    """What all bodies of a kind have in common. A body is a box; `base_link` is at its centre, on
    the ground.
    """

    length: Annotated[Metres, Meta(description="m, along x of `base_link`")]
    width: Annotated[Metres, Meta(description="m, along y of `base_link`")]
    height: Annotated[Metres, Meta(description="m")]
    colour: Annotated[tuple[int, int, int], Meta(description="red, green, blue, 0 to 255 (sRGB)")]
    max_linear: Annotated[Speed, Meta(description="m/s, the most forward and back")]
    max_angular: Annotated[Speed, Meta(description="rad/s, the most to each side")]
    tows: Annotated[
        Metres,
        Meta(
            description="m from its centre back to the centre of a coupled bin; 0: it tows nothing"
        ),
    ]
    solid: Annotated[bool, Meta(description="whether lasers see it and bodies collide with it")]
    robot: Annotated[
        bool,
        Meta(description="whether it is a robot: it can be stopped, and its states are counted"),
    ]
    laser: LaserOfKind


class Orchard(Message):
    """The reply to the layout query: all that does not change during the run. Lengths in m, in the
    frame `map`.
    """

    walls: Annotated[list[Box], Meta(description=WALLS)]
    rows: Annotated[
        list[Box],
        Meta(
            description=(
                "from the north: x, y of the west end and x, y of the east end of the part "
                "that is picked"
            )
        ),
    ]
    bodies: Annotated[
        list[BodyStart],
        Meta(
            max_length=MOST_BODIES,
            description="all bodies, in the order of `agents`, as they start",
        ),
    ]
    kinds: Annotated[
        dict[Name, KindOfBody],
        Meta(
            description="what bodies of each kind have in common, also of kinds without a body here"
        ),
    ]


class Join(RunMessage):
    """A request of a host to own agents. The host declares its liveliness tokens, subscribers and
    queryables before it joins.
    """

    owner: Owner
    names: Annotated[
        list[Name],
        Meta(
            max_length=MOST_BODIES,
            description="the agents that it wants to own; it gets all of them or none",
        ),
    ]


class Joined(Message):
    """The reply to a join: from this tick on, physics waits for the owner's velocities for these
    agents.
    """

    memories: Annotated[
        dict[Name, bytes | None], Meta(description="name -> its last memory; nil: it never had one")
    ]
    refused: Annotated[dict[Name, str], Meta(description="name -> why the session cannot own it")]


class Lost(Message):
    """Agents that physics no longer waits for, because their session is gone or was silent for too
    long. It may join again.
    """

    names: Annotated[list[Name], Meta(description="the agents")]
    owner: Annotated[Owner, Meta(description="the session that owned them")]


class Departure(RunMessage):
    """A session that owns agents leaves for good: the run is over for it, or a user has asked it to
    end.
    """


# Why a run has ended that begins again.
RESET = "reset"


class End(Message):
    """The last message of a run."""

    finished: Annotated[bool, Meta(description="whether the harvest is complete")]
    why: Annotated[str, Meta(description=WHY)]
    hash: Annotated[str, Meta(description="SHA-256 over all ticks, hexadecimal")]
    summary: Annotated[dict[str, Any], Meta(description="the figures of the whole run")]
