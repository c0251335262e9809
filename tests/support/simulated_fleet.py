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

# s of virtual time that any one wait may take.
SECONDS = 200.0
# s that a process takes at most to load its modules: how much of that is drawn.
LOADING = 0.2


class PassingInbox(VirtualInbox):
    """An inbox that passes each item on as it arrives."""

    def __init__(self, scheduler: Scheduler, take: Callable[[Item], None]) -> None:
        super().__init__(scheduler)
        self._pass_on = take

    def put(self, item: Item) -> None:
        self._pass_on(item)

    def put_quietly(self, item: Item) -> None:
        """Pass an item on at once, too.

        In a real inbox it would wait there, and wake no reader. This inbox has no reader.
        """
        self._pass_on(item)


class SimulatedFleet(Fleet):
    """A fleet whose processes run as tasks of one scheduler."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        super().__init__(folder, stack)
        self.scheduler = Scheduler()
        # The schedules of faults in chaos/ let senders pause, to kill them between two messages.
        # These tests do not.
        self.network = Network(self.scheduler, "fleet", Delays(), pauses=0.0)
        # The processes, with their disk, and what they log and print.
        self.simulated_world = World(self.scheduler, self.network, Random("fleet"), folder)
        # How many processes were started.
        self._count = 0
        stack.callback(self._kill_all)

    def _kill_all(self) -> None:
        for process in self.simulated_world.processes.values():
            process.kill()

    def client(self) -> "Client":
        return Client(self)

    def start(self, module: str, *arguments: str, before: Sequence[str] = ()) -> "Process":
        assert not before, "no command comes before that of a simulated process"
        self._count += 1
        name = f"{module.rpartition('.')[2]}_{self._count}"
        process = SimulatedProcess(
            world=self.simulated_world,
            spec=ProcessSpec(name, module, arguments),
            order=arguments,
            pid=self._count,
            start_seconds=LOADING,
        )
        return Process(self, process)

    def wait(self, is_so: Callable[[], bool], seconds: float = SECONDS) -> bool:
        """Let virtual time pass until a condition holds, for at most so many seconds.

        Return whether it holds.
        """
        # In this context the world has what is printed and logged, in place of pytest. It ends with
        # the wait, because pytest changes sys.stdout between the phases of a test.
        with self.simulated_world.entered():
            self.scheduler.run(is_so, self.scheduler.now + seconds)
        return is_so()


class Process:
    """A simulated process, with the methods of `fleet.Process`."""

    def __init__(self, fleet: SimulatedFleet, process: SimulatedProcess) -> None:
        self._fleet = fleet
        self._process = process
        self.name = process.spec.name

    def line(self) -> str:
        return self._next(self._process.printed)

    def error(self) -> str:
        # As the log of a real process has it.
        name = self._process.spec.module.rpartition(".")[2]
        return f"{name}: {self._next(self._process.complaints)}"

    def _next(self, lines: list[str]) -> str:
        """Take the first of some lines, once there is one; return "" if the process has ended
        without.
        """
        says_or_ended = self._fleet.wait(lambda: bool(lines) or self._process.code is not None)
        assert says_or_ended, "the process says nothing"
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
    """A liveliness token, with the method of Zenoh's."""

    def __init__(self, bus: SimulatedBus, key: str) -> None:
        self._bus = bus
        self._key = key
        bus.declare_alive(key)

    def undeclare(self) -> None:
        self._bus.withdraw(self._key)


class Client(AnyClient):
    """A client on the simulated network, with the methods of `fleet.Client`."""

    def __init__(self, fleet: SimulatedFleet) -> None:
        self._fleet = fleet
        self.run = fleet.run
        self.bus = self._session(self._hear_reply)
        self._replies: list[Replied] = []
        self._is_final = False

    def _session(self, take: Callable[[Item], None]):
        """Open a session that passes on what it receives."""
        network = self._fleet.network
        name = f"client_{len(network.sessions)}"
        return network.open(name, PassingInbox(self._fleet.scheduler, take))

    def hear(self, key: str) -> Heard:
        heard = Heard(self._fleet)

        def take(item: Item) -> None:
            if isinstance(item, Sample):
                try:
                    heard.put(msgpack.unpackb(item.payload))
                except (ValueError, UnpackException):
                    # Some tests publish payloads that are no msgpack.
                    return

        self._session(take).subscribe(key)
        return heard

    def tokens(self, keys: str) -> Heard:
        heard = Heard(self._fleet)

        def take(item: Item) -> None:
            if isinstance(item, Alive):
                heard.put(item.up)

        self._session(take).watch(keys)
        return heard

    def declare(self, token: str) -> "Token":
        return Token(self.bus, token)

    def put(self, key: str, **message) -> None:
        self.bus.publish(key, self._of_run(**message))

    def ask(self, key: str, payload: bytes = b"") -> list:
        self._replies = []
        self._is_final = False
        # The bus gives up after 20 s of virtual time, before the wait of the test does.
        self.bus.ask(key, payload, None, 20.0)
        assert self._fleet.wait(lambda: self._is_final)
        return [reply.error or msgpack.unpackb(reply.payload) for reply in self._replies]

    def _hear_reply(self, item: Item) -> None:
        if isinstance(item, Replied):
            self._replies.append(item)
        self._is_final = self._is_final or isinstance(item, Final)
