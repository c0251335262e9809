"""A run in many processes: start the processes of this machine, follow the run, and stop them; or host agents of a run elsewhere."""

import math
import signal
import subprocess
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from orchard.field.kinds import select_agents
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.emergency_stop import RunNote, noted
from orchard.launch.request import Credentials, OpenRun, RunRequest, SecuredRun, Shares, credentials_of
from orchard.launch.supervisor import ProcessSpec, Supervisor, Watchdog, free_port, open_viewer
from orchard.net.bus import Alive, Bus, Inbox, Sample, Signal, client
from orchard.net.endpoints import BusError, check_free, check_security, reachable, with_port
from orchard.net.refusals import Refusals, Refused, read_message
from orchard.net.requests import fetch_run
from orchard.report.progress import Headline, Progress
from orchard.report.summary import Outcome
from orchard.security.identity import Identity
from orchard.server.harvest import RunOptions, read_end
from orchard.sim.kernels.cache import COMPILING, are_compiled
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import End, Figures

STOP_SECONDS = 2.0  # that the processes may take to close their files and sessions after Ctrl-C
POLL_SECONDS = 0.02  # between two checks whether the processes have ended
THINK_SECONDS = 5.0  # that an agent may still think after a run has ended by itself
PACK_SECONDS = 60.0  # that the logger may take to pack its recording after a run has ended by itself
WEB_VIEWER = "web viewer"  # the name of its process, which never ends by itself
BEGIN_SECONDS = 60.0  # that physics may take to listen after this program has started it, on a busy machine
TRY_SECONDS = 0.7  # of one attempt to connect to it; between attempts dead processes are restarted, and Ctrl-C is handled
LOOK_SECONDS = 5.0  # in which a router must answer at an endpoint that a user gave
REQUEST, RESULT = "request.json", "end.msgpack"  # files: the options of physics, and its last message
ENDED = (0, 1, 2)  # exit codes of physics when it ends by itself
BAD_ORDER = 2  # exit code of a process that refuses its arguments: starting it again does not help


