"""A run in many processes: starts the processes on this machine, follows and stops them."""

import math
import subprocess
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from orchard.launch.follower import Result, RunFollower
from orchard.launch.hosts import (
    LOOK_SECONDS,
    STOP_SECONDS,
    await_exits,
    hosted,
    how_to_join,
    start_hosts,
)
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest
from orchard.launch.run_notes import announced
from orchard.launch.supervisor import (
    ProcessSpec,
    Supervisor,
    Watchdog,
    allow_processes,
    let_go,
    open_viewer,
)
from orchard.net import endpoints
from orchard.net.bus import Bus, Inbox
from orchard.net.ending import read_end
from orchard.net.endpoints import (
    LOOPBACK,
    SECURE_LOOPBACK,
    check_security,
    reachable,
    with_port,
)
from orchard.net.options import LoggerOptions
from orchard.net.zenoh_bus import check_runtime, client
from orchard.report.progress import Progress
from orchard.report.summary import write_summary
from orchard.security.identity import Identity
from orchard.server.options import PATIENCE, RunOptions
from orchard.sim.kernels.cache import COMPILING, are_compiled
from orchard.wire.keys import LOGGER, PHYSICS
from orchard.wire.messages import Mode

# s that the logger may take to pack its recording after a run has ended by itself.
PACK_SECONDS = 60.0
TRY_SECONDS = 0.7  # of one attempt to connect; between two, dead processes are restarted
WEB_VIEWER = "web viewer"  # the name of its process
SERVING = 3  # processes beside the hosts: physics, the logger, and the web viewer
RESULT = "end.msgpack"  # file: the last message of physics

# Opens a session at an endpoint, within so many seconds.
Connect = Callable[[str, Inbox, float, Identity | None], AbstractContextManager[Bus]]


def run(request: RunRequest, progress: Progress) -> Result:
    """Run a whole harvest. Return its summary, None without one, and why it ended.

    Raises BusError, OSError or ValueError.
    """
    credentials = Credentials(request.options)
    check_runtime()
    # This raises an error if the folder of a secured run lacks the role of physics. It comes first,
    # because a user who has chosen a wrong folder should read this error.
    credentials.identity(PHYSICS)
    allow_processes(len(credentials.shares(*hosted(request))) + SERVING)
    endpoint = _endpoint_of(request.options, credentials)
    inbox = Inbox()
    # Ctrl-C must not come between a process's start and its entry in the supervisor.
    inbox.take_signals()
    with Supervisor(progress.say, request.run_id) as supervisor:
        run = LaunchedRun(
            request, credentials, listen=endpoint, supervisor=supervisor, progress=progress
        )
        return run.carry_out(inbox)


def _endpoint_of(options: HarvestOptions, credentials: Credentials) -> str:
    """Return the endpoint of the run's router. Raises BusError if it cannot be had."""
    if options.connect:
        operator = credentials.identity("operator")
        with client(options.connect, seconds=LOOK_SECONDS, identity=operator):
            return options.connect
    endpoints.check_loopback()
    default = SECURE_LOOPBACK if credentials.keyring else LOOPBACK
    endpoint = with_port(options.listen or default)
    check_security(endpoint, credentials.identity(PHYSICS) is not None)
    endpoints.check_free(endpoint)
    return endpoint


def _full_path(path: Path | None) -> str | None:
    """Return a path as another process knows it; None for none."""
    if path is None:
        return None
    return str(path.resolve())


