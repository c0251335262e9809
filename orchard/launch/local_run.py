"""Local mode: a whole run in this process, with its recording, live viewers and snapshots."""

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

from orchard.contract.agent import Agent
from orchard.contract.events import Frame, talk_of
from orchard.contract.guard import place_in_agent
from orchard.field.layout import lay_out
from orchard.launch.end_forecast import EndForecast
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import let_go, open_viewer
from orchard.local import Local
from orchard.report.progress import Progress
from orchard.server.account import RunAccount
from orchard.server.control import Pacer
from orchard.server.options import last_tick
from orchard.server.snapshots import SnapshotWriter, sole_writer
from orchard.sim.kernels.cache import COMPILING, are_compiled
from orchard.sim.lookahead import HOLDS
from orchard.sim.snapshot import Snapshot
from orchard.terminal.exits import FAILED
from orchard.terminal.output import console, print_error, print_line
from orchard.terminal.signals import CTRL_C, handled

if TYPE_CHECKING:
    from orchard.view.recorder import Recorder

NAP_SECONDS = 0.2  # between two checks whether to stop, while the next tick is not due
THINK_SECONDS = 2.0  # that an agent may still think after Ctrl-C


class StillThinks(BaseException):
    """Raised in an agent that still thinks THINK_SECONDS after Ctrl-C.

    It is no Exception, because many agents catch each Exception and go on.
    """


@contextmanager
def interruptible(local: Local) -> Iterator[Callable[[], bool]]:
    """Yield a function that tells whether the run must stop, because SIGINT or SIGTERM has come.

    The run looks at it between ticks. In an agent that thinks on for THINK_SECONDS, StillThinks is
    raised. If it thinks on for as long again, the process ends.
    """
    # The signals that have come, and the errors that were raised in agents.
    signals: list[int] = []
    raised: list[StillThinks] = []

    def ask(number: int, frame: FrameType | None) -> None:
        """Note a signal to stop. The first one starts the timer that calls `hurry` repeatedly."""
        if not signals:
            signal.setitimer(signal.ITIMER_REAL, THINK_SECONDS, THINK_SECONDS)
        signals.append(number)

    def hurry(number: int, frame: FrameType | None) -> None:
        """Raise StillThinks in the agent that the process is in, or end the process."""
        place = place_in_agent(frame)
        if not place:
            # It is in the program's own code, which comes to the end of the tick soon.
            return
        thought = StillThinks(
            f"{local.thinking} still thinks about tick {local.engine.tick}{place}"
        )
        if raised:
            print_error(f"{thought}; the run is ended by force, without a result")
            os._exit(FAILED)
        raised.append(thought)
        raise thought

    try:
        with handled({signal.SIGINT: ask, signal.SIGTERM: ask, signal.SIGALRM: hurry}):
            yield lambda: bool(signals)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


# Gets each frame.
Look = Callable[[Frame], None]
# Gets the figures, and by name what each robot does and what it waits for.
Show = Callable[[dict[str, Any], dict[str, str], dict[str, str]], None]


def run(request: RunRequest, look: Look | None, show: Show) -> tuple[dict[str, Any], str]:
    """Run a harvest. Return its summary, and why it ended.

    `look`: gets each frame; None: nothing needs frames. Raises SnapshotError.
    """
    local = _local_of(request)
    account = _account_of(request, local)
    pacer = Pacer(request.options.pace, time.monotonic)
    ticks = last_tick(request.options.duration)
    with sole_writer(request.snapshots), interruptible(local) as is_stopped:
        try:
            # This may compile, which is no time of the run.
            local.engine.rehearse()
            account.figures.begin()
            while True:
                why = account.why_over(ticks)
                if not why and is_stopped():
                    why = "stopped"
                if why:
                    break
                seconds_to_tick = pacer.wait()
                if seconds_to_tick:
                    time.sleep(min(seconds_to_tick, NAP_SECONDS))
                else:
                    pacer.begin()
                    _tick(local, account, request, look, show)
            account.keep(_snapshot(local, account, request))
        except StillThinks as thought:
            # Some agents have answered this tick, and some have not. So no snapshot is written: a
            # run cannot go on from the middle of a tick.
            print_error(f"{thought}; the run ends before this tick")
            why = "stopped"
    account.close()
    return account.summary(why, "local", 1, {}, {}), why


