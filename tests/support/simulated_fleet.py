"""Physics and hosts as `fleet.Fleet` has them, on a simulated network: no process is started, and
no time passes while they wait.
"""

import queue
import signal
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from random import Random

import msgpack
from fleet import AnyClient, Fleet
from msgpack import UnpackException

from chaos.simulated.link import Delays
from chaos.simulated.network import Network
from chaos.simulated.processes import SimulatedProcess, World
from chaos.simulated.scheduler import Scheduler, VirtualInbox
from chaos.simulated.session import SimulatedBus
from orchard.launch.supervisor import ProcessSpec
from orchard.net.bus import Alive, Final, Item, Replied, Sample, Signal

# Of virtual time that any one wait may take.
SECONDS = 200.0


class PassingInbox(VirtualInbox):
    """An inbox that passes each item on as it arrives."""

    def __init__(self, scheduler: Scheduler, take: Callable[[Item], None]) -> None:
        super().__init__(scheduler)
        self._pass_on = take

    def put(self, item: Item) -> None:
        self._pass_on(item)

    put_quietly = put


class SimulatedFleet(Fleet):
    def __init__(self, folder: Path, stack: ExitStack) -> None:
        super().__init__(folder, stack)
        self.scheduler = Scheduler()
        self.network = Network(self.scheduler, "fleet", Delays())
        self.all = World(self.scheduler, self.network, Random("fleet"), folder)
        self._count = 0
        stack.callback(self._kill_all)

    def _kill_all(self) -> None:
        for process in self.all.processes.values():
            process.kill()

    def client(self) -> "Client":
        return Client(self)

    def start(self, module: str, *arguments: str, before: Sequence[str] = ()) -> "Process":
        assert not before
        self._count += 1
        name = f"{module.rpartition('.')[2]}_{self._count}"
        return Process(
            self,
            SimulatedProcess(
                self.all, ProcessSpec(name, module, arguments), arguments, self._count, 0.2
            ),
        )

    def wait(self, is_so: Callable[[], bool], seconds: float = SECONDS) -> bool:
        """Let virtual time pass until a condition holds, for at most so many seconds.

        Return whether it holds.
        """
        with (
            self.all.entered()
        ):  # not for longer: pytest has an output of its own for each phase of a test
            self.scheduler.run(is_so, self.scheduler.now + seconds)
        return is_so()


class Process:
    def __init__(self, fleet: SimulatedFleet, process: SimulatedProcess) -> None:
        self._fleet = fleet
        self._process = process
        self.name = process.spec.name

    def line(self) -> str:
        return self._next(self._process.printed)

    def error(self) -> str:
        return (
            f"{self._process.spec.module.rpartition('.')[2]}:"
            f" {self._next(self._process.complaints)}"
        )

    def _next(self, lines: list[str]) -> str:
        assert self._fleet.wait(lambda: bool(lines) or self._process.code is not None), (
            "the process says nothing"
        )
        return f"{lines.pop(0)}\n" if lines else ""

    @property
    def complaints(self) -> str:
        return "\n".join(self._process.complaints)

    def end(self, seconds: float = SECONDS) -> tuple[int, str, str]:
        assert self._fleet.wait(lambda: self._process.code is not None, seconds), (
            "the process does not end"
        )
        return self._process.code, "\n".join(self._process.printed), self.complaints

    def signal(self, number: signal.Signals) -> None:
        match number:
            case signal.SIGKILL:
                self._process.kill()
            case signal.SIGSTOP:
                self._process.freeze()
            case signal.SIGCONT:
                self._process.thaw()
            case _:
                self._process.inbox.put(Signal(number))

    def kill(self) -> None:
        self._process.kill()


class Heard:
    """A queue of what a client has received, with the methods of `queue.Queue` in virtual time."""

    def __init__(self, fleet: SimulatedFleet) -> None:
        self._fleet = fleet
        self._messages = deque()

    def put(self, message) -> None:
        self._messages.append(message)

    def get(self, timeout: float = SECONDS):
        if not self._fleet.wait(lambda: bool(self._messages), timeout):
            raise queue.Empty
        return self._messages.popleft()

    def qsize(self) -> int:
        return len(self._messages)

    def empty(self) -> bool:
        return not self._messages


class Token:
    def __init__(self, bus: SimulatedBus, key: str) -> None:
        self._bus = bus
        self._key = key
        bus.declare_alive(key)

    def undeclare(self) -> None:
        self._bus.withdraw(self._key)


class Client(AnyClient):
    def __init__(self, fleet: SimulatedFleet) -> None:
        self._fleet = fleet
        self.run = fleet.run
        self.bus = self._session(self._hear_reply)
        self._replies: list[Replied] = []
        self._is_final = False

    def _session(self, take: Callable[[Item], None]):
        self._fleet.network.pauses = 0.0
        return self._fleet.network.open(
            f"client_{len(self._fleet.network.sessions)}", PassingInbox(self._fleet.scheduler, take)
        )

    def hear(self, key: str) -> Heard:
        heard = Heard(self._fleet)

        def take(item: Item) -> None:
            if isinstance(item, Sample):
                try:
                    heard.put(msgpack.unpackb(item.payload))
                except (ValueError, UnpackException):
                    # Of tests that put nonsense.
                    return

        self._session(take).subscribe(key)
        return heard

    def tokens(self, keys: str) -> Heard:
        heard = Heard(self._fleet)
        self._session(lambda item: heard.put(item.up) if isinstance(item, Alive) else None).watch(
            keys
        )
        return heard

    def declare(self, token: str) -> "Token":
        return Token(self.bus, token)

    def put(self, key: str, **message) -> None:
        self.bus.publish(key, self._of_run(**message))

    def ask(self, key: str, payload: bytes = b"") -> list:
        self._replies = []
        self._is_final = False
        self.bus.ask(key, payload, None, 20.0)
        assert self._fleet.wait(lambda: self._is_final)
        return [reply.error or msgpack.unpackb(reply.payload) for reply in self._replies]

    def _hear_reply(self, item: Item) -> None:
        if isinstance(item, Replied):
            self._replies.append(item)
        self._is_final = self._is_final or isinstance(item, Final)