class LaunchedRun:
    """A run: this program starts its processes and follows them."""

    def __init__(
        self,
        request: RunRequest,
        credentials: Credentials,
        *,
        listen: str,
        supervisor: Supervisor,
        progress: Progress,
        connect: Connect = client,
    ) -> None:
        """`listen`: the endpoint of the run's router. `connect`: opens a session there.

        Tests pass another one.
        """
        self.request = request
        self.credentials = credentials
        self.supervisor = supervisor
        self.progress = progress
        self.listen = listen
        self.endpoint = reachable(listen)
        self.run_id = supervisor.run
        self.watchdog = Watchdog(supervisor, LOGGER)
        self._connect = connect
        self.follower = RunFollower(
            endpoint=self.endpoint,
            snapshots=request.snapshots,
            supervisor=supervisor,
            watchdog=self.watchdog,
            progress=progress,
            connect=self._try_to_connect,
        )

    def carry_out(self, inbox: Inbox) -> Result:
        """Start the processes, and follow the run until they have ended.

        Return the summary, None without one, and why the run ended.
        """
        request = self.request
        say = self.progress.say
        shares = self.credentials.shares(*hosted(request))
        hosts = [name for name, _ in shares]
        with TemporaryDirectory() as folder, announced(request, self.run_id, self.endpoint, say):
            if not are_compiled():
                self.progress.get_ready(COMPILING)
            file = Path(folder) / RESULT
            viewer = self._start(file)
            start_hosts(self.supervisor, self.endpoint, shares, self.credentials)
            invitation = how_to_join(request.options, self.listen)
            if invitation:
                say(invitation)
            heard = self.follow(inbox)
            summary, why = self._ended(file, hosts, heard)
            if request.recording is not None:
                self._load_reader()
            self.supervisor.terminate(WEB_VIEWER)
            if summary is None:
                # The other processes do not know that the run is over.
                self.supervisor.stop(STOP_SECONDS)
                if why == "stopped":
                    # On a busy machine physics has written its result only now.
                    summary, why = self._ended(file, hosts, (None, why))
            seconds = STOP_SECONDS if why == "stopped" else PACK_SECONDS
            await_exits(self.supervisor, [PHYSICS, *hosts], inbox, seconds)
            let_go(viewer, why == "stopped", say)
            return summary, why

    def _load_reader(self) -> None:
        """Load Rerun while the processes end: it is slow, and the recording is read next."""
        reader = "orchard.view.reader"
        threading.Thread(target=import_module, args=(reader,), daemon=True).start()

    def _ended(self, file: Path, hosts: list[str], heard: Result) -> Result:
        """Let the processes of a run that is over end, and write its summary.

        `heard`: the result that came over the bus; or no summary, and why the run cannot go on. Any
        client may send a result over the bus. So the one that counts is in `file`, if physics has
        written it. Return the result that counts.
        """
        summary, why = heard
        end = read_end(file, self.run_id)
        if summary is not None:
            # The end came over the bus, so other processes have received it too. They end by
            # themselves, but for a frozen logger, and for a host that was still connecting.
            self.watchdog.end()
            self.supervisor.terminate(*hosts)
        elif end is not None:
            # The end has not come over the bus, so no process has received it.
            self.supervisor.terminate(*self.supervisor.running)
        if end is not None:
            summary = end.summary
            why = end.why
        if summary is not None:
            self._complete(summary)
        return summary, why

    def _complete(self, summary: dict[str, Any]) -> None:
        """Add the lost agents to a summary, and write it: to pack the recording may take long."""
        for agent in self.supervisor.lost_agents:
            summary["broken_agents"].append(f"{agent}, its process died again and again")
        file = self.request.options.summary
        if file is not None:
            # `report` writes it again at the end, and reports a fault then.
            with suppress(OSError):
                write_summary(file, summary)

    # -- its processes

    def _start(self, file: Path) -> subprocess.Popen[bytes] | None:
        """Start physics, the logger and the viewers. Return the process of the viewer's window.

        `file`: in which physics writes its result.
        """
        self.supervisor.start(self._physics(file))
        self._start_logger()
        options = self.request.options
        if options.web is not None:
            self._serve_web(options.web)
        if options.view:
            return open_viewer(self.request.uri)
        return None

    def _physics(self, file: Path) -> ProcessSpec:
        """Return the process of physics. If it dies, it goes on from its newest snapshot."""
        request = self.request
        chosen = request.options
        listen: str | None = self.listen
        if chosen.connect:
            listen = None
        mode: Mode = "lockstep"
        if chosen.mode == "realtime":
            mode = "realtime"
        speed: float | None = chosen.pace
        if chosen.pace == math.inf:
            speed = None
        options = RunOptions(
            scenario=request.scenario.model_dump(),
            listen=listen,
            connect=chosen.connect,
            secure=self.credentials.folder(PHYSICS),
            run=self.run_id,
            mode=mode,
            speed=speed,
            duration=chosen.duration,
            holds=chosen.holds,
            patience=chosen.patience or PATIENCE,
            recorded=request.recording is not None or chosen.is_live,
            snapshots=str(request.snapshots.resolve()),
            keyframes=chosen.keyframes,
            without=chosen.without or [],
            table=_full_path(chosen.table),
            result=str(file),
            resume=request.resumed is not None,
        )
        return ProcessSpec(
            PHYSICS,
            "orchard.processes.physics",
            options,
            again=True,
            afterwards=msgspec.structs.replace(options, resume=True),
            may_refuse=False,
            result=file,
        )

    def _start_logger(self) -> None:
        """Start the logger, if the run is recorded or watched."""
        request = self.request
        is_live = request.options.is_live
        if request.recording is None and not is_live:
            return
        data_port = None
        if is_live:
            data_port = request.data_port
        order = LoggerOptions(
            connect=self.endpoint,
            secure=self.credentials.folder(LOGGER),
            record=_full_path(request.recording),
            serve=data_port,
            session=self.run_id,
        )
        self.supervisor.start(ProcessSpec(LOGGER, "orchard.processes.logger", order, again=True))

    def _serve_web(self, port: int) -> None:
        """Start the process that serves the viewer to browsers, and say how to open it."""
        # Rerun takes half a second to load.
        from orchard.view.web import how_to_open

        words = [self.request.uri, "--port", str(port)]
        self.supervisor.start(ProcessSpec(WEB_VIEWER, "orchard.view.web", words, again=True))
        for line in how_to_open("Live", port, self.request.uri):
            self.supervisor.say(line)

    # -- its progress

    def follow(self, inbox: Inbox) -> Result:
        """Show the progress until the run is over. Return its summary, if any, and why it ended."""
        return self.follower.follow(inbox)

    def _try_to_connect(self, inbox: Inbox) -> AbstractContextManager[Bus]:
        """Return a session at the endpoint. Raises BusError if none can be opened for now."""
        identity = self.credentials.identity("operator")
        return self._connect(self.endpoint, inbox, TRY_SECONDS, identity)
