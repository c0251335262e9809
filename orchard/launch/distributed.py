"""A run in many processes: start those of this machine, follow them, stop them. And the guest, who runs agents of a run elsewhere."""

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
from orchard.field.scenario import Scenario, to_yaml
from orchard.launch.credentials import Credentials, OpenRun, SecuredRun, Shares, credentials_of
from orchard.launch.emergency_stop import RunNote, noted
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import ProcessSpec, Supervisor, Watchdog, free_port, open_viewer
from orchard.net.bus import Alive, Bus, Inbox, Sample, Signal, client
from orchard.net.endpoints import BusError, check_free, check_security, reachable, with_port
from orchard.net.refusals import Refusals, Refused, read_message
from orchard.net.requests import fetch_run
from orchard.report.progress import Headline, Progress
from orchard.report.summary import Outcome
from orchard.security.identity import Identity
from orchard.server.result import left
from orchard.sim.kernels.cache import COMPILING, are_compiled
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import End, Figures

STOP_SECONDS = 2.0  # for which the processes may close what they have open, after Ctrl-C
PART_SECONDS = 0.02  # between two looks who has ended
THINK_SECONDS = 5.0  # for which agents that still think may do so, after a run that ended by itself
GOODBYE_SECONDS = 60.0  # for which the logger may pack its recording, after a run that ended by itself
WEB_VIEWER = "web viewer"  # its name among the processes; it never ends by itself
BEGIN_SECONDS = 60.0  # for which physics, which this program has started, may take to listen on a busy machine
TRY_SECONDS = 0.7  # that one look for it takes; in between what has died is started again, and Ctrl-C heard
LOOK_SECONDS = 5.0  # for how long somebody must answer at an endpoint that a user gave
SCENARIO, RESULT = "scenario.yaml", "end.msgpack"  # what physics is told, and what it leaves
ENDED = (0, 1, 2)  # exit codes with which physics ends by itself
GIVEN_UP = 2  # exit code of a process whose order cannot be carried out: starting it again does not help


def run(request: RunRequest, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    """A whole run; its summary, and why it ended. Raises BusError where the endpoint is of no use."""
    everybody, names = agent_names(request.scenario), local_names(request)
    credentials = credentials_of(request.secure, request.hosts)
    shares = credentials.shares(names, everybody)
    endpoint = _meeting(request, credentials)
    run_id = (request.resumed.run if request.resumed else "") or uuid.uuid4().hex[:16]
    inbox = Inbox()
    _signalled(inbox)  # from here on Ctrl-C waits its turn: it shall not come between a process's start and its place in the supervisor
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
            progress.say(f"{', '.join(request.without)}: left to others, who connect to {endpoint}")
        watchdog = Watchdog(supervisor, LOGGER)
        summary, why = _follow(
            request, supervisor, watchdog, inbox, reachable(endpoint), credentials.identity("operator"), run_id, progress
        )
        if summary is not None:
            watchdog.end()
            for name, _ in shares if why == "stopped" else ():  # who was still on the way to the run has not heard of its end
                supervisor.terminate(name)
        elif end := left(Path(folder) / RESULT, run_id):
            summary, why = end.summary, end.why
            supervisor.terminate_all()  # the others have not heard of it either, and have still to close what they have open
        if request.recording is not None:  # what was recorded is read next, and Rerun takes half a second to load
            threading.Thread(target=import_module, args=("orchard.view.reader",), daemon=True).start()
        supervisor.terminate(WEB_VIEWER)
        if summary is None:  # the others do not know that it is over
            supervisor.stop(STOP_SECONDS)
        _part(supervisor, [name for name, _ in shares], inbox, STOP_SECONDS if why == "stopped" else GOODBYE_SECONDS)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why


def _part(supervisor: Supervisor, hosts: list[str], inbox: Inbox, seconds: float) -> None:
    """Until all have ended by themselves, but not for ever; Ctrl-C makes it short, and an agent that thinks on is not waited for."""
    begun = time.monotonic()
    while supervisor.goes_on() and time.monotonic() - begun < seconds:
        if isinstance(inbox.take(PART_SECONDS), Signal):
            supervisor.stop(STOP_SECONDS)
        if time.monotonic() - begun >= THINK_SECONDS:
            for name in [name for name in hosts if name in supervisor.running and supervisor.exit_code(name) is None]:
                supervisor.say(f"{name} still thinks, {THINK_SECONDS:g} s after the end; ended by force")
                supervisor.kill(name)


def agent_names(scenario: Scenario) -> list[str]:
    """Every agent of a run."""
    from orchard.contract.messages import TRAFFIC

    return sorted([*lay_out(scenario).names, TRAFFIC])


def local_names(request: RunRequest) -> list[str]:
    """The agents that are hosted on this machine. Raises ValueError for words that name none."""
    return select_agents(agent_names(request.scenario), [], list(request.without))


def _meeting(request: RunRequest, credentials: Credentials) -> str:
    """The endpoint at which all meet, after a look whether it can be used."""
    if request.connect:
        with client(request.connect, seconds=LOOK_SECONDS, identity=credentials.identity("operator")):
            return request.connect
    endpoint = with_port(request.listen or f"{credentials.protocol}/127.0.0.1:{free_port()}")
    check_security(endpoint, credentials.identity(PHYSICS) is not None)
    check_free(endpoint)
    return endpoint


@contextmanager
def _noted(request: RunRequest, going: RunNote, progress: Progress) -> Iterator[None]:
    """Within this, run.py stop finds the run; where no note can be written, it must be told the endpoint."""
    with ExitStack() as stack:
        try:
            if request.notes is not None:
                stack.enter_context(noted(request.notes, going))
        except OSError as error:
            progress.say(f"{error}; to stop robots of this run: run.py stop --connect {going.endpoint}")
        yield


def _start(
    supervisor: Supervisor, request: RunRequest, credentials: Credentials, folder: Path, endpoint: str, run_id: str
) -> subprocess.Popen[bytes] | None:
    """Start all but the agents; the viewer. In the folder is what physics and this process tell each other."""
    file = folder / SCENARIO
    file.write_text(to_yaml(request.scenario))
    pace = ["--mode", request.mode, "--speed", "max" if math.isinf(request.speed) else str(request.speed)]
    limit = ["--patience", str(request.patience), *([] if request.duration is None else ["--duration", str(request.duration)])]
    limit += ["--recorded"] if request.recording is not None or request.is_live else []
    where = ["--connect" if request.connect else "--listen", endpoint]
    keep = ["--snapshots", str(request.snapshots.resolve()), *(["--resume"] if request.resumed else [])]
    order = [str(file), *where, *credentials.option(PHYSICS), "--run", run_id, *pace, *limit, *keep, "--result", str(folder / RESULT)]
    supervisor.start(ProcessSpec("physics", "processes.physics", order, again=True, afterwards=["--resume"], final=ENDED))
    return _start_logger(supervisor, request, credentials, reachable(endpoint), run_id)


def start_hosts(supervisor: Supervisor, endpoint: str, shares: Shares, credentials: Credentials) -> None:
    """Agent processes that share some agents."""
    for name, share in shares:
        only = [word for agent in share for word in ("--only", agent)]
        order = ["--connect", endpoint, *credentials.option(name), *only]
        supervisor.start(ProcessSpec(name, "processes.agents", order, again=True, agents=share))


def _start_logger(
    supervisor: Supervisor, request: RunRequest, credentials: Credentials, endpoint: str, session: str
) -> subprocess.Popen[bytes] | None:
    """Start the logger, if anything is to be recorded or seen; the viewer."""
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


def _signalled(inbox: Inbox) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))


