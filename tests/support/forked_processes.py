"""Python processes that start fast: a server has imported what they need, and forks itself for
each.

Each is a process of its own, with its own Zenoh session, memory and signals; only its imports are
done already. Half of a test's processor time would be imports otherwise.

The process of the tests starts one server (`server`), and asks it by a socket. A request is a map
in JSON, with the descriptors that become the standard files of the new process. The server answers
[id, null] when it has forked, and [id, exit code] when that process has ended. Tests use `Forked`.
"""

import atexit
import gc
import io
import json
import os
import queue
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from patience import PATIENCE

# Each runs as a process; what they import is shared.
DOORS = (
    "orchard.processes.physics",
    "orchard.processes.agents",
    "orchard.processes.router",
)
# What run.py imports.
COMMAND_LINE = (
    "orchard.commands.main",
    "orchard.commands.asking",
    "orchard.commands.harvest",
    "orchard.launch.local_run",
    "orchard.launch.distributed",
    "orchard.study.study_command",
)
# Where the module stands in a command line of `orchard.start_module.command_for`: after Python, -P
# and the file.
PLACE_OF_MODULE = 3
ROOT = Path(__file__).parents[2]
PATHS = [str(ROOT), str(ROOT / "tests" / "support")]


class Forked:
    """A process that runs a module. Its methods are those of subprocess.Popen.

    `leads`: it has a session of its own, with stderr in stdout, as a command that is typed.
    `forks`: it is run.py, and what that starts, but for the logger, is forked, too.
    `stdin`: the descriptor from which it reads; 0: that of this process. Only what run.py starts
    has a descriptor of its own, and leads a group of processes.
    `folder`: where it runs.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: dict[str, str],
        leads: bool = False,
        forks: bool = False,
        stdin: int = 0,
        folder: Path = ROOT,
    ) -> None:
        self._module = module
        ends = [os.pipe() for _ in range(1 if leads else 2)]
        self.stdout = os.fdopen(ends[0][0])
        self.stderr = io.StringIO() if leads else os.fdopen(ends[1][0], errors="backslashreplace")
        self.returncode: int | None = None
        request = {
            "module": module,
            "arguments": arguments,
            "environment": environment,
            "leads": leads,
            "forks": forks,
            "folder": str(folder),
            # Only what run.py starts has a stdin of its own.
            "is_started_by_run_py": bool(stdin),
        }
        stdout_end = ends[0][1]
        stderr_end = ends[-1][1]
        self.pid, self._exit = server().fork(request, [stdout_end, stderr_end, stdin])
        for _, end in ends:
            os.close(end)

    def poll(self) -> int | None:
        with suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            try:
                self.returncode = self._exit.get(block=timeout != 0.0, timeout=timeout)
            except queue.Empty:
                raise subprocess.TimeoutExpired(self._module, timeout or 0.0) from None
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            # It has ended; its exit code is on its way.
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        if self.stdout.closed:
            raise ValueError("it was read to its end before")
        # Both files are read at once: a process whose pipe is full would wait for its reader.
        with self.stdout, self.stderr, ThreadPoolExecutor(2) as readers:
            out, err = (readers.submit(file.read) for file in (self.stdout, self.stderr))
            try:
                self.wait(timeout)
                return out.result(timeout), err.result(timeout)
            except (TimeoutError, subprocess.TimeoutExpired):
                # Otherwise its pipes stay open, and the readers never end.
                self.kill()
                raise


class ServerHandle:
    """What the tests, or run.py, have of a server: they ask it for processes, and hear when these
    end.
    """

    def __init__(self, own: socket.socket) -> None:
        """`own`: this end of the socket to the server."""
        self._socket = own
        # The id of the process that was asked for last.
        self._born: queue.Queue[int] = queue.Queue()
        # Id of a process -> where its exit code will be put.
        self._exits: dict[int, queue.Queue[int]] = {}
        # One thread asks at a time, so that it gets the id of its own process.
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, daemon=True).start()

    def fork(self, request: dict, files: Sequence[int]) -> tuple[int, "queue.Queue[int]"]:
        """Start a process.

        `files`: its stdout, stderr and stdin. Return its id, and a queue that will have its exit
        code.
        """
        with self._lock:
            socket.send_fds(self._socket, [json.dumps(request).encode()], files)
            pid = self._born.get(timeout=PATIENCE)
            return pid, self._exits[pid]

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)

    def _listen(self) -> None:
        while message := self._socket.recv(1 << 16):
            pid, code = json.loads(message)
            if code is None:
                self._exits[pid] = queue.Queue()
                self._born.put(pid)
            else:
                self._exits.pop(pid).put(code)


def linked() -> tuple[socket.socket, socket.socket]:
    """Return both ends of a socket that keeps messages whole, and can send descriptors."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


