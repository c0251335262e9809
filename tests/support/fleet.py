"""Real processes for tests: physics, hosts of agents, and a bare Zenoh client.

Every wait is bounded; nothing is left behind.
"""

import json
import os
import queue
import re
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import msgpack
import zenoh
from forked_processes import PATHS, Forked
from patience import PATIENCE

from orchard.field.scenario import Scenario, to_yaml
from orchard.wire.keys import Keys

ROOT = Path(__file__).parents[2]


class Process:
    """A process that runs a module. It is forked; with words before its command it is started."""

    def __init__(self, module: str, *arguments: str, before: Sequence[str] = ()) -> None:
        """`before`: words before its command, such as those that enter a network namespace."""
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(PATHS)}
        command = [*before, sys.executable, "-m", module, *arguments]
        if before:
            pipe = subprocess.PIPE
            self._popen = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=pipe, stderr=pipe, text=True
            )
        else:
            self._popen = Forked(module, arguments, environment)

    def line(self) -> str:
        """Return the next line of stdout, "" at its end."""
        return self._line(self._popen.stdout)

    def error(self) -> str:
        """Return the next line of stderr, "" at its end."""
        return self._line(self._popen.stderr)

    @staticmethod
    def _line(stream) -> str:
        """Read a line byte by byte.

        `readline` would take two lines at once from the pipe, and the selector would not see the
        second.
        """
        received = b""
        with selectors.DefaultSelector() as selector:
            selector.register(stream, selectors.EVENT_READ)
            while not received.endswith(b"\n"):
                assert selector.select(PATIENCE), f"the process printed only {received!r}"
                byte = os.read(stream.fileno(), 1)
                if not byte:
                    break
                received += byte
        return received.decode()

    def messages(self) -> queue.Queue:
        """Return a queue of what the process prints from now on: a map in a line each.

        `line` and `end` cannot be used any more.
        """
        messages = queue.Queue()

        def read() -> None:
            for line in self._popen.stdout:
                messages.put(json.loads(line))

        threading.Thread(target=read, daemon=True).start()
        return messages

    def end(self, seconds: float = PATIENCE) -> tuple[int, str, str]:
        """Wait until the process ends by itself. Return its exit code, stdout and stderr."""
        out, self.complaints = self._popen.communicate(timeout=seconds)
        return self._popen.returncode, out, self.complaints

    def signal(self, number: signal.Signals) -> None:
        self._popen.send_signal(number)

    def kill(self) -> None:
        if self._popen.poll() is None:
            self._popen.kill()
        # Another thread reads what it prints.
        with suppress(ValueError):
            self._popen.communicate()


