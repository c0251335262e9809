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
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import let_go, open_viewer
from orchard.local import Local
from orchard.report.progress import Progress
from orchard.server.account import RunAccount
from orchard.server.control import Pacer
from orchard.server.options import last_tick
from orchard.server.snapshots import SnapshotWriter, sole
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
    """Raised in an agent that still thinks after Ctrl-C. Many agents catch an Exception."""


@contextmanager
def interruptible(local: Local) -> Iterator[Callable[[], bool]]:
    """Yield what tells whether to stop, after a signal. An agent that thinks on gets StillThinks; then the process ends."""
    asked: list[int] = []  # the signals that have come
    raised: list[StillThinks] = []

    def ask(number: int, frame: FrameType | None) -> None:
        if not asked:
            signal.setitimer(signal.ITIMER_REAL, THINK_SECONDS, THINK_SECONDS)
        asked.append(number)

    def hurry(number: int, frame: FrameType | None) -> None:
        """End the agent in which the process is; what the program itself does ends soon."""
        if place := place_in_agent(frame):
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
            yield lambda: bool(asked)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def run(
    request: RunRequest,
    look: Callable[[Frame], None] | None,
    show: Callable[[dict[str, Any], dict[str, str], dict[str, str]], None],
) -> tuple[dict[str, Any], str]:
    """Run a harvest. Return its summary, and why it ended. `look` gets each frame, `show` the figures."""
    checks, holds = request.options.check_agents, HOLDS[request.options.holds]
    agents = _replayed(request)
    local = (
        Local(request.scenario, agents, checks, holds)
        if request.resumed is None
        else Local.resume(request.resumed, checks, holds)
    )
    engine = local.engine
    executor, keyframes = ThreadPoolExecutor(max_workers=1), request.options.keyframes
    snapshot_writer = SnapshotWriter(
        request.snapshots, executor, time.monotonic, keyframe_seconds=keyframes
    )
    account = RunAccount(
        engine, request.resumed, snapshot_writer, request.options.table, time.monotonic
    )
    pacer, ticks = Pacer(request.options.pace, time.monotonic), last_tick(request.options.duration)
    with sole(request.snapshots), interruptible(local) as is_stopped:
        try:
            engine.rehearse()  # it may compile: that is no time of the run
            account.figures.begin()
            while not (why := account.why_over(ticks) or ("stopped" if is_stopped() else "")):
                if left := pacer.wait():
                    time.sleep(min(left, NAP_SECONDS))
                    continue
                pacer.begin()
                if account.snapshot_writer.is_due(engine.tick):
                    account.keep(_snapshot(local, account, request))
                events = local.tick()
                letters = local.post.written.get(engine.tick - 1, {})
                account.update(events, letters)
                if look is not None:
                    look(account.frame_builder.frame([*events, *talk_of(engine.tick - 1, letters)]))
                if account.figures.is_due():
                    message = account.figures.message("", {})
                    show(message.figures, message.doing, message.waits_for)
            account.keep(_snapshot(local, account, request))
        except StillThinks as thought:  # some memories are of this tick already: no snapshot of it
            print_error(f"{thought}; the run ends before this tick")
            why = "stopped"
    account.close()
    return account.summary(why, "local", 1, {}, {}), why


def _replayed(request: RunRequest) -> dict[str, Agent] | None:
    """Return the agents of a run in which a bag drives robots; None without a bag."""
    options = request.options
    if options.replay is None:
        return None
    # The packages for bags are an extra.
    from orchard.launch.replayed import replayed_agents

    return replayed_agents(request.scenario, options.replay, options.from_first_stamp)


def _snapshot(local: Local, account: RunAccount, request: RunRequest) -> Snapshot:
    snapshot = local.snapshot()
    snapshot.run = request.run_id
    snapshot.lost = request.resumed.lost if request.resumed else {}
    snapshot.figures |= account.figures.as_data()
    return snapshot


def run_watched(request: RunRequest) -> tuple[dict[str, Any], str]:
    """Run a harvest with its recording, viewers and progress. Return its summary, and why it ended."""
    options = request.options
    with ExitStack() as stack:
        recorder = _recorder(request)
        if recorder is not None:
            stack.callback(recorder.close)
        if options.web is not None:
            from orchard.view.web import how_to_open, serve_web

            print_line("\n".join(how_to_open("Live", options.web, request.uri)))
            stack.callback(
                let_go, stack.enter_context(serve_web(options.web, request.uri)), True, print_error
            )
        viewer = open_viewer(request.uri) if options.view else None
        with Progress(console, options.progress == "json", options.duration) as progress:
            if options.progress == "text":
                progress.say(CTRL_C)
            if not are_compiled():
                progress.get_ready(COMPILING)
            summary, why = run(request, None if recorder is None else recorder.tick, progress.show)
        let_go(viewer, why == "stopped", print_error)
        return summary, why


def _recorder(request: RunRequest) -> "Recorder | None":
    is_live = request.options.is_live
    if request.recording is None and not is_live:
        return None
    from orchard.view.recorder import Recorder  # not at the top: Rerun takes half a second to load

    recorder = Recorder(
        lay_out(request.scenario),
        request.run_id,
        request.recording,
        request.data_port if is_live else None,
    )
    recorder.waiting = lambda: request.options.pace == math.inf  # what comes at once
    return recorder
