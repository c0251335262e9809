"""The course of a run: who comes to it and joins, who stops robots or the run, what was refused, and how it ended."""

from typing import Annotated, Any, Literal

from msgspec import Meta

from orchard.wire.vocabulary import MOST_BODIES, Holder, Message, Name, OfRun, Text

Mode = Literal["lockstep", "realtime"]


class Newcomer(Message):
    """What a newcomer must know: the answer to the scenario query."""

    mode: Annotated[Mode, Meta(description="whether physics waits for its agents, or keeps to the wall clock")]
    agents: Annotated[list[Name], Meta(description="every name that an agent can hold")]
    scenario: Annotated[dict[str, Any], Meta(description="the scenario file as a map, defaults filled in")]


class Join(OfRun):
    """A host's wish to hold agents. Its liveliness tokens, its subscribers and its queryables must stand before it."""

    holder: Holder
    names: Annotated[list[Name], Meta(max_length=MOST_BODIES, description="the agents that it wants to hold: all or none")]


class Joined(Message):
    """From this tick on physics waits for the holder's velocities for these agents."""

    memories: Annotated[dict[Name, bytes | None], Meta(description="name -> the memory it had; nil: it never had one")]
    refused: Annotated[dict[Name, str], Meta(description="name -> why it cannot be held")]


class Lost(Message):
    """Agents that physics no longer waits for, because they were gone or silent for too long. They may join again."""

    names: Annotated[list[Name], Meta(description="the agents")]
    holder: Annotated[Holder, Meta(description="the session that held them")]


class Command(OfRun):
    """What a person asks of the run."""

    command: Annotated[Literal["stop"], Meta(description="end the run now")]


class Done(Message):
    """The command is taken."""


class Stop(OfRun):
    """An emergency stop, or its end."""

    stop: Annotated[bool, Meta(description="true: they stand, from the step under way on, until they are reset; false: they are reset")]
    names: Annotated[
        list[Text], Meta(max_length=MOST_BODIES, description="robots, or kinds of them: 'picker_01', 'carrier'; none: all robots")
    ]


class Stopped(Message):
    """The stop, or reset, holds from the step from this tick to the next on."""

    changed: Annotated[list[Name], Meta(description="robots that were stopped, or reset, by this; those that were so before are left out")]
    stopped: Annotated[list[Name], Meta(description="all robots that are stopped now")]
    kept: Annotated[bool, Meta(description="whether it is on the disk, too; else it holds, but not if physics dies now")] = False


Reason = Literal[
    "malformed", "other run", "past tick", "future tick", "not the holder", "not held", "answered already",
    "no such robot", "no such agent", "no such key", "out of bounds", "not all", "too many",
]  # fmt: skip


class RefusedThere(OfRun):
    """What one host, or the logger, has refused."""

    counts: Annotated[
        dict[Reason, Annotated[int, Meta(ge=0, lt=2**53)]], Meta(description="reason -> how many, since it began")
    ]


class End(Message):
    """The last message of a run."""

    finished: Annotated[bool, Meta(description="the harvest is over")]
    why: Annotated[str, Meta(description="why the run ended: 'harvested', 'duration', 'stopped', or what is jammed")]
    hash: Annotated[str, Meta(description="SHA-256 over all ticks, hexadecimal")]
    summary: Annotated[dict[str, Any], Meta(description="the figures of the whole run")]