def _local_of(request: RunRequest) -> Local:
    """Return the orchard and all its agents, at the beginning of a run. Raises SnapshotError."""
    checks_agents = request.options.check_agents
    holds = HOLDS[request.options.holds]
    if request.resumed is None:
        return Local(request.scenario, _replayed(request), checks_agents, holds=holds)
    return Local.resume(request.resumed, checks_agents, holds)


def _account_of(request: RunRequest, local: Local) -> RunAccount:
    """Return what keeps the figures, tables and snapshots of a run."""
    snapshots = SnapshotWriter(
        request.snapshots,
        ThreadPoolExecutor(max_workers=1),
        time.monotonic,
        keyframe_seconds=request.options.keyframes,
    )
    table = request.options.table
    return RunAccount(local.engine, request.resumed, snapshots, table, time.monotonic)


def _tick(
    local: Local, account: RunAccount, request: RunRequest, look: Look | None, show: Show
) -> None:
    """Advance a run by one tick, keep and show what is due. `look`, `show`: as for `run`."""
    tick = local.engine.tick
    if account.snapshot_writer.is_due(tick):
        account.keep(_snapshot(local, account, request))
    events = local.tick()
    letters = local.post.written.get(tick, {})
    account.update(events, letters)
    if look is not None:
        look(account.frame_builder.frame([*events, *talk_of(tick, letters)]))
    if account.figures.is_due():
        message = account.figures.message("", {})
        show(message.figures, message.doing, message.waits_for)


def _replayed(request: RunRequest) -> dict[str, Agent] | None:
    """Return the agents of a run in which a bag drives robots; None without a bag."""
    options = request.options
    if options.replay is None:
        return None
    # The packages for bags are an extra.
    from orchard.launch.replayed import replayed_agents

    return replayed_agents(request.scenario, options.replay, options.from_first_stamp)


def _snapshot(local: Local, account: RunAccount, request: RunRequest) -> Snapshot:
    """Return the state of a run, with its id and its figures."""
    snapshot = local.snapshot()
    snapshot.run = request.run_id
    snapshot.lost = request.resumed.lost if request.resumed else {}
    snapshot.figures |= account.figures.as_data()
    return snapshot


def run_watched(request: RunRequest) -> tuple[dict[str, Any], str]:
    """Run a harvest with its recording, viewers and progress.

    Returns its summary, and why it ended. Raises SnapshotError.
    """
    options = request.options
    with ExitStack() as stack:
        recorder = _recorder(request)
        if recorder is not None:
            stack.callback(recorder.close)
        if options.web is not None:
            _serve_web(options.web, request.uri, stack)
        viewer = open_viewer(request.uri) if options.view else None
        with Progress(console, options.progress == "json", options.duration) as progress:
            if options.progress == "text":
                progress.say(CTRL_C)
            progress.tell_end(
                EndForecast(lay_out(request.scenario), request.snapshots, request.run_id)
            )
            if not are_compiled():
                progress.get_ready(COMPILING)
            look = None if recorder is None else recorder.tick
            summary, why = run(request, look, progress.show)
        let_go(viewer, why == "stopped", print_error)
        return summary, why


def _serve_web(port: int, uri: str, stack: ExitStack) -> None:
    """Serve the live data to browsers until the stack is closed. Say how to open it."""
    # Rerun takes half a second to load.
    from orchard.view.web import how_to_open, serve_web

    print_line("\n".join(how_to_open("Live", port, uri)))
    server = stack.enter_context(serve_web(port, uri))
    stack.callback(let_go, server, True, print_error)


def _recorder(request: RunRequest) -> "Recorder | None":
    """Return what records a run and serves its live data; None if neither is wanted."""
    is_live = request.options.is_live
    if request.recording is None and not is_live:
        return None
    # Rerun takes half a second to load.
    from orchard.view.recorder import Recorder

    recorder = Recorder(
        lay_out(request.scenario),
        request.run_id,
        request.recording,
        request.data_port if is_live else None,
    )
    # The recorder gathers frames into larger pieces while more frames wait. In a run as fast as
    # possible, the next frame is always at hand.
    recorder.waiting = lambda: request.options.pace == math.inf
    return recorder
