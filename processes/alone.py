"""The whole orchard in this process, without a network: local mode."""

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from orchard.camera import Camera, talk_of
from orchard.config import TIME_STEP
from orchard.frames import Event, Frame
from orchard.local import Local
from orchard.lockstep import Pacer
from orchard.snapshot import Snapshot
from processes.account import Account
from processes.keeper import SNAPSHOT_SECONDS, Keeper, sole
from processes.wish import Wish

NAP_SECONDS = 0.2  # between two looks whether to stop, while the next tick is not due


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Within this, Ctrl-C and SIGTERM only say that it is time to stop."""
    asked: list[int] = []
    old = {number: signal.signal(number, lambda number, frame: asked.append(number)) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def run(
    wish: Wish, look: Callable[[Frame], None] | None, show: Callable[[dict[str, Any], dict[str, str], dict[str, str]], None]
) -> tuple[dict[str, Any], str]:
    """Harvest; the summary, and why it ended. Every frame goes to `look`, the figures now and then to `show`."""
    local = Local(wish.scenario) if wish.resumed is None else Local.resume(wish.resumed)
    engine, account = local.engine, Account(local.engine, wish.resumed.figures if wish.resumed else {})
    camera, pacer, keeper = Camera(engine.world), Pacer(wish.speed), Keeper(wish.snapshots, SNAPSHOT_SECONDS)
    ticks = math.inf if wish.duration is None else round(wish.duration / TIME_STEP)
    account.begin()
    with sole(wish.snapshots), interruptible() as is_stopped:
        while not (why := _end(local, account, ticks, is_stopped())):
            if keeper.is_due():
                keeper.keep(_snapshot(local, account))
            if left := pacer.wait():
                time.sleep(min(left, NAP_SECONDS))
                continue
            pacer.begin()
            events = local.tick()
            account.update(events, local.actions)
            if look is not None:
                frame = camera.frame(engine.scans, local.actions, events)
                frame.events = [*frame.events, *_talk(local)]
                look(frame)
            if account.is_due():
                message = account.message("", {})
                show(message.figures, message.doing, message.waits_for)
    keeper.keep(_snapshot(local, account))
    keeper.finish()
    summary = {"hash": engine.hash, "mode": "local", "hosts": 1} | account.figures()
    return summary | {"messages_refused": {}, "finished": engine.over, "violations": engine.violations()}, why


def _snapshot(local: Local, account: Account) -> Snapshot:
    snapshot = local.snapshot()
    snapshot.figures |= account.as_data()
    return snapshot


def _end(local: Local, account: Account, ticks: float, stopped: bool) -> str:
    """Why the run is over; '' if it is not."""
    if local.engine.over:
        return "harvested"
    if local.engine.tick >= ticks:
        return "duration"
    if stopped:
        return "stopped"
    return "\n".join(["jammed", *account.jam]) if account.jam else ""


def _talk(local: Local) -> list[Event]:
    said = []
    for name, action in local.actions.items():
        if action.requests or action.answers:
            said += talk_of(name, action.requests, [(heard.sender, body) for heard, body in action.answers])
    return [Event._make(event) for event in said]