def _reach(supervisor: Supervisor, endpoint: str, inbox: Inbox, identity: Identity | None, stack: ExitStack) -> Bus | None:
    """A session with physics, once it listens; None where the user wants it no more. Who dies meanwhile is started again.

    Raises BusError where physics does not listen, or has ended for good.
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
    """Show how it goes until it is over; the summary, and why it ended."""
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
            return None, f"physics died again and again; to go on: python run.py --resume {request.snapshots}"
        elif not begun and (missing := [agent for program in supervisor.given_up.values() for agent in program.agents]):
            return None, f"the run cannot begin without {', '.join(missing)}: the processes that hosted them died again and again"
        watchdog.look()
        supervisor.watch()
    return None, "stopped"


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
    """Show the figures; the end, once it has come."""
    if sample.key.endswith("/end"):
        end = read_message(sample.payload, End, run_id)
        _check(end.summary, Outcome)
        return end
    message = read_message(sample.payload, Figures, run_id)
    _check(message.figures, Headline)
    progress.show(message.figures, message.doing, message.waits_for)
    return None


def _check(figures: dict[str, Any], needed: type) -> None:
    """Anybody may pretend to be physics. Raises Refused for figures that lack what is needed of them."""
    try:
        msgspec.convert(figures, needed)
    except ValueError as error:
        raise Refused("malformed", str(error)) from error


# -- the guest


def visit(endpoint: str, only: list[str], without: list[str], credentials: OpenRun | SecuredRun, progress: Progress) -> int:
    """Host these agents of a run that goes on elsewhere, until it ends; the exit code."""
    everybody = _names_of(endpoint, credentials.identity(credentials.only_role) if isinstance(credentials, SecuredRun) else None)
    names = select_agents(everybody, only, without)
    shares = credentials.shares(names, everybody)
    inbox = Inbox()
    _signalled(inbox)
    with Supervisor(progress.say) as supervisor:
        start_hosts(supervisor, endpoint, shares, credentials)
        progress.say(f"hosting {', '.join(names)} at {endpoint}")
        while (codes := supervisor.exit_codes()) and None in codes:
            if isinstance(inbox.take(0.2), Signal):
                supervisor.stop(STOP_SECONDS)
                return 0
            if GIVEN_UP in codes:
                return GIVEN_UP
            supervisor.watch()
        return max([1 for _ in supervisor.given_up] + [code or 0 for code in supervisor.exit_codes()])


def _names_of(endpoint: str, identity: Identity | None) -> list[str]:
    """Every agent of the run that goes on there."""
    with client(endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        return fetch_run(bus, Keys()).agents
