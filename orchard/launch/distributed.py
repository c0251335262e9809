"""A run in many processes: start those here, follow and stop them.

Or host agents of a run elsewhere.
"""

import math
import subprocess
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from orchard.field.kinds import select_agents
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest, Shares, agent_names
from orchard.launch.run_notes import announced
from orchard.launch.supervisor import (
    BAD_ORDER,
    ProcessSpec,
    Supervisor,
    Watchdog,
    allow_processes,
    let_go,
    open_viewer,
)
from orchard.net import endpoints
from orchard.net.bus import Alive, Bus, Inbox, Sample, Signal
from orchard.net.ending import Ending, read_end
from orchard.net.endpoints import (
    LOOPBACK,
    SECURE_LOOPBACK,
    BusError,
    check_security,
    from_elsewhere,
    is_public,
    reachable,
    with_port,
)
from orchard.net.options import HostOptions, LoggerOptions
from orchard.net.refusals import Refusals, Refused, read_message, refused_for
from orchard.net.requests import fetch_run
from orchard.net.zenoh_bus import check_runtime, client
from orchard.report.progress import Progress
from orchard.report.summary import Outcome, headline_of, write_summary
from orchard.security.identity import Identity
from orchard.server.options import PATIENCE, RunOptions
from orchard.sim.kernels.cache import COMPILING, are_compiled
from orchard.terminal.typed import typed
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import RESET, End, Figures

STOP_SECONDS = 2.0  # that the processes may take to close their files after Ctrl-C
LOAD_SECONDS = 20.0  # the same before the first tick: physics may still load its modules
POLL_SECONDS = 0.02  # between two checks whether the processes have ended
POLL_BUS_SECONDS = 0.2  # between two looks at the processes while nothing comes from the bus
THINK_SECONDS = 5.0  # that an agent may still think after a run has ended by itself
PACK_SECONDS = 60.0  # that the logger may take to pack its recording after such an end
BEGIN_SECONDS = 60.0  # that physics may take to listen after its start, on a busy machine
TRY_SECONDS = 0.7  # of one attempt to connect; between two, dead processes are restarted
LOOK_SECONDS = 5.0  # in which a router must answer at an endpoint that a user gave
WEB_VIEWER = "web viewer"  # the name of its process
SERVING = 3  # processes beside the hosts: physics, the logger, and the web viewer
# Exit code of physics -> what has happened, if its last message is not there.
HOW_PHYSICS_ENDED: dict[int | None, str] = {
    BAD_ORDER: "physics could not start; its line above says why",
    0: (
        "the run is over, and its result is lost: physics has ended, "
        "and its last message has not arrived"
    ),
}
RESULT = "end.msgpack"  # file: the last message of physics

# Opens a session at an endpoint, within so many seconds.
Connect = Callable[[str, Inbox, float, Identity | None], AbstractContextManager[Bus]]
Result = tuple[dict[str, Any] | None, str]  # the summary, if any, and why the run ended


def run(request: RunRequest, progress: Progress) -> Result:
    """Run a whole harvest. Return its summary, None without one, and why it ended.

    Raises BusError, OSError or ValueError.
    """
    credentials = Credentials(request.options)
    check_runtime()
    # A folder without the role of physics is told before what else it lacks.
    credentials.identity(PHYSICS)
    allow_processes(len(credentials.shares(*_hosted(request))) + SERVING)
    endpoint = _endpoint_of(request.options, credentials)
    inbox = Inbox()
    # Ctrl-C must not come between a process's start and its entry in the supervisor.
    inbox.take_signals()
    with Supervisor(progress.say, request.run_id) as supervisor:
        return LaunchedRun(request, credentials, endpoint, supervisor, progress).carry_out(inbox)


def _await_exits(supervisor: Supervisor, names: list[str], inbox: Inbox, seconds: float) -> None:
    """Wait until all processes have ended, at most `seconds`. After THINK_SECONDS kill `names`."""
    begin = supervisor.clock()
    waited = 0.0
    while supervisor.is_any_left() and waited < seconds:
        if isinstance(inbox.take(POLL_SECONDS), Signal):
            supervisor.stop(STOP_SECONDS)
        waited = supervisor.clock() - begin
        if waited >= THINK_SECONDS:
            _kill_running(supervisor, names)


