"""A run in many processes: start those here, follow and stop them; or host agents of a run elsewhere."""

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

STOP_SECONDS = 2.0  # that the processes may take to close their files and sessions after Ctrl-C
LOAD_SECONDS = 20.0  # the same before the first tick: physics may still load its modules
POLL_SECONDS = 0.02  # between two checks whether the processes have ended
THINK_SECONDS = 5.0  # that an agent may still think after a run has ended by itself
PACK_SECONDS = (
    60.0  # that the logger may take to pack its recording after a run has ended by itself
)
WEB_VIEWER = "web viewer"  # the name of its process
SERVING = 3  # processes beside the hosts: physics, the logger, and the web viewer
BEGIN_SECONDS = (
    60.0  # that physics may take to listen after this program has started it, on a busy machine
)
TRY_SECONDS = 0.7  # of one attempt to connect; between two, dead processes are restarted
LOOK_SECONDS = 5.0  # in which a router must answer at an endpoint that a user gave
HOW_PHYSICS_ENDED: dict[int | None, str] = {  # by exit code, without its last message
    BAD_ORDER: "physics could not start; its line above says why",
    0: "the run is over, and its result is lost: physics has ended, and its last message has not arrived",
}
RESULT = "end.msgpack"  # file: the last message of physics

Connect = Callable[
    [str, Inbox, float, Identity | None], AbstractContextManager[Bus]
]  # to an endpoint, within so many seconds