class Fleet:
    """The processes of one run: physics, `world`, and the hosts of agents. They end with a test."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self.hosts: list[Process] = []

    def physics(self, scenario: Scenario, *arguments: str, before: Sequence[str] = ()) -> None:
        """Start physics. Its first line says where it listens, and the id of the run."""
        path = self._folder / "scenario.yaml"
        path.write_text(to_yaml(scenario))
        self.world = self.start("orchard.processes.physics", str(path), *arguments, before=before)
        line = self.world.line()
        match = re.match(r"(?:listening on|connected to) (\S+), prefix (\S+), run (\w+)", line)
        assert match, line + self.world.end()[2]
        self.endpoint, _, self.run = match.groups()

    def host(
        self,
        *arguments: str,
        agents: str = "orchard.behaviour.catalogue:make_agents",
        endpoint: str = "",
        before: Sequence[str] = (),
    ) -> Process:
        """Start a host. `endpoint`: where it finds the others, if not where physics says."""
        where = ("--connect", endpoint or self.endpoint)
        self.hosts.append(
            self.start(
                "orchard.processes.agents", *where, "--agents", agents, *arguments, before=before
            )
        )
        return self.hosts[-1]

    def share(self, hosts: int, agents: str = "orchard.behaviour.catalogue:make_agents") -> None:
        """Start so many hosts, which share the agents."""
        for i in range(hosts):
            self.host("--share", f"{i}/{hosts}", agents=agents)

    def end(self, seconds: float = PATIENCE) -> str:
        """Wait until physics and all hosts have ended well. Return the hash of the run."""
        code, out, err = self.world.end(seconds)
        assert code == 0, out + err
        for host in self.hosts:
            code, _, err = host.end()
            assert code == 0, err
        return re.search(r"hash (\w+)", out).group(1)

    def stop(self) -> None:
        """End the run, as run.py does when a person stops it; physics and all hosts end well."""
        self.world.signal(signal.SIGTERM)
        self.end()

    def client(self) -> "Client":
        return self._stack.enter_context(Client.open(self.endpoint, self.run))

    def router(self, endpoint: str, before: Sequence[str] = ()) -> Process:
        router = self.start("orchard.processes.router", "--listen", endpoint, before=before)
        assert "listening" in router.line()
        return router

    def start(self, module: str, *arguments: str, before: Sequence[str] = ()) -> Process:
        process = Process(module, *arguments, before=before)
        self._stack.callback(process.kill)
        return process

    def hear(self, key: str, endpoint: str, before: Sequence[str] = ()) -> queue.Queue:
        """Start a listener, on another machine if words come before. Return what it hears."""
        process = self.start("listener", endpoint, key, before=before)
        return process.messages()


class AnyClient:
    """A client on a real or a simulated network, which knows only msgpack and keyspace.md."""

    run: str
    keys = Keys()
    put: Callable[..., Any]
    ask: Callable[..., Any]

    def drive(self, name: str, tick: int, x: float, **message) -> None:
        """Publish a velocity of x m/s ahead for a robot. `message`: more fields."""
        self.put(
            self.keys.of("velocity", name),
            tick=tick,
            linear={"x": x},
            angular={"z": 0.0},
            **message,
        )

    def join(self, name: str, owner: str = "me") -> dict:
        """Return the reply to a session that wants to own an agent."""
        return self.ask(
            self.keys.of("join", session=owner), self._of_run(owner=owner, names=[name])
        )[0]

    def quit(self) -> dict:
        """End the run, as a person does."""
        return self.ask(self.keys.of("set_simulation_state"), self._of_run(state="quitting"))[0]

    def _of_run(self, **message) -> bytes:
        return msgpack.packb({"run": self.run} | message)


class Client(AnyClient):
    """A client over Zenoh, without the code of the Orchard."""

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self.session = session
        self.run = run

    @classmethod
    @contextmanager
    def open(cls, endpoint: str, run: str):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        with zenoh.open(config) as session:
            yield cls(session, run)

    def hear(self, key: str) -> queue.Queue:
        """Return a queue of the messages on a key, as maps."""
        messages = queue.Queue()

        def put(sample) -> None:
            # Some tests publish payloads that are no msgpack.
            with suppress(ValueError, msgpack.UnpackException):
                messages.put(msgpack.unpackb(sample.payload.to_bytes()))

        self.session.declare_subscriber(key, put)
        return messages

    def tokens(self, keys: str) -> queue.Queue:
        """Return a queue of changes of liveliness tokens: True if one came, False if it went."""
        changes = queue.Queue()
        self.session.liveliness().declare_subscriber(
            keys, lambda sample: changes.put(sample.kind == zenoh.SampleKind.PUT), history=True
        )
        return changes

    def declare(self, token: str):
        return self.session.liveliness().declare_token(token)

    def put(self, key: str, **message) -> None:
        self.session.put(
            key, self._of_run(**message), congestion_control=zenoh.CongestionControl.BLOCK
        )

    def ask(self, key: str, payload: bytes = b"") -> list:
        """Return all replies to a get: maps, or the texts of errors."""
        replies = list(
            self.session.get(
                key, payload=payload, timeout=PATIENCE, consolidation=zenoh.ConsolidationMode.NONE
            )
        )
        return [self._content_of(reply) for reply in replies]

    @staticmethod
    def _content_of(reply: zenoh.Reply) -> dict | str:
        if reply.ok:
            return msgpack.unpackb(reply.ok.payload.to_bytes())
        return reply.err.payload.to_string()


def wait_for(messages: queue.Queue, is_wanted, seconds: float = PATIENCE):
    """Return the first message that is wanted. Those before it are taken out, too."""
    deadline = time.monotonic() + seconds
    while True:
        message = messages.get(timeout=max(0.01, deadline - time.monotonic()))
        if is_wanted(message):
            return message


def assert_stands(poses, ticks: int = 20) -> dict:
    """Wait until a robot stands, and assert that it does not move for so many ticks.

    Poses that have come before do not count. Return its last pose.
    """
    for _ in range(poses.qsize()):
        poses.get()

    def stands(pose: dict) -> bool:
        twist = pose["twist"]
        return not any([*twist["linear"].values(), *twist["angular"].values()])

    first = wait_for(poses, stands)
    last = wait_for(
        poses, lambda pose: pose["pose"] != first["pose"] or pose["tick"] >= first["tick"] + ticks
    )
    assert last["pose"] == first["pose"]
    return last


def assert_goes_on(poses) -> None:
    """Assert that a robot moves from now on."""
    for _ in range(poses.qsize()):
        poses.get()
    standing = wait_for(poses, lambda pose: True)
    wait_for(poses, lambda pose: pose["pose"] != standing["pose"])
