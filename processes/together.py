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

from orchard.bus import Alive, Bus, Inbox, Sample, Signal, client
from orchard.config import Scenario, to_yaml
from orchard.endpoints import BusError, check_free, check_security, reachable, with_port
from orchard.host import newcomer
from orchard.identity import Identity
from orchard.kept import COMPILING, are_compiled
from orchard.keys import LOGGER, PHYSICS, Keys
from orchard.layout import lay_out
from orchard.lockstep import Refusals, Refused, understood
from orchard.names import chosen
from orchard.progress import Headline, Progress
from orchard.summary import Outcome
from orchard.wire.course import End
from orchard.wire.watching import Figures
from processes.fleet import Fleet, Program, free_port, open_viewer
from processes.passes import Open, Passes, Secured, Shares, passes_of
from processes.result import left
from processes.running import Going, noted
from processes.watchdog import Watchdog
from processes.wish import Wish

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


def run(wish: Wish, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    """A whole run; its summary, and why it ended. Raises BusError where the endpoint is of no use."""
    everybody, names = agent_names(wish.scenario), local_names(wish)
    passes = passes_of(wish.secure, wish.hosts)
    shares = passes.shares(names, everybody)
    endpoint = _meeting(wish, passes)
    run_id = (wish.resumed.run if wish.resumed else "") or uuid.uuid4().hex[:16]
    inbox = Inbox()
    _signalled(inbox)  # from here on Ctrl-C waits its turn: it shall not come between a process's start and its place in the fleet
    with TemporaryDirectory() as folder, Fleet(progress.say) as fleet, _noted(wish, Going(run_id, reachable(endpoint)), progress):
        if not are_compiled():
            progress.say(COMPILING)
        viewer = _start(fleet, wish, passes, Path(folder), endpoint, run_id)
        start_hosts(fleet, reachable(endpoint), shares, passes)
        if wish.without:
            progress.say(f"{', '.join(wish.without)}: left to others, who connect to {endpoint}")
        watchdog = Watchdog(fleet, LOGGER)
        summary, why = _follow(wish, fleet, watchdog, inbox, reachable(endpoint), passes.identity("operator"), run_id, progress)
        if summary is not None:
            watchdog.end()
            for name, _ in shares if why == "stopped" else ():  # who was still on the way to the run has not heard of its end
                fleet.terminate(name)
        elif end := left(Path(folder) / RESULT, run_id):
            summary, why = end.summary, end.why
            fleet.terminate_all()  # the others have not heard of it either, and have still to close what they have open
        if wish.recording is not None:  # what was recorded is read next, and Rerun takes half a second to load
            threading.Thread(target=import_module, args=("orchard.view.parts",), daemon=True).start()
        fleet.terminate(WEB_VIEWER)
        if summary is None:  # the others do not know that it is over
            fleet.stop(STOP_SECONDS)
        _part(fleet, [name for name, _ in shares], inbox, STOP_SECONDS if why == "stopped" else GOODBYE_SECONDS)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why


def _part(fleet: Fleet, hosts: list[str], inbox: Inbox, seconds: float) -> None:
    """Until all have ended by themselves, but not for ever; Ctrl-C makes it short, and an agent that thinks on is not waited for."""
    begun = time.monotonic()
    while fleet.goes_on() and time.monotonic() - begun < seconds:
        if isinstance(inbox.take(PART_SECONDS), Signal):
            fleet.stop(STOP_SECONDS)
        if time.monotonic() - begun >= THINK_SECONDS:
            for name in [name for name in hosts if name in fleet.running and fleet.exit_code(name) is None]:
                fleet.say(f"{name} still thinks, {THINK_SECONDS:g} s after the end; ended by force")
                fleet.kill(name)


def agent_names(scenario: Scenario) -> list[str]:
    """Every agent of a run."""
    from orchard.doer import TRAFFIC

    return sorted([*lay_out(scenario).names, TRAFFIC])


def local_names(wish: Wish) -> list[str]:
    """The agents that are hosted on this machine. Raises ValueError for words that name none."""
    return chosen(agent_names(wish.scenario), [], list(wish.without))


def _meeting(wish: Wish, passes: Passes) -> str:
    """The endpoint at which all meet, after a look whether it can be used."""
    if wish.connect:
        with client(wish.connect, seconds=LOOK_SECONDS, identity=passes.identity("operator")):
            return wish.connect
    endpoint = with_port(wish.listen or f"{passes.protocol}/127.0.0.1:{free_port()}")
    check_security(endpoint, passes.identity(PHYSICS) is not None)
    check_free(endpoint)
    return endpoint


@contextmanager
def _noted(wish: Wish, going: Going, progress: Progress) -> Iterator[None]:
    """Within this, run.py stop finds the run; where no note can be written, it must be told the endpoint."""
    with ExitStack() as stack:
        try:
            if wish.notes is not None:
                stack.enter_context(noted(wish.notes, going))
        except OSError as error:
            progress.say(f"{error}; to stop robots of this run: run.py stop --connect {going.endpoint}")
        yield


def _start(fleet: Fleet, wish: Wish, passes: Passes, folder: Path, endpoint: str, run_id: str) -> subprocess.Popen[bytes] | None:
    """Start all but the agents; the viewer. In the folder is what physics and this process tell each other."""
    file = folder / SCENARIO
    file.write_text(to_yaml(wish.scenario))
    pace = ["--mode", wish.mode, "--speed", "max" if math.isinf(wish.speed) else str(wish.speed)]
    limit = ["--patience", str(wish.patience), *([] if wish.duration is None else ["--duration", str(wish.duration)])]
    limit += ["--recorded"] if wish.recording is not None or wish.is_live else []
    where = ["--connect" if wish.connect else "--listen", endpoint]
    keep = ["--snapshots", str(wish.snapshots.resolve()), *(["--resume"] if wish.resumed else [])]
    order = [str(file), *where, *passes.option(PHYSICS), "--run", run_id, *pace, *limit, *keep, "--result", str(folder / RESULT)]
    fleet.start(Program("physics", "processes.physics", order, again=True, afterwards=["--resume"], final=ENDED))
    return _start_logger(fleet, wish, passes, reachable(endpoint), run_id)


def start_hosts(fleet: Fleet, endpoint: str, shares: Shares, passes: Passes) -> None:
    """Agent processes that share some agents."""
    for name, share in shares:
        only = [word for agent in share for word in ("--only", agent)]
        order = ["--connect", endpoint, *passes.option(name), *only]
        fleet.start(Program(name, "processes.agents", order, again=True, agents=share))


def _start_logger(fleet: Fleet, wish: Wish, passes: Passes, endpoint: str, session: str) -> subprocess.Popen[bytes] | None:
    """Start the logger, if anything is to be recorded or seen; the viewer."""
    file = [] if wish.recording is None else ["--record", str(wish.recording.resolve())]
    live = ["--serve", str(wish.data_port)] if wish.is_live else []
    if file or live:
        where = ["--connect", endpoint, *passes.option(LOGGER), "--session", session]
        fleet.start(Program(LOGGER, "processes.logger", [*where, *file, *live], again=True))
    if wish.web is not None:
        from orchard.view.web import page_url

        fleet.start(Program(WEB_VIEWER, "orchard.view.web", [wish.uri, "--port", str(wish.web)]))
        fleet.say(f"Live: {page_url(wish.web)}")
    return open_viewer(wish.uri) if wish.view else None


# -- following a run


def _signalled(inbox: Inbox) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: inbox.put(Signal(number)))


