"""A secured run for tests, and sessions that join it, each with the certificate of one role.

The sessions try what their role may do, and what it may not: drive a robot, join as its agent, ask.
"""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from local_runs import SMALL
from patience import PATIENCE

from orchard.contract.messages import pack
from orchard.field.geometry import Twist
from orchard.launch.request import agent_names, shares
from orchard.net.bus import Bus, Final, Replied, Sample
from orchard.net.zenoh_bus import client
from orchard.security.identity import Keyring, host_roles, make
from orchard.wire.keys import Keys
from orchard.wire.messages import (
    Angular,
    Join,
    Joined,
    Linear,
    Odometry,
    Report,
    Velocities,
    Velocity,
    read,
)

KEYS = Keys()
# The robot of the role amy, and that of the role ben.
MINE = "picker_01"
HERS = "picker_02"
# ROLE=AGENTS, as `orchard secure` takes them: `carrier` is all carriers.
WISHES = [f"amy={MINE}", f"ben={HERS},bin_01", "shed=carrier"]


def make_roles(path: Path, *addresses: str) -> Path:
    """Make roles for the small scenario, as `run.py secure` does.

    There are a role for each of two pickers, one for the carriers, and two for the rest.
    """
    make(
        path,
        host_roles(agent_names(SMALL), WISHES, lambda rest: shares(rest, 2)),
        list(addresses),
        days=30,
    )
    return path


class Somebody:
    """A session that joins a secured run with the certificate of one role."""

    def __init__(self, bus: Bus, run: str) -> None:
        self.bus = bus
        self.run = run

    def drive(self, name: str, tick: int) -> None:
        """Publish a velocity for a robot on the key of clients that are no agents."""
        self.bus.publish(
            KEYS.of("velocity", name), pack(Velocity(self.run, tick, Linear(1.0), Angular(0.0)))
        )

    def drive_as(self, session: str, owner: str, name: str, tick: int) -> None:
        """Publish a velocity as a host does: on a session's key, and with an owner in the message.

        Of an honest host both are its id.
        """
        velocities = Velocities(self.run, tick, owner, {name: Report(Twist(1.0))})
        self.bus.publish(KEYS.of("velocities", session=session), pack(velocities))

    def join(self, name: str) -> str:
        """Ask to own an agent. Return why that is refused, "" if it is not."""
        [reply] = self.asks("join", Join(self.run, self.bus.id, [name]), self.bus.id)
        return read(reply.payload, Joined).refused.get(name, "")

    def asks(self, what: str, message=None, session: str = "*") -> list[Replied]:
        """Ask on the key of a kind of message. Return all replies; none if access rules deny it."""
        self.bus.ask(
            KEYS.of(what, session=session), pack(message) if message else b"", what, PATIENCE
        )
        replies = []
        while not isinstance(item := self.wait(Replied | Final), Final):
            replies.append(item)
        return replies

    def wait(self, type_: type, wanted=lambda item: True):
        """Return the first item of a type that arrives and is wanted."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            item = self.bus.inbox.take(max(0.0, deadline - time.monotonic()))
            if isinstance(item, type_) and wanted(item):
                return item
        raise AssertionError(f"no {type_.__name__} came")

    def pose(self, name: str) -> Odometry:
        """Return the next published pose of a body."""
        return read(
            self.wait(Sample, lambda sample: sample.key == KEYS.of("pose", name)).payload, Odometry
        )

    def sees_it_move(self, name: str, driving) -> Odometry:
        """Return the next pose of a robot that has moved, while a session drives it.

        `driving`: called with the tick of each pose; it publishes a velocity for that tick.
        """
        deadline = time.monotonic() + PATIENCE
        first = self.pose(name)
        while (pose := self.pose(name)).pose == first.pose:
            assert time.monotonic() < deadline, f"{name} does not move"
            driving(pose.tick)
        return pose


class Farm:
    """A secured run, and the certificates of its roles."""

    # The fixture of the tests sets them: the process of physics, and a session of the role of it.
    physics: Any
    bus: Any

    def __init__(self, folder: Path, endpoint: str, run: str, stack: ExitStack) -> None:
        self.keyring = Keyring.load(folder)
        self.endpoint = endpoint
        self.run = run
        self._stack = stack

    def come(self, role: str) -> Somebody:
        """Open a session with the certificate of a role. It is closed after the test."""
        return Somebody(
            self._stack.enter_context(client(self.endpoint, identity=self.keyring.of(role))),
            self.run,
        )
