"""The protocol with one safety net cut out at a time: each must be found by some schedule, or the
net is not needed.
"""

import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from math import inf
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from msgspec.structs import replace

from chaos.simulated.plan import draw
from chaos.simulated.scheduler import VirtualInbox
from chaos.simulated.trial import carry_out
from orchard.contract.agent import Action
from orchard.net import host, mailbox, requests
from orchard.net.ending import Ending
from orchard.net.refusals import RefusalTotals
from orchard.net.runner import AgentRunner
from orchard.processes import agents, physics
from orchard.server import barriers, commands, inbound, loop, snapshots
from orchard.server.control import RunClock, SimulationControl
from orchard.server.drivers import Drivers
from orchard.server.figures import RunFigures
from orchard.server.publisher import Publisher
from orchard.server.roster import RecoveryLog, Roster
from orchard.server.run import PhysicsRun
from orchard.sim import snapshot
from orchard.sim.engine import Engine
from orchard.wire import messages as wire
from orchard.wire.messages import Joined


class Cut(NamedTuple):
    """What takes the place of one name of a module or class."""

    owner: Any
    name: str
    replacement: Any


def _with_words(owner: Any, name: str, before: str, after: str) -> Cut:
    """Return the function of a class or module with some words of its source changed."""
    function = inspect.getattr_static(owner, name)
    source = textwrap.dedent(inspect.getsource(function))
    if source.count(before) != 1:
        raise ValueError(f"{name}: {before!r} is not in it once")
    made: dict[str, Any] = {}
    exec(source.replace(before, after), function.__globals__, made)
    return Cut(owner, name, made[name])


def _nothing(*_: Any, **__: Any) -> None:
    pass


def _expects_without_waking(self: Drivers, names: Any, holder: str) -> None:
    self._engine.wake(names)


def _keeps_the_old_answer(self: barriers.LockstepBarrier, name: str) -> None:
    if name not in self.reports:
        self.missing.add(name)


def _without_memories(run: str, tick: int, memories: Any, refused: Any) -> Joined:
    return Joined(run, tick, dict.fromkeys(memories), refused)


def _takes_any_tick(
    self: barriers.LockstepBarrier, name: str, holder: str, tick: int, report: Any
) -> None:
    if name in self.missing:
        _take(self, name, holder, self.tick, report)


def _tracks_nothing(self: host.Host, token: str, up: bool) -> None:
    self._ending.track(token, up)
    self._leave_if_over()


def _keeps_one_tick(self: RecoveryLog, tick: int, reports: Any) -> None:
    _keep(self, tick, reports)
    self.letters = {at: letters for at, letters in self.letters.items() if at >= tick}


def _keeps_all_ticks(self: RecoveryLog, tick: int, reports: Any) -> None:
    before = dict(self.letters)
    _keep(self, tick, reports)
    self.letters = before | self.letters


def _keeps_no_memory(self: RecoveryLog, tick: int, reports: Any) -> None:
    before = dict(self.memories)
    _keep(self, tick, reports)
    self.memories = before


def _checks_no_run(message: Any, run: str) -> None:
    pass


def _takes_over(self: Roster, name: str, holder: str) -> str:
    return "" if name in self.names else "there is no such agent"