def _reach(fleet: Fleet, endpoint: str, inbox: Inbox, identity: Identity | None, stack: ExitStack) -> Bus | None:
    """A session with physics, once it listens; None where the user wants it no more. Who dies meanwhile is started again.

    Raises BusError where physics does not listen, or has ended for good.
    """
    deadline = time.monotonic() + BEGIN_SECONDS
    while True:
        try:
            return stack.enter_context(client(endpoint, inbox, TRY_SECONDS, identity))
        except BusError:
            fleet.watch()
            is_over = fleet.exit_code("physics") in ENDED or "physics" in fleet.given_up
            if is_over or time.monotonic() >= deadline:
                raise
        if isinstance(inbox.take(0.0), Signal):
            return None


def _follow(
    wish: Wish,
    fleet: Fleet,
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
            bus = _reach(fleet, endpoint, inbox, identity, stack)
            if bus is None:
                return None, "stopped"
            for what in ("figures", "end"):
                bus.subscribe(keys.of(what))
            bus.watch(keys.of("alive", LOGGER, run_id))
            bus.watch(keys.of("alive", PHYSICS, run_id))
            return _listen(wish, fleet, watchdog, bus, run_id, progress)
    except BusError as error:
        return None, str(error)


def _listen(wish: Wish, fleet: Fleet, watchdog: Watchdog, bus: Bus, run_id: str, progress: Progress) -> tuple[dict[str, Any] | None, str]:
    deadline, refusals, begun, keys = math.inf, Refusals(), False, Keys()
    while time.monotonic() < deadline:
        item = bus.inbox.take(0.2)
        if isinstance(item, Signal):
            fleet.terminate("physics")
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
        elif fleet.exit_code("physics") in ENDED:
            return None, f"physics ended with code {fleet.exit_code('physics')}"
        elif "physics" in fleet.given_up:
            return None, f"physics died again and again; to go on: python run.py --resume {wish.snapshots}"
        elif not begun and (missing := [agent for program in fleet.given_up.values() for agent in program.agents]):
            return None, f"the run cannot begin without {', '.join(missing)}: the processes that hosted them died again and again"
        watchdog.look()
        fleet.watch()
    return None, "stopped"


def _hear(sample: Sample, run_id: str, progress: Progress) -> End | None:
    """Show the figures; the end, once it has come."""
    if sample.key.endswith("/end"):
        end = understood(sample.payload, End, run_id)
        _check(end.summary, Outcome)
        return end
    message = understood(sample.payload, Figures, run_id)
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


def visit(endpoint: str, only: list[str], without: list[str], passes: Open | Secured, progress: Progress) -> int:
    """Host these agents of a run that goes on elsewhere, until it ends; the exit code."""
    everybody = _names_of(endpoint, passes.identity(passes.only_role) if isinstance(passes, Secured) else None)
    names = chosen(everybody, only, without)
    shares = passes.shares(names, everybody)
    inbox = Inbox()
    _signalled(inbox)
    with Fleet(progress.say) as fleet:
        start_hosts(fleet, endpoint, shares, passes)
        progress.say(f"hosting {', '.join(names)} at {endpoint}")
        while (codes := fleet.exit_codes()) and None in codes:
            if isinstance(inbox.take(0.2), Signal):
                fleet.stop(STOP_SECONDS)
                return 0
            if GIVEN_UP in codes:
                return GIVEN_UP
            fleet.watch()
        return max([1 for _ in fleet.given_up] + [code or 0 for code in fleet.exit_codes()])


def _names_of(endpoint: str, identity: Identity | None) -> list[str]:
    """Every agent of the run that goes on there."""
    with client(endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        return newcomer(bus, Keys()).agents