def run(request: RunRequest, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    """Run a whole harvest. Return its summary, None if there is none, and why it ended. Raises BusError."""
    credentials = Credentials(request.options)
    check_runtime()
    # A folder without the role of physics is told before what else it lacks.
    credentials.identity(PHYSICS)
    allow_processes(len(credentials.shares(*_hosted(request))) + SERVING)
    endpoint = _endpoint_of(request.options, credentials)
    inbox = Inbox()
    inbox.take_signals()  # Ctrl-C must not come between a process's start and its entry in the supervisor
    with Supervisor(progress.say, request.run_id) as supervisor:
        return LaunchedRun(request, credentials, endpoint, supervisor, progress).carry_out(inbox)


def _await_exits(supervisor: Supervisor, names: list[str], inbox: Inbox, seconds: float) -> None:
    """Wait until all processes have ended, at most `seconds`. After THINK_SECONDS kill `names`."""
    begun = supervisor.clock()
    while supervisor.is_any_left() and supervisor.clock() - begun < seconds:
        if isinstance(inbox.take(POLL_SECONDS), Signal):
            supervisor.stop(STOP_SECONDS)
        if supervisor.clock() - begun >= THINK_SECONDS:
            for name in [
                name
                for name in names
                if name in supervisor.running and supervisor.exit_code(name) is None
            ]:
                agents = ", ".join(supervisor.running[name].program.agents)
                its = f"; its agents: {agents}" if agents else ""
                supervisor.say(
                    f"{name} has not ended {THINK_SECONDS:g} s after the run, and is ended by force{its}"
                )
                supervisor.kill(name)


def _hosted(request: RunRequest) -> tuple[list[str], list[str]]:
    """Return the names of the agents that are hosted here, and of all agents of a run."""
    names = agent_names(request.scenario)
    return select_agents(names, [], request.options.without or []), names


def _endpoint_of(options: HarvestOptions, credentials: Credentials) -> str:
    if options.connect:
        with client(
            options.connect, seconds=LOOK_SECONDS, identity=credentials.identity("operator")
        ):
            return options.connect
    endpoints.check_loopback()
    endpoint = with_port(options.listen or (SECURE_LOOPBACK if credentials.keyring else LOOPBACK))
    check_security(endpoint, credentials.identity(PHYSICS) is not None)
    endpoints.check_free(endpoint)
    return endpoint


def how_to_join(options: HarvestOptions, endpoint: str) -> str:
    """Return how others join: the command for agents left to them, or the run's address; '' if none can."""
    there = from_elsewhere(endpoint)
    if options.without:
        only = [word for left in options.without for word in ("--only", left)]
        role = ["--secure", "DIR/ROLE"] if options.secure else []
        return f"{', '.join(options.without)}: left to other processes: {typed('--connect', there, *role, *only)}"
    return f"Other machines reach this run at {there}" if is_public(endpoint) else ""


def start_hosts(
    supervisor: Supervisor, endpoint: str, shares: Shares, credentials: Credentials
) -> None:
    checks, bag = credentials.options.check_agents, credentials.options.replay
    replay = None if bag is None else str(bag.resolve())
    for name, share in shares:
        order = HostOptions(
            connect=endpoint,
            secure=credentials.folder(name),
            only=[*share],
            check_agents=checks,
            replay=replay,
            from_first_stamp=credentials.options.from_first_stamp,
        )
        supervisor.start(
            ProcessSpec(name, "orchard.processes.agents", order, again=True, agents=share)
        )


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
        self.request, self.credentials, self.supervisor, self.progress = (
            request,
            credentials,
            supervisor,
            progress,
        )
        self.listen, self.endpoint, self.run_id = listen, reachable(listen), supervisor.run
        self.watchdog = Watchdog(supervisor, LOGGER)
        self._connect, self._clock = connect, supervisor.clock

    def carry_out(self, inbox: Inbox) -> tuple[dict[str, Any] | None, str]:
        """Start the processes, and follow the run until they have ended. Return as `run` does."""
        request, supervisor, say = self.request, self.supervisor, self.progress.say
        options = request.options
        shares = self.credentials.shares(*_hosted(request))
        with TemporaryDirectory() as folder, announced(request, self.run_id, self.endpoint, say):
            if not are_compiled():
                self.progress.get_ready(COMPILING)
            result = Path(folder) / RESULT
            viewer = self._start(result)
            start_hosts(supervisor, self.endpoint, shares, self.credentials)
            if join := how_to_join(options, self.listen):
                say(join)
            summary, why = self._ended(result, [name for name, _ in shares], *self.follow(inbox))
            if request.recording is not None:  # the recording is read next, and Rerun loads slowly
                threading.Thread(
                    target=import_module, args=("orchard.view.reader",), daemon=True
                ).start()
            supervisor.terminate(WEB_VIEWER)
            if summary is None:  # the other processes do not know that the run is over
                supervisor.stop(STOP_SECONDS)
            _await_exits(
                supervisor,
                [PHYSICS, *(name for name, _ in shares)],
                inbox,
                STOP_SECONDS if why == "stopped" else PACK_SECONDS,
            )
            let_go(viewer, why == "stopped", say)
            return summary, why

    def _ended(
        self, result: Path, hosts: list[str], summary: dict[str, Any] | None, why: str
    ) -> tuple[dict[str, Any] | None, str]:
        """Let the processes end whose run is over, and write its summary. Return what physics has written.

        `summary`, `why`: what has been heard, which any client may send; or None and why the run cannot go on.
        """
        end, supervisor = read_end(result, self.run_id), self.supervisor
        if summary is not None:
            self.watchdog.end()
            supervisor.terminate(*hosts)  # one that was still connecting has not received the end
        elif end is not None:
            supervisor.terminate(*supervisor.running)  # they have not received the end either
        if end is not None:
            summary, why = end.summary, end.why
        if summary is not None:
            summary["broken_agents"] += [
                f"{agent}, its process died again and again" for agent in supervisor.lost_agents
            ]
            if self.request.options.summary is not None:
                with suppress(
                    OSError
                ):  # `report` writes it all, but to pack the recording may take long
                    write_summary(self.request.options.summary, summary)
        return summary, why

    # -- its processes

    def _start(self, result: Path) -> subprocess.Popen[bytes] | None:
        request, given = self.request, self.request.options
        options = RunOptions(
            scenario=request.scenario.model_dump(),
            listen=None if given.connect else self.listen,
            connect=given.connect,
            secure=self.credentials.folder(PHYSICS),
            run=self.run_id,
            mode="realtime" if given.mode == "realtime" else "lockstep",
            speed=None if math.isinf(given.pace) else given.pace,
            duration=given.duration,
            holds=given.holds,
            patience=given.patience or PATIENCE,
            recorded=request.recording is not None or given.is_live,
            snapshots=str(request.snapshots.resolve()),
            keyframes=given.keyframes,
            without=given.without or [],
            table=None if given.table is None else str(given.table.resolve()),
            result=str(result),
            resume=request.resumed is not None,
        )
        again = msgspec.structs.replace(options, resume=True)
        physics = ProcessSpec(
            PHYSICS,
            "orchard.processes.physics",
            options,
            again=True,
            afterwards=again,
            may_refuse=False,
            result=result,
        )
        self.supervisor.start(physics)
        self._start_logger()
        if given.web is not None:
            from orchard.view.web import how_to_open

            self.supervisor.start(
                ProcessSpec(
                    WEB_VIEWER,
                    "orchard.view.web",
                    [request.uri, "--port", str(given.web)],
                    again=True,
                )
            )
            for line in how_to_open("Live", given.web, request.uri):
                self.supervisor.say(line)
        return open_viewer(request.uri) if given.view else None

    def _start_logger(self) -> None:
        request, is_live = self.request, self.request.options.is_live
        if request.recording is not None or is_live:
            order = LoggerOptions(
                connect=self.endpoint,
                secure=self.credentials.folder(LOGGER),
                record=None if request.recording is None else str(request.recording.resolve()),
                serve=request.data_port if is_live else None,
                session=self.run_id,
            )
            self.supervisor.start(
                ProcessSpec(LOGGER, "orchard.processes.logger", order, again=True)
            )

    # -- its progress

    def follow(self, inbox: Inbox) -> tuple[dict[str, Any] | None, str]:
        """Show the progress until the run is over. Return its summary, if any, and why it ended."""
        keys = Keys()
        try:
            with ExitStack() as stack:
                bus = self._reach(inbox, stack)
                if bus is None:
                    return None, "stopped"
                for what in ("figures", "end"):
                    bus.subscribe(keys.of(what))
                for token in (
                    keys.of("alive", LOGGER, self.run_id),
                    keys.of("physics", self.run_id),
                ):
                    bus.watch(token)
                return self._listen(bus, keys)
        except BusError as error:
            return None, str(error)

    def _reach(self, inbox: Inbox, stack: ExitStack) -> Bus | None:
        """A session with physics, once it listens; None after a second Ctrl-C. Dead processes are restarted.

        After the first Ctrl-C physics is asked to stop as soon as it listens: it gives the summary of a run without a tick.
        """
        deadline, identity, asked = (
            self._clock() + BEGIN_SECONDS,
            self.credentials.identity("operator"),
            None,
        )
        while True:
            try:
                bus = stack.enter_context(
                    self._connect(self.endpoint, inbox, TRY_SECONDS, identity)
                )
                if asked is not None:
                    inbox.put(asked)
                return bus
            except BusError as error:
                self.supervisor.watch()
                if asked is not None and self._clock() >= deadline:
                    return None
                if self._why_over(True):
                    raise
                if self._clock() >= deadline:
                    late = f"physics does not listen {BEGIN_SECONDS:g} s after its start; is the machine too busy?"
                    raise BusError(f"{self.endpoint}: {late}") from error
            if isinstance(item := inbox.take(0.0), Signal):
                if asked is not None:
                    return None
                asked, deadline = item, min(deadline, self._clock() + LOAD_SECONDS)

    def _listen(self, bus: Bus, keys: Keys) -> tuple[dict[str, Any] | None, str]:
        deadline, refusals, begun, ending = math.inf, Refusals(), False, Ending(self._clock)
        while self._clock() < deadline:
            item = bus.inbox.take(0.2)
            if isinstance(item, Signal):
                self.supervisor.terminate(PHYSICS)
                is_loading = not begun and deadline == math.inf
                deadline = min(
                    deadline, self._clock() + (LOAD_SECONDS if is_loading else STOP_SECONDS)
                )
            elif isinstance(item, Alive):
                if item.key == keys.of("alive", LOGGER, self.run_id):
                    self.watchdog.hear(item.up)
                else:
                    ending.track(item.key, item.up)
                    self.watchdog.hear_of_physics(ending.gone_at == math.inf)
            elif isinstance(item, Sample):
                try:
                    if (said := _hear(item, self.run_id, self.progress)) and said.why != RESET:
                        ending.hear(said)
                    begun = begun or said is None
                except Refused as refusal:
                    refusals.note(item.key, refusal)
            elif why := self._why_over(begun):
                return None, why
            if (end := ending.end) and (
                self.supervisor.exit_code(PHYSICS) is None or self.supervisor.is_over(PHYSICS)
            ):
                return end.summary, end.why
            self.watchdog.look()
            if deadline == math.inf:  # what ends after a request to stop is not restarted
                self.supervisor.watch()
            elif self.supervisor.exit_code(PHYSICS) is not None:
                deadline = min(deadline, self._clock() + STOP_SECONDS)
        return None, "stopped"

    def _why_over(self, begun: bool) -> str:
        """Why the run cannot go on; '' if it can. `begun`: whether all agents were there."""
        if self.supervisor.is_over(PHYSICS):
            code = self.supervisor.exit_code(PHYSICS)
            return HOW_PHYSICS_ENDED.get(code, f"physics ended with code {code}")
        if PHYSICS in self.supervisor.given_up:
            return f"physics died repeatedly; to go on: {typed('--resume', self.request.snapshots)}"
        if not begun and (missing := self.supervisor.lost_agents):
            return f"the run cannot begin without {', '.join(missing)}: the processes that hosted them died repeatedly"
        return ""


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
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
    """Host these agents of a run elsewhere until it ends. Return the exit code."""
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
            if isinstance(inbox.take(0.2), Signal):
                supervisor.stop(STOP_SECONDS)
                return 0
            if supervisor.has_refused():
                return BAD_ORDER
            supervisor.watch()
        return 1 if supervisor.given_up else 0