@cache
def server() -> ServerHandle:
    """Return the server of this process. It ends with the tests."""
    own, other = linked()
    # Rich reads its width when it is imported.
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(PATHS),
        "COLUMNS": "200",
    }
    command = [sys.executable, "-m", "forked_processes", str(other.fileno())]
    process = subprocess.Popen(command, cwd=ROOT, env=environment, pass_fds=[other.fileno()])
    other.close()
    handle = ServerHandle(own)
    # What is registered last happens first: it is told to end, and then waited for.
    atexit.register(process.wait, 10.0)
    atexit.register(handle.close)
    return handle


# -- in the server


def serve(tests: socket.socket) -> dict | None:
    """Fork for each request until the tests are over.

    It returns twice, as `os.fork` does: in each forked process it returns the request that this is
    to carry out, and in the server None at the end.
    """
    # The end of a child process is a signal. Python writes a byte into this pipe for each signal,
    # so `select` wakes for it.
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        ready, _, _ = select.select([tests, woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
            report_ends(tests)
        if tests in ready:
            message, files, _, _ = socket.recv_fds(tests, 1 << 20, 3)
            if not message:
                return None
            if not (pid := os.fork()):
                become(files)
                return json.loads(message)
            tests.send(json.dumps([pid, None]).encode())
            for file in files:
                os.close(file)


def report_ends(tests: socket.socket) -> None:
    """Tell the tests the exit code of each child process that has ended since."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG)) != (0, 0):
            tests.send(json.dumps([ended[0], os.waitstatus_to_exitcode(ended[1])]).encode())


def become(files: Sequence[int]) -> None:
    """Turn a fork of the server into a process like any other, with these files as stdout, stderr
    and stdin.
    """
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for file, number in zip(files, (1, 2, 0), strict=True):
        os.dup2(file, number)
    os.closerange(3, 1024)
    sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)


def preload() -> None:
    """Import what the processes import, and load the kernels.

    No process visits these objects when it collects cycles. Each visit would copy their memory, and
    at an end all of it, which takes 0.3 s.
    """
    for module in (*DOORS, *COMMAND_LINE):
        # A package of some commands may be left out.
        if find_spec(module.rpartition(".")[0]) is not None:
            __import__(module)
    for door in DOORS:
        # Each process runs its own.
        del sys.modules[door]
    from orchard.field.scenario import Scenario
    from orchard.sim.engine import Engine

    Engine.begin(Scenario(rows=3)).rehearse()
    gc.collect()
    gc.freeze()


def begin(request: dict) -> None:
    """Run the module of a request in this process."""
    if request["forks"]:
        own, other = linked()
        # run.py will have threads, and forks with threads are unsafe. So it gets a server of its
        # own now, which has none: a fork of this process.
        if not os.fork():
            own.close()
            # In each process that this server forks, `serve` returns what that is to run.
            if (order := serve(other)) is not None:
                begin(order)
            return
        other.close()
        let_supervisor_fork(own)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    if request["leads"]:
        os.setsid()
    elif request["is_started_by_run_py"]:
        # As the supervisor starts it: in a group of its own, and without stdout.
        os.setpgrp()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.argv = [request["module"], *request["arguments"]]
    runpy.run_module(request["module"], run_name="__main__", alter_sys=True)


def let_supervisor_fork(own: socket.socket) -> None:
    """Let run.py fork the doors that it starts, from a server without threads.

    Only the logger starts as for a user.
    """
    from orchard.launch import supervisor

    global server  # noqa: PLW0603 - a process has one server, which its supervisor asks for
    server = cache(lambda: ServerHandle(own))

    def start(command: Sequence[str], **how: Any) -> Any:
        module = ""
        if len(command) > PLACE_OF_MODULE:
            module = command[PLACE_OF_MODULE]
        if module not in DOORS:
            return subprocess.Popen(command, **how)
        arguments = command[PLACE_OF_MODULE + 1 :]
        return Forked(module, arguments, how["env"], stdin=how["stdin"], folder=Path.cwd())

    supervisor.subprocess = SimpleNamespace(  # type: ignore[attr-defined]
        **vars(subprocess) | {"Popen": start}
    )


if __name__ == "__main__":
    preload()
    request = serve(socket.socket(fileno=int(sys.argv[1])))
    if request is not None:
        begin(request)