def _kill_running(supervisor: Supervisor, names: list[str]) -> None:
    """Kill those of some processes that still run, and say so."""
    for name in names:
        if not supervisor.is_running(name):
            continue
        agents = ", ".join(supervisor.running[name].program.agents)
        hosted = f"; its agents: {agents}" if agents else ""
        supervisor.say(
            f"{name} has not ended {THINK_SECONDS:g} s after the run, and is ended by force{hosted}"
        )
        supervisor.kill(name)


def _hosted(request: RunRequest) -> tuple[list[str], list[str]]:
    """Return the names of the agents that are hosted here, and of all agents of a run."""
    names = agent_names(request.scenario)
    return select_agents(names, [], request.options.without or []), names


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


def how_to_join(options: HarvestOptions, endpoint: str) -> str:
    """Return how others join; "" if none can.

    It is the command for agents that are left to them, or the address of the run.
    """
    there = from_elsewhere(endpoint)
    if options.without:
        command: list[str] = ["--connect", there]
        if options.secure:
            command += ["--secure", "DIR/ROLE"]
        for agents in options.without:
            command += ["--only", agents]
        return f"{', '.join(options.without)}: left to other processes: {typed(*command)}"
    return f"Other machines reach this run at {there}" if is_public(endpoint) else ""


def start_hosts(
    supervisor: Supervisor, endpoint: str, shares: Shares, credentials: Credentials
) -> None:
    """Start the processes that host agents. `shares`: name of a process -> its agents."""
    options = credentials.options
    for name, agents in shares:
        order = HostOptions(
            connect=endpoint,
            secure=credentials.folder(name),
            only=list(agents),
            check_agents=options.check_agents,
            replay=None if options.replay is None else str(options.replay.resolve()),
            from_first_stamp=options.from_first_stamp,
        )
        supervisor.start(
            ProcessSpec(name, "orchard.processes.agents", order, again=True, agents=agents)
        )


