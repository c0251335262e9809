"""What stands in for a part of the protocol when a safety net is cut out.

The name of a function says what the program does with it. `mutations.py` says in the place of which
function it stands, and which net that cuts out.
"""

# ruff: noqa: D103 - each name says what the part does

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from chaos.simulated.scheduler import VirtualInbox
from orchard.contract.agent import Action
from orchard.net import host, mailbox
from orchard.server import barriers, inbound, loop
from orchard.server.control import RunClock
from orchard.server.drivers import Drivers
from orchard.server.roster import RecoveryLog, Roster
from orchard.sim import snapshot
from orchard.sim.engine import Engine
from orchard.wire.messages import Joined

# The functions as they are without a cut. Stand-ins call them, so they are looked up before.
_take = barriers.LockstepBarrier.take
_keep = RecoveryLog.keep
_actions = barriers.LockstepBarrier.actions
_expect = barriers.LockstepBarrier.expect
_stop = inbound.Queries._stop
_as_data = Engine.as_data


def always(*_: Any, **__: Any) -> bool:
    return True


def never(*_: Any, **__: Any) -> bool:
    return False


def nothing(*_: Any, **__: Any) -> None:
    pass


def expects_without_waking(self: Drivers, names: Any, holder: str) -> None:
    self._engine.wake(names)


def keeps_the_old_answer(self: barriers.LockstepBarrier, name: str) -> None:
    if name not in self.reports:
        self.missing.add(name)


def without_memories(run: str, tick: int, memories: Any, refused: Any) -> Joined:
    return Joined(run, tick, dict.fromkeys(memories), refused)


def takes_any_tick(
    self: barriers.LockstepBarrier, name: str, holder: str, tick: int, report: Any
) -> None:
    if name in self.missing:
        _take(self, name, holder, self.tick, report)


def tracks_nothing(self: host.Host, token: str, up: bool) -> None:
    self._ending.track(token, up)
    self._leave_if_over()


def keeps_one_tick(self: RecoveryLog, tick: int, reports: Any) -> None:
    _keep(self, tick, reports)
    self.letters = {at: letters for at, letters in self.letters.items() if at >= tick}


def keeps_all_ticks(self: RecoveryLog, tick: int, reports: Any) -> None:
    before = dict(self.letters)
    _keep(self, tick, reports)
    self.letters = before | self.letters


def keeps_no_memory(self: RecoveryLog, tick: int, reports: Any) -> None:
    before = dict(self.memories)
    _keep(self, tick, reports)
    self.memories = before


def checks_no_run(message: Any, run: str) -> None:
    pass


def takes_over(self: Roster, name: str, holder: str) -> str:
    if name in self.names:
        return ""
    return "there is no such agent"


def finds_no_doubt_in_an_error(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return self._is_new(tick) or not self._has(tick, asked_of)


def finds_no_doubt_when_new(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    is_answered = all(asked.answered for asked in self._asked.get(tick - 2, ()))
    return not is_answered or not self._has(tick, asked_of)


def finds_no_doubt_in_a_lack(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return self._is_new(tick) or not all(asked.answered for asked in self._asked.get(tick - 2, ()))


def never_waits_for_mail(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return True


def forgets_no_mail(self: mailbox.Mailbox, tick: int) -> None:
    self.last = tick - 1
    self._joined = tick


def first_in_folder(folder: Any, run: str = "") -> Any:
    for path in snapshot._highest_tick_first(folder, snapshot.SNAPSHOT):
        return snapshot.read(path)
    return None


def newest_of_any_run(
    folder: Path, refused: list[str], run: str = "", examine: Any = None, until: Any = None
) -> Any:
    for path in snapshot._highest_tick_first(folder, snapshot.SNAPSHOT):
        try:
            found = snapshot.read(path)
            examine(found)
        except snapshot.SnapshotError as error:
            refused.append(f"{path}: {error}")
        else:
            return found
    raise snapshot.SnapshotError(f"{folder}: no usable snapshot")


def without_deeds(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    return {name: replace(action, deeds=[]) for name, action in _actions(self).items()}


def with_deeds_twice(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    actions = _actions(self).items()
    return {name: replace(action, deeds=action.deeds * 2) for name, action in actions}


def with_deeds_late(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    actions = _actions(self)
    # The deeds of the tick before, by name; the barrier keeps them.
    deeds: dict[str, Any] = getattr(self, "late_deeds", {})
    self.late_deeds = {name: action.deeds for name, action in actions.items()}  # type: ignore[attr-defined]
    late = {name: replace(action, deeds=deeds.get(name, [])) for name, action in actions.items()}
    # An agent that is not asked at this tick does its late deeds, too.
    for name, waiting in deeds.items():
        if waiting and name not in actions:
            late[name] = replace(Action(), deeds=waiting)
    return late


def keeps_what_was_not_asked(self: Drivers) -> None:
    self.release(self.answers.give_up())


def moves_the_deadline(self: barriers.LockstepBarrier, name: str) -> None:
    self._taken.discard(name)
    _expect(self, name)


def stays_left(self: Roster, name: str, owner: str) -> None:
    self.owners[name] = owner
    self._last_owners[name] = owner


def wakes_nobody(self: VirtualInbox, item: Any) -> None:
    self._items.append(item)


def keeps_before_it_reports(self: loop.RunLoop) -> None:
    # As `RunLoop._tick`, but `report` comes after `keep`, and `keep` finds nothing to report.
    pending = self.run._pending
    self.run._pending = None
    self._drivers.begin(self._engine.observe(), self._pacer.begin())
    self._engine.account()
    if self.run.account.snapshot_writer.is_due(self._engine.tick):
        self.run.keep()
    self.run._pending = pending
    self.run.report()
    self._await_step()
    self.run.step()


def stops_without_keeping(self: inbound.Queries, query: Any) -> None:
    keep_at_once = self._run.keep_at_once
    self._run.keep_at_once = lambda: True  # type: ignore[method-assign]
    try:
        _stop(self, query)
    finally:
        self._run.keep_at_once = keep_at_once  # type: ignore[method-assign]


def without_stops(self: Engine) -> dict[str, Any]:
    data = _as_data(self)
    return data | {"stopped": bytes(len(data["stopped"]))}


def counts_one_step_less(self: RunClock) -> None:
    self._left -= 1
    if self._left < 0:
        self.pause()


def without_patience(*arguments: Any, **keywords: Any) -> host.Host:
    return host.Host(*arguments, **keywords | {"patience": 0.1})


def goes_on_while_paused(self: RunClock) -> float:
    return self._clock()