def run(request: RunRequest, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    """Run a whole harvest. Return its summary, None if there is none, and why it ended. Raises BusError if the endpoint cannot be used."""
    all_names, names = agent_names(request.scenario), local_names(request)
    credentials = credentials_of(request.secure, request.hosts)
    shares = credentials.shares(names, all_names)
    endpoint = _endpoint_of(request, credentials)
    run_id = (request.resumed.run if request.resumed else "") or uuid.uuid4().hex[:16]
    inbox = Inbox()
    _put_signals(inbox)  # from here on Ctrl-C is an item: it must not come between a process's start and its entry in the supervisor
    with (
        TemporaryDirectory() as folder,
        Supervisor(progress.say) as supervisor,
        _noted(request, RunNote(run_id, reachable(endpoint)), progress),
    ):
        if not are_compiled():
            progress.say(COMPILING)
        viewer = _start(supervisor, request, credentials, Path(folder), endpoint, run_id)
        start_hosts(supervisor, reachable(endpoint), shares, credentials)
        if request.without:
            progress.say(f"{', '.join(request.without)}: left to other processes, which connect to {endpoint}")
        watchdog = Watchdog(supervisor, LOGGER)
        summary, why = _follow(
            request, supervisor, watchdog, inbox, reachable(endpoint), credentials.identity("operator"), run_id, progress
        )
        if summary is not None:
            watchdog.end()
            for name, _ in shares if why == "stopped" else ():  # a host that was still connecting has not received the end
                supervisor.terminate(name)
        elif end := read_end(Path(folder) / RESULT, run_id):
            summary, why = end.summary, end.why
            supervisor.terminate_all()  # the others have not received the end either; SIGTERM lets them close their files and sessions
        if request.recording is not None:  # the recording is read next, and Rerun takes half a second to load
            threading.Thread(target=import_module, args=("orchard.view.reader",), daemon=True).start()
        supervisor.terminate(WEB_VIEWER)
        if summary is None:  # the other processes do not know that the run is over
            supervisor.stop(STOP_SECONDS)
        _await_exits(supervisor, [name for name, _ in shares], inbox, STOP_SECONDS if why == "stopped" else PACK_SECONDS)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why


def _await_exits(supervisor: Supervisor, hosts: list[str], inbox: Inbox, seconds: float) -> None:
    """Wait until all processes have ended, at most `seconds`. Kill hosts that still run after THINK_SECONDS. Ctrl-C stops all."""
    begun = time.monotonic()
    while supervisor.is_any_running() and time.monotonic() - begun < seconds:
        if isinstance(inbox.take(POLL_SECONDS), Signal):
            supervisor.stop(STOP_SECONDS)
        if time.monotonic() - begun >= THINK_SECONDS:
            for name in [name for name in hosts if name in supervisor.running and supervisor.exit_code(name) is None]:
                supervisor.say(f"{name} still thinks, {THINK_SECONDS:g} s after the end; ended by force")
                supervisor.kill(name)


def agent_names(scenario: Scenario) -> list[str]:
    """Return the names of all agents of a run, sorted."""
    return sorted(lay_out(scenario).agents)


def local_names(request: RunRequest) -> list[str]:
    """Return the agents that this machine hosts. Raises ValueError for a word of `--without` that names no agent or kind."""
    return select_agents(agent_names(request.scenario), [], list(request.without))


def _endpoint_of(request: RunRequest, credentials: Credentials) -> str:
    """The endpoint of the run's router. Raises BusError if it cannot be used."""
    if request.connect:
        with client(request.connect, seconds=LOOK_SECONDS, identity=credentials.identity("operator")):
            return request.connect
    endpoint = with_port(request.listen or f"{credentials.protocol}/127.0.0.1:{free_port()}")
    check_security(endpoint, credentials.identity(PHYSICS) is not None)
    check_free(endpoint)
    return endpoint


@contextmanager
def _noted(request: RunRequest, note: RunNote, progress: Progress) -> Iterator[None]:
    """Leave a note, with which `run.py stop` finds the run. If it cannot be written, print the endpoint, which a user must then give."""
    with ExitStack() as stack:
        try:
            if request.notes is not None:
                stack.enter_context(noted(request.notes, note))
        except OSError as error:
            progress.say(f"{error}; to stop robots of this run: run.py stop --connect {note.endpoint}")
        yield


def _start(
    supervisor: Supervisor, request: RunRequest, credentials: Credentials, folder: Path, endpoint: str, run_id: str
) -> subprocess.Popen[bytes] | None:
    """Start physics, the logger and the viewers. Return the viewer's window, if any. `folder`: for the files REQUEST and RESULT."""
    identity, file = credentials.identity(PHYSICS), folder / REQUEST
    options = RunOptions(
        scenario=request.scenario.model_dump(),
        listen=None if request.connect else endpoint,
        connect=request.connect,
        secure=None if identity is None else str(identity.folder),
        run=run_id,
        mode="realtime" if request.mode == "realtime" else "lockstep",
        speed=None if math.isinf(request.speed) else request.speed,
        duration=request.duration,
        patience=request.patience,
        recorded=request.recording is not None or request.is_live,
        snapshots=str(request.snapshots.resolve()),
        result=str(folder / RESULT),
        resume=request.resumed is not None,
    )
    file.write_bytes(msgspec.json.encode(options))
    order = ["--request", str(file)]
    supervisor.start(ProcessSpec("physics", "processes.physics", order, again=True, afterwards=["--resume"], final=ENDED))
    return _start_logger(supervisor, request, credentials, reachable(endpoint), run_id)


def start_hosts(supervisor: Supervisor, endpoint: str, shares: Shares, credentials: Credentials) -> None:
    """Start the agent processes, one for each share."""
    for name, share in shares:
        only = [word for agent in share for word in ("--only", agent)]
        order = ["--connect", endpoint, *credentials.option(name), *only]
        supervisor.start(ProcessSpec(name, "processes.agents", order, again=True, agents=share))


def _start_logger(
    supervisor: Supervisor, request: RunRequest, credentials: Credentials, endpoint: str, session: str
) -> subprocess.Popen[bytes] | None:
    """Start the logger if the run is recorded or watched, and the viewers. Return the viewer's window, if any."""
    file = [] if request.recording is None else ["--record", str(request.recording.resolve())]
    live = ["--serve", str(request.data_port)] if request.is_live else []
    if file or live:
        where = ["--connect", endpoint, *credentials.option(LOGGER), "--session", session]
        supervisor.start(ProcessSpec(LOGGER, "processes.logger", [*where, *file, *live], again=True))
    if request.web is not None:
        from orchard.view.web import page_url

        supervisor.start(ProcessSpec(WEB_VIEWER, "orchard.view.web", [request.uri, "--port", str(request.web)]))
        supervisor.say(f"Live: {page_url(request.web)}")
    return open_viewer(request.uri) if request.view else None


# -- following a run


def _put_signals(inbox: Inbox) -> None:
    """Let SIGINT and SIGTERM arrive in the inbox as items."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))


def _reach(supervisor: Supervisor, endpoint: str, inbox: Inbox, identity: Identity | None, stack: ExitStack) -> Bus | None:
    """A session with physics, once it listens; None after Ctrl-C. Processes that die meanwhile are restarted.

    Raises BusError if physics does not listen within BEGIN_SECONDS, or has ended or been given up.
    """
    deadline = time.monotonic() + BEGIN_SECONDS
    while True:
        try:
            return stack.enter_context(client(endpoint, inbox, TRY_SECONDS, identity))
        except BusError:
            supervisor.watch()
            is_over = supervisor.exit_code("physics") in ENDED or "physics" in supervisor.given_up
            if is_over or time.monotonic() >= deadline:
                raise
        if isinstance(inbox.take(0.0), Signal):
            return None


def _follow(
    request: RunRequest,
    supervisor: Supervisor,
    watchdog: Watchdog,
    inbox: Inbox,
    endpoint: str,
    identity: Identity | None,
    run_id: str,
    progress: Progress,
) -> tuple[dict[str, Any] | None, str]:
    """Show the progress until the run is over. Return its summary, None if there is none, and why it ended."""
    keys = Keys()
    try:
        with ExitStack() as stack:
            bus = _reach(supervisor, endpoint, inbox, identity, stack)
            if bus is None:
                return None, "stopped"
            for what in ("figures", "end"):
                bus.subscribe(keys.of(what))
            bus.watch(keys.of("alive", LOGGER, run_id))
            bus.watch(keys.of("alive", PHYSICS, run_id))
            return _listen(request, supervisor, watchdog, bus, run_id, progress)
    except BusError as error:
        return None, str(error)


def _listen(
    request: RunRequest, supervisor: Supervisor, watchdog: Watchdog, bus: Bus, run_id: str, progress: Progress
) -> tuple[dict[str, Any] | None, str]:
    deadline, refusals, begun, keys = math.inf, Refusals(), False, Keys()
    while time.monotonic() < deadline:
        item = bus.inbox.take(0.2)
        if isinstance(item, Signal):
            supervisor.terminate("physics")
            deadline = min(deadline, time.monotonic() + STOP_SECONDS)
        elif isinstance(item, Alive):
            if item.key == keys.of("alive", LOGGER, run_id):
                watchdog.hear(item.up)
            elif item.key == keys.of("alive", PHYSICS, run_id):
                watchdog.hear_of_physics(item.up)
        elif isinstance(item, Sample):
            try:
                if end := _hear(item, run_id, progress):
                    return end.summary, end.why
                begun = True
            except Refused as refusal:
                refusals.note(item.key, refusal)
        elif supervisor.exit_code("physics") in ENDED:
            return None, f"physics ended with code {supervisor.exit_code('physics')}"
        elif "physics" in supervisor.given_up:
            return None, f"physics died repeatedly; to go on: python run.py --resume {request.snapshots}"
        elif not begun and (missing := [agent for program in supervisor.given_up.values() for agent in program.agents]):
            return None, f"the run cannot begin without {', '.join(missing)}: the processes that hosted them died repeatedly"
        watchdog.look()
        supervisor.watch()
    return None, "stopped"


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
    """Show the figures in a sample. Return the end if the sample is the end."""
    if sample.key.endswith("/end"):
        end = read_message(sample.payload, End, run_id)
        _check(end.summary, Outcome)
        return end
    message = read_message(sample.payload, Figures, run_id)
    _check(message.figures, Headline)
    progress.show(message.figures, message.doing, message.waits_for)
    return None


def _check(figures: dict[str, Any], needed: type) -> None:
    """Raise Refused if figures lack a field of `needed`: any client may publish on the keys of physics."""
    try:
        msgspec.convert(figures, needed)
    except ValueError as error:
        raise Refused("malformed", str(error)) from error


# -- agents of a run elsewhere


def join_run(endpoint: str, only: list[str], without: list[str], credentials: OpenRun | SecuredRun, progress: Progress) -> int:
    """Host these agents of a run elsewhere until it ends. Return the exit code."""
    all_names = _names_of(endpoint, credentials.identity(credentials.only_role) if isinstance(credentials, SecuredRun) else None)
    names = select_agents(all_names, only, without)
    shares = credentials.shares(names, all_names)
    inbox = Inbox()
    _put_signals(inbox)
    with Supervisor(progress.say) as supervisor:
        start_hosts(supervisor, endpoint, shares, credentials)
        progress.say(f"hosting {', '.join(names)} at {endpoint}")
        while (codes := supervisor.exit_codes()) and None in codes:
            if isinstance(inbox.take(0.2), Signal):
                supervisor.stop(STOP_SECONDS)
                return 0
            if BAD_ORDER in codes:
                return BAD_ORDER
            supervisor.watch()
        return max([1 for _ in supervisor.given_up] + [code or 0 for code in supervisor.exit_codes()])


def _names_of(endpoint: str, identity: Identity | None) -> list[str]:
    """All agents of the run at an endpoint."""
    with client(endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        return fetch_run(bus, Keys()).agents