class _Following:
    """What is known of a run that is followed."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.ending = Ending(clock)
        self.refusals = Refusals()
        self.has_begun = False  # all agents were there, and figures have come
        self.deadline = math.inf  # s, on the clock, until which the processes may end

    @property
    def is_stopping(self) -> bool:
        """Whether the processes are asked to end."""
        return self.deadline < math.inf

    @property
    def is_late(self) -> bool:
        """Whether the processes had their time to end."""
        return self._clock() >= self.deadline

    def end_within(self, seconds: float) -> None:
        """Give the processes at most some seconds more."""
        self.deadline = min(self.deadline, self._clock() + seconds)


class LaunchedRun:
    """A run: this program starts its processes and follows them."""

    def __init__(
        self,
        request: RunRequest,
        credentials: Credentials,
        listen: str,
        supervisor: Supervisor,
        progress: Progress,
        connect: Connect = client,
    ) -> None:
        """`listen`: the endpoint of the run's router. `connect`: opens a session there."""
        self.request = request
        self.credentials = credentials
        self.supervisor = supervisor
        self.progress = progress
        self.listen = listen
        self.endpoint = reachable(listen)
        self.run_id = supervisor.run
        self.watchdog = Watchdog(supervisor, LOGGER)
        self._connect = connect
        self._clock = supervisor.clock

    def carry_out(self, inbox: Inbox) -> Result:
        """Start the processes, and follow the run until they have ended. Return as `run` does."""
        request = self.request
        say = self.progress.say
        shares = self.credentials.shares(*_hosted(request))
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
            seconds = STOP_SECONDS if why == "stopped" else PACK_SECONDS
            _await_exits(self.supervisor, [PHYSICS, *hosts], inbox, seconds)
            let_go(viewer, why == "stopped", say)
            return summary, why

    def _load_reader(self) -> None:
        """Load Rerun, which is slow, while the processes end: the recording is read next."""
        reader = "orchard.view.reader"
        threading.Thread(target=import_module, args=(reader,), daemon=True).start()

    def _ended(self, file: Path, hosts: list[str], heard: Result) -> Result:
        """Let the processes end whose run is over, and write its summary.

        `file`: in which physics writes its result, which is the one that counts. `heard`: what the
        bus told, which any client may send; or None, and why the run cannot go on.
        """
        summary, why = heard
        end = read_end(file, self.run_id)
        if summary is not None:
            self.watchdog.end()
            # A host that was still connecting has not received the end.
            self.supervisor.terminate(*hosts)
        elif end is not None:
            # No process has received the end.
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
            # What cannot be written is told when the summary is complete.
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
        return open_viewer(self.request.uri) if options.view else None

    def _physics(self, file: Path) -> ProcessSpec:
        """Return the process of physics. If it dies, it goes on from its newest snapshot."""
        request = self.request
        chosen = request.options
        options = RunOptions(
            scenario=request.scenario.model_dump(),
            listen=None if chosen.connect else self.listen,
            connect=chosen.connect,
            secure=self.credentials.folder(PHYSICS),
            run=self.run_id,
            mode="realtime" if chosen.mode == "realtime" else "lockstep",
            speed=None if math.isinf(chosen.pace) else chosen.pace,
            duration=chosen.duration,
            holds=chosen.holds,
            patience=chosen.patience or PATIENCE,
            recorded=request.recording is not None or chosen.is_live,
            snapshots=str(request.snapshots.resolve()),
            keyframes=chosen.keyframes,
            without=chosen.without or [],
            table=None if chosen.table is None else str(chosen.table.resolve()),
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
        order = LoggerOptions(
            connect=self.endpoint,
            secure=self.credentials.folder(LOGGER),
            record=None if request.recording is None else str(request.recording.resolve()),
            serve=request.data_port if is_live else None,
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
        keys = Keys()
        try:
            with ExitStack() as stack:
                bus = self._reach(inbox, stack)
                if bus is None:
                    return None, "stopped"
                bus.subscribe(keys.of("figures"))
                bus.subscribe(keys.of("end"))
                bus.watch(keys.of("alive", LOGGER, self.run_id))
                bus.watch(keys.of("physics", self.run_id))
                return self._listen(bus, keys)
        except BusError as error:
            return None, str(error)

    def _reach(self, inbox: Inbox, stack: ExitStack) -> Bus | None:
        """Return a session with physics, once it listens; None after a second Ctrl-C.

        Dead processes are restarted. After the first Ctrl-C physics is asked to stop as soon as it
        listens: it gives the summary of a run without a tick. `stack`: closes the session. Raises
        BusError if physics does not listen.
        """
        deadline = self._clock() + BEGIN_SECONDS
        signal: Signal | None = None
        while True:
            try:
                bus = stack.enter_context(self._try_to_connect(inbox))
            except BusError as error:
                self.supervisor.watch()
                if signal is not None and self._clock() >= deadline:
                    return None
                self._check_may_listen(deadline, error)
            else:
                if signal is not None:
                    inbox.put(signal)
                return bus
            item = inbox.take(0.0)
            if not isinstance(item, Signal):
                continue
            if signal is not None:
                return None
            signal = item
            deadline = min(deadline, self._clock() + LOAD_SECONDS)

    def _check_may_listen(self, deadline: float, error: BusError) -> None:
        """Raise BusError if physics will not listen any more, or does not by a deadline.

        `error`: of the last attempt to connect.
        """
        if self._why_over(has_begun=True):
            raise error
        if self._clock() >= deadline:
            raise BusError(
                f"{self.endpoint}: physics does not listen {BEGIN_SECONDS:g} s after its start; "
                "is the machine too busy?"
            ) from error

    def _try_to_connect(self, inbox: Inbox) -> AbstractContextManager[Bus]:
        """Return a session at the endpoint. Raises BusError if none can be opened for now."""
        identity = self.credentials.identity("operator")
        return self._connect(self.endpoint, inbox, TRY_SECONDS, identity)

    def _listen(self, bus: Bus, keys: Keys) -> Result:
        """Hear the run until it is over. Return its summary, if any, and why it ended.

        After a signal the processes have some seconds to end, and are not restarted.
        """
        state = _Following(self._clock)
        of_logger = keys.of("alive", LOGGER, self.run_id)
        while not state.is_late:
            match bus.inbox.take(POLL_BUS_SECONDS):
                case Signal():
                    self._stop_soon(state)
                case Alive() as token if token.key == of_logger:
                    self.watchdog.hear(token.up)
                case Alive() as token:
                    state.ending.track(token.key, token.up)
                    self.watchdog.hear_of_physics(up=state.ending.gone_at == math.inf)
                case Sample() as sample:
                    self._hear_sample(state, sample)
                case _:
                    why = self._why_over(state.has_begun)
                    if why:
                        return None, why
            end = state.ending.end
            if end is not None and self._may_believe_end():
                return end.summary, end.why
            self.watchdog.look()
            self._look_after_processes(state)
        return None, "stopped"

    def _stop_soon(self, state: _Following) -> None:
        """Ask physics to end the run. It has longer while it may still load its modules."""
        self.supervisor.terminate(PHYSICS)
        is_loading = not state.has_begun and not state.is_stopping
        state.end_within(LOAD_SECONDS if is_loading else STOP_SECONDS)

    def _hear_sample(self, state: _Following, sample: Sample) -> None:
        """Take figures or an end from the bus. What cannot be read is refused, and noted."""
        try:
            end = _hear(sample, self.run_id, self.progress)
        except Refused as refusal:
            state.refusals.note(sample.key, refusal)
            return
        if end is None:
            state.has_begun = True
        elif end.why != RESET:
            state.ending.hear(end)

    def _may_believe_end(self) -> bool:
        """Whether an end that the bus told can be that of physics, which may have died since."""
        return self.supervisor.exit_code(PHYSICS) is None or self.supervisor.is_over(PHYSICS)

    def _look_after_processes(self, state: _Following) -> None:
        """Restart what has died. What ends after a request to stop is not restarted."""
        if not state.is_stopping:
            self.supervisor.watch()
        elif self.supervisor.exit_code(PHYSICS) is not None:
            state.end_within(STOP_SECONDS)

    def _why_over(self, has_begun: bool) -> str:
        """Return why the run cannot go on; "" if it can. `has_begun`: all agents were there."""
        if self.supervisor.is_over(PHYSICS):
            code = self.supervisor.exit_code(PHYSICS)
            return HOW_PHYSICS_ENDED.get(code, f"physics ended with code {code}")
        if PHYSICS in self.supervisor.given_up:
            return f"physics died repeatedly; to go on: {typed('--resume', self.request.snapshots)}"
        if has_begun:
            return ""
        lost = self.supervisor.lost_agents
        if lost:
            return (
                f"the run cannot begin without {', '.join(lost)}: "
                "the processes that hosted them died repeatedly"
            )
        return ""


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
    """Return the end of a run that a sample tells; None of figures, which are shown.

    Raises Refused for what cannot be read.
    """
    with refused_for("malformed"):
        if sample.key.endswith("/end"):
            end = read_message(sample.payload, End, run_id)
            msgspec.convert(end.summary, Outcome)
            return end
        message = read_message(sample.payload, Figures, run_id)
        headline_of(message.figures)
    progress.show(message.figures, message.doing, message.waits_for)
    return None


# -- agents of a run elsewhere


def join_run(
    endpoint: str, only: list[str], without: list[str], credentials: Credentials, progress: Progress
) -> int:
    """Host these agents of a run elsewhere until it ends. Return the exit code.

    `only`, `without`: names or kinds of agents. Raises BusError or ValueError.
    """
    with client(endpoint, seconds=LOOK_SECONDS, identity=credentials.only_identity()) as bus:
        all_names = fetch_run(bus, Keys()).agents
    names = select_agents(all_names, only, without)
    shares = credentials.shares(names, all_names)
    allow_processes(len(shares))
    inbox = Inbox()
    inbox.take_signals()
    with Supervisor(progress.say) as supervisor:
        start_hosts(supervisor, endpoint, shares, credentials)
        progress.say(f"hosting {', '.join(names)} at {endpoint}")
        while not all(map(supervisor.is_over, supervisor.running)):
            if isinstance(inbox.take(POLL_BUS_SECONDS), Signal):
                supervisor.stop(STOP_SECONDS)
                return 0
            if supervisor.has_refused():
                return BAD_ORDER
            supervisor.watch()
        return 1 if supervisor.given_up else 0