def _finds_no_doubt_in_an_error(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return self._is_new(tick) or not self._has(tick, asked_of)


def _finds_no_doubt_when_new(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return not (
        self._has(tick, asked_of) and all(asked.answered for asked in self._asked.get(tick - 2, ()))
    )


def _finds_no_doubt_in_a_lack(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return self._is_new(tick) or not all(asked.answered for asked in self._asked.get(tick - 2, ()))


def _never_waits_for_mail(self: mailbox.Mailbox, tick: int, asked_of: Any) -> bool:
    return True


def _forgets_no_mail(self: mailbox.Mailbox, tick: int) -> None:
    self.last = tick - 1
    self._joined = tick


def _first_in_folder(folder: Any, run: str = "") -> Any:
    for path in snapshot._newest_first(folder, snapshot.SNAPSHOT):
        return snapshot.read(path)
    return None


def _newest_of_any_run(
    folder: Path, refused: list[str], run: str = "", examine: Any = None, until: Any = None
) -> Any:
    for path in snapshot._newest_first(folder, snapshot.SNAPSHOT):
        try:
            found = snapshot.read(path)
            examine(found)
        except snapshot.SnapshotError as error:
            refused.append(f"{path}: {error}")
        else:
            return found
    raise snapshot.SnapshotError(f"{folder}: no usable snapshot")


def _without_deeds(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    return {name: replace(action, deeds=[]) for name, action in _actions(self).items()}


def _with_deeds_twice(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    actions = _actions(self).items()
    return {name: replace(action, deeds=action.deeds * 2) for name, action in actions}


def _with_deeds_late(self: barriers.LockstepBarrier) -> Mapping[str, Action]:
    actions = _actions(self)
    deeds: dict[str, Any] = getattr(self, "late_deeds", {})
    self.late_deeds = {name: action.deeds for name, action in actions.items()}  # type: ignore[attr-defined]
    late = {name: replace(action, deeds=deeds.get(name, [])) for name, action in actions.items()}
    unasked = {
        name: replace(Action(), deeds=waiting)
        for name, waiting in deeds.items()
        if waiting and name not in actions
    }
    return {**late, **unasked}


def _keeps_what_was_not_asked(self: Drivers) -> None:
    self.release(self.answers.give_up())


def _moves_the_deadline(self: barriers.LockstepBarrier, name: str) -> None:
    self._back.discard(name)
    _expect(self, name)


def _stays_left(self: Roster, name: str, owner: str) -> None:
    self.owners[name] = self._last_owners[name] = owner


def _wakes_nobody(self: VirtualInbox, item: Any) -> None:
    self._items.append(item)


def _keeps_before_it_reports(self: loop.RunLoop) -> None:
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


def _stops_without_keeping(self: inbound.Queries, query: Any) -> None:
    keep_at_once = self._run.keep_at_once
    self._run.keep_at_once = lambda: True  # type: ignore[method-assign]
    try:
        _stop(self, query)
    finally:
        self._run.keep_at_once = keep_at_once  # type: ignore[method-assign]


def _without_stops(self: Engine) -> dict[str, Any]:
    data = _as_data(self)
    return data | {"stopped": bytes(len(data["stopped"]))}


def _counts_one_step_less(self: RunClock) -> None:
    self._left -= 1
    if self._left < 0:
        self.pause()


def _without_patience(*arguments: Any) -> host.Host:
    return host.Host(*arguments[:-1], 0.1)  # type: ignore[call-arg]


def _goes_on_while_paused(self: RunClock) -> float:
    return self._clock()


_take = barriers.LockstepBarrier.take
_keep = RecoveryLog.keep
_actions = barriers.LockstepBarrier.actions
_expect = barriers.LockstepBarrier.expect
_stop = inbound.Queries._stop
_as_data = Engine.as_data
_always: Callable[..., bool] = lambda *_, **__: True  # noqa: E731
_never: Callable[..., bool] = lambda *_, **__: False  # noqa: E731

MUTATIONS: dict[str, tuple[Cut, ...]] = {
    "physics never sends a tick again": (Cut(loop, "AGAIN_SECONDS", inf),),
    "a host never doubts its mail": (Cut(mailbox.Mailbox, "may_lack_mail", _never),),
    "no doubt after a join": (Cut(mailbox.Mailbox, "may_lack_mail", _finds_no_doubt_when_new),),
    "no doubt if an answer is missing": (
        Cut(mailbox.Mailbox, "may_lack_mail", _finds_no_doubt_in_an_error),
    ),
    "no doubt if a request is missing": (
        Cut(mailbox.Mailbox, "may_lack_mail", _finds_no_doubt_in_a_lack),
    ),
    "no tick waits for mail": (
        Cut(mailbox.Mailbox, "is_settled", _never_waits_for_mail),
        Cut(mailbox.Mailbox, "may_lack_mail", _never),
    ),
    "a host joins, and keeps its old mail": (Cut(mailbox.Mailbox, "join", _forgets_no_mail),),
    "requests of the future are not kept": (Cut(mailbox, "MOST_HOLD", 0),),
    "a recall is not recorded": (Cut(mailbox.Mailbox, "recall", _nothing),),
    "a host keeps what it saw before it joined": (
        Cut(mailbox.LatestObservations, "forget", _nothing),
    ),
    "a host goes on where physics is there again": (
        Cut(host.Host, "_track_physics", _tracks_nothing),
    ),
    "a host that is told that it is lost does not join again": (
        Cut(Publisher, "publish_lost", _nothing),
    ),
    "a question is sent once": (
        Cut(requests, "FETCH_SECONDS", 1e6),
        Cut(requests, "ANSWER_SECONDS", 1e6),
    ),
    "a join without a token is not tried again": (Cut(host, "JOIN_TRIES", 1),),
    "a join of a taken agent is not tried again": (Cut(host, "TAKEN_TRIES", 1),),
    "a host without its memory": (Cut(AgentRunner, "resume", _nothing),),
    "physics gives no memory": (Cut(wire, "Joined", _without_memories),),
    "physics keeps no memory": (Cut(RecoveryLog, "keep", _keeps_no_memory),),
    "physics keeps the letters of one tick": (Cut(RecoveryLog, "keep", _keeps_one_tick),),
    "physics keeps the letters of all ticks": (Cut(RecoveryLog, "keep", _keeps_all_ticks),),
    "physics does not ask a session that joins": (Cut(Drivers, "expect", _expects_without_waking),),
    "the answer of the session before counts": (
        Cut(barriers.LockstepBarrier, "expect", _keeps_the_old_answer),
    ),
    "an answer to any tick counts": (Cut(barriers.LockstepBarrier, "take", _takes_any_tick),),
    "an answer of any session counts": (Cut(barriers.Barrier, "_refuse_other_owner", _nothing),),
    "any session may take any agent": (Cut(Roster, "may_join", _takes_over),),
    "physics waits for no session to leave": (
        Cut(Roster, "all_have_left", _always),
        Cut(loop, "LEAVE_SECONDS", 0.0),
    ),
    "a session that is cut off counts as left": (
        Cut(Roster, "all_have_left", lambda self: not self.tokens),
    ),
    "the end is published once": (Cut(loop, "END_SECONDS", inf),),
    "any end counts": (Cut(Ending, "end", property(lambda self: self._heard)),),
    "messages of other runs count": (Cut(inbound, "refuse_other_run", _checks_no_run),),
    "a resumed run waits for no agent": (Cut(loop.RunLoop, "gather", _nothing),),
    "physics begins without its hosts after a reset": (Cut(agents, "RESET", "never"),),
    "snapshots stay after a reset": (Cut(snapshot, "_outdated", lambda path: []),),
    "the newest snapshot counts, as it is": (Cut(physics, "last", _first_in_folder),),
    "no snapshot is written": (Cut(snapshots.SnapshotWriter, "is_due", _never),),
    "a run begins before it is kept": (Cut(PhysicsRun, "keep_at_once", _always),),
    "a pause makes agents late": (Cut(RunClock, "__call__", _goes_on_while_paused),),
    "realtime: old velocities drive on": (Cut(commands.RecentTicks, "is_over", _never),),
    "physics is given up at once": (Cut(agents, "Host", _without_patience),),
    "deeds are lost": (Cut(barriers.LockstepBarrier, "actions", _without_deeds),),
    "deeds are done twice": (Cut(barriers.LockstepBarrier, "actions", _with_deeds_twice),),
    "deeds are done a tick late": (Cut(barriers.LockstepBarrier, "actions", _with_deeds_late),),
    "a silent session keeps its agents that were not asked": (
        Cut(Drivers, "give_up", _keeps_what_was_not_asked),
    ),
    "each join moves the deadline": (Cut(barriers.LockstepBarrier, "expect", _moves_the_deadline),),
    "a session that left and came back counts as left": (Cut(Roster, "join", _stays_left),),
    "an inbox is not emptied at a reset": (Cut(VirtualInbox, "forget", _nothing),),
    "what comes quietly wakes nobody": (Cut(VirtualInbox, "put_quietly", _wakes_nobody),),
    "an agent is not woken": (Cut(Engine, "wake", _nothing),),
    "one snapshot is kept": (Cut(snapshot, "KEPT", 1),),
    "a snapshot of another run counts": (Cut(snapshots, "newest", _newest_of_any_run),),
    "figures are kept before the step is reported": (
        Cut(loop.RunLoop, "_tick", _keeps_before_it_reports),
    ),
    "an emergency stop is not kept": (Cut(inbound.Queries, "_stop", _stops_without_keeping),),
    "a snapshot forgets which robots are stopped": (Cut(Engine, "as_data", _without_stops),),
    "a paused run does one step too many": (Cut(RunClock, "count_step", _counts_one_step_less),),
    "advice drives for one tick too long": (Cut(commands, "WATCHDOG_TICKS", 6),),
    "the session of a key is not checked": (Cut(inbound, "_refuse_other_session", _nothing),),
    "a token that goes is not forgotten": (
        _with_words(Roster, "token", "self.tokens.discard((name, owner))", "pass"),
    ),
    "an agent hears mail a tick late": (
        _with_words(RecoveryLog, "hearing", "self.asked(tick - 1)", "self.asked(tick - 2)"),
    ),
    "events are published with the next tick": (
        _with_words(PhysicsRun, "report", "Events(self.id, tick,", "Events(self.id, tick + 1,"),
    ),
    "letters are published with the next tick": (
        _with_words(PhysicsRun, "report", "Letters(self.id, tick,", "Letters(self.id, tick + 1,"),
    ),
    "a reset goes on from the old snapshot": (
        _with_words(physics, "simulate", "            before = None\n", ""),
    ),
    "a reset keeps the seed": (
        _with_words(loop.RunLoop, "_options_after", "scenario=reset.", "scenario=self.options."),
    ),
    "of two resets the second one keeps the seed": (
        _with_words(
            inbound.Queries,
            "_reset_simulation",
            "if wanted.seed is not None:",
            "if wanted.seed is not None and run.engine.tick < 20:",
        ),
    ),
    "a promised reset does not happen": (
        _with_words(inbound.Queries, "_reset_simulation", "raise RunReset(scenario)", "pass"),
    ),
    "a host keeps its old answer at a join": (
        _with_words(host.Host, "join", "self._answer = SentAnswer()", "pass"),
    ),
    "a robot that is reset is not kept": (
        _with_words(inbound.Queries, "_stop", "if changed else", "if request.stop else True or"),
    ),
    "what a full disk has not taken counts as kept": (
        _with_words(
            PhysicsRun,
            "is_kept",
            "return self.account.snapshot_writer.finish(KEPT_SECONDS)",
            "return self.account.snapshot_writer.finish(KEPT_SECONDS) or True",
        ),
    ),
    "realtime: a deed is done again": (
        _with_words(
            barriers.RealtimeBarrier,
            "_action",
            "replace(put.report, deeds=[],",
            "replace(put.report,",
        ),
    ),
    "a paused run does one step too few": (
        _with_words(RunClock, "count_step", "if self._left <= 0:", "if self._left <= 1:"),
    ),
    "a pause comes two steps late": (
        _with_words(SimulationControl, "set", "self.clock.pause()", "self.clock.play(2)"),
    ),
    "a run does not end when it is asked to": (
        _with_words(inbound.Queries, "_set_simulation_state", 'raise RunEnded("stopped")', "pass"),
    ),
    "a snapshot forgets which agents were lost": (
        _with_words(PhysicsRun, "keep", "lost=drivers.lost", "lost={}"),
    ),
    "a snapshot has no letters": (
        _with_words(PhysicsRun, "keep", "letters=drivers.letters()", "letters=[]"),
    ),
    "a snapshot forgets what was refused": (
        _with_words(PhysicsRun, "keep", "self.refusal_totals.as_data()", "{}"),
    ),
    "refusals of a session are added up": (
        _with_words(
            RefusalTotals,
            "hear",
            "= counts",
            "= Counter(counts) + Counter(self.there.get(session))",
        ),
    ),
    "a session that is given up keeps its agents": (
        _with_words(Roster, "release", "self.owners.pop(name)", "self.owners[name]"),
    ),
    "an answer goes to the first request of its sender": (
        _with_words(mailbox.Mailbox, "write", "heard.tick, heard.number)", "heard.tick, 0)"),
    ),
    "the last step is not reported": (
        _with_words(loop.RunLoop, "_finish", "self.run.report()", "pass"),
    ),
    "a partial join is accepted": (
        _with_words(
            Drivers,
            "join",
            "if not refused:\n        for name in names:",
            "if True:\n        for name in sorted({*names} - refused.keys()):",
        ),
    ),
    "only one silent session gets its tick again": (
        _with_words(
            loop.RunLoop,
            "_await_answers",
            "show(drivers.silent())",
            "show([*drivers.silent()][:1])",
        ),
    ),
    "a session that has answered in part loses all": (
        _with_words(
            Drivers, "give_up", "missing.issuperset(names)", "not missing.isdisjoint(names)"
        ),
    ),
    "a snapshot forgets the history": (
        _with_words(RunFigures, "as_data", "msgspec.to_builtins(self._history)", "{}"),
    ),
    "realtime: answers of a replaced action are lost": (
        _with_words(
            barriers, "_with_unused", "[*before.answers, *report.answers]", "report.answers"
        ),
    ),
    "a pause is not kept over a reset": (
        _with_words(loop.RunLoop, "_options_after", "self._clock.is_paused", "False"),
    ),
}


# What no schedule shows, and why: the test that finds it instead.
BY_TESTS: dict[str, str] = {
    "each join moves the deadline": (
        "tests/net/test_mail.py: a host is away for longer than physics waits only if others join"
        " again and again meanwhile, and while hosts are away for so long physics may wait"
    ),
    "a session that left and came back counts as left": (
        "tests/net/test_broken_links.py: no host comes back with the id of a session that has left"
    ),
    "a host joins, and keeps its old mail": (
        "tests/net/test_mail.py: mail of before must still wait when a host joins again, and agree"
        " with a later request; before, one schedule in some hundred showed it"
    ),
    "a host keeps its old answer at a join": (
        "tests/net/test_broken_links.py: an answer follows from the tick, its mail and the memory"
        " that physics has, so the old one is the new one; unless physics went on without the host"
        " to the same tick, and then no hash is promised"
    ),
    "a recall is not recorded": (
        "tests/net/test_mail.py: a request must come in the moment in which its host recalls it;"
        " before, one schedule in some hundred showed it"
    ),
    "an inbox is not emptied at a reset": (
        "tests/net/test_bus_contract.py: a host handles what is left there before it joins, and"
        " forgets all of it then; so the net matters only for items that come in between"
    ),
    "a partial join is accepted": (
        "tests/net/test_broken_links.py: a host asks again until it owns all, so a part of them"
        " must be taken for longer than it tries: 60 schedules did not show it"
    ),
    "only one silent session gets its tick again": (
        "tests/net/test_broken_links.py: two hosts must miss one tick, and the first of them be"
        " silent for as long as physics waits: 60 schedules did not show it"
    ),
    "a session that has answered in part loses all": (
        "tests/net/test_broken_links.py: a host answers for all its agents at once, so some of them"
        " can be missing only if they have joined since: 60 schedules did not show it"
    ),
    "a snapshot forgets the history": (
        "tests/sim/test_snapshot.py: schedules compare what a run publishes, and it publishes no"
        " history: it is in the summary at the end"
    ),
    "realtime: answers of a replaced action are lost": (
        "tests/server/test_realtime.py: a second action must come before the step that would use"
        " the first one, and a lost answer is one that was not given: 20 schedules in realtime did"
        " not show it"
    ),
    "a pause is not kept over a reset": (
        "tests/server/test_control.py: a run must be reset while it is paused: eight schedules with"
        " a pause and a reset did not show it"
    ),
}


@contextmanager
def cut_out(name: str) -> Iterator[None]:
    """Cut one safety net out of the protocol."""
    with ExitStack() as stack:
        for cut in MUTATIONS[name]:
            stack.enter_context(patch.object(cut.owner, cut.name, cut.replacement))
        yield


def first_seed(most: int, name: str) -> tuple[int | None, str]:
    """Return the first seed, below `most`, at which only the mutation fails, and what fails then;
    None and '' if there is none.
    """
    for seed in range(most):
        # Drawn before: what a schedule begins from is that of the whole program.
        plan = draw(seed)
        with cut_out(name):
            complaints = carry_out(plan).complaints
        if complaints and not carry_out(plan).complaints:
            return seed, complaints[0].splitlines()[0][:100]
    return None, ""
