"""The protocol with one safety net cut out at a time.

A mutation cuts one net out: it changes a constant, puts a stand-in in the place of a function
(stand_ins.py), or changes some words of its source. Some schedule must fail with the mutation that
does not fail without it, else the net is not needed. `python -m chaos.simulated mutations` looks
for the first such schedule of each mutation.
"""

import inspect
import textwrap
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from typing import Any, NamedTuple
from unittest.mock import patch

from chaos.simulated import stand_ins
from chaos.simulated.drawing import draw
from chaos.simulated.scheduler import VirtualInbox
from chaos.simulated.trial import carry_out
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

# Characters of a complaint that the table of mutations shows.
SHOWN = 100


class Cut(NamedTuple):
    """What takes the place of one name of a module or class."""

    owner: Any  # the module or class
    name: str
    replacement: Any


def _with_words(owner: Any, name: str, before: str, after: str) -> Cut:
    """Return the function of a class or module with some words of its source changed.

    Raises ValueError unless the words `before` are in the source once: the function has changed.
    """
    function = inspect.getattr_static(owner, name)
    source = textwrap.dedent(inspect.getsource(function))
    if source.count(before) != 1:
        raise ValueError(f"{name}: {before!r} is not in it once")
    made: dict[str, Any] = {}
    exec(source.replace(before, after), function.__globals__, made)
    return Cut(owner, name, made[name])


# What the program does with the mutation -> what is cut.
MUTATIONS: dict[str, tuple[Cut, ...]] = {
    "physics never sends a tick again": (Cut(loop, "AGAIN_SECONDS", inf),),
    "a host never doubts its mail": (Cut(mailbox.Mailbox, "may_lack_mail", stand_ins.never),),
    "no doubt after a join": (
        Cut(mailbox.Mailbox, "may_lack_mail", stand_ins.finds_no_doubt_when_new),
    ),
    "no doubt if an answer is missing": (
        Cut(mailbox.Mailbox, "may_lack_mail", stand_ins.finds_no_doubt_in_an_error),
    ),
    "no doubt if a request is missing": (
        Cut(mailbox.Mailbox, "may_lack_mail", stand_ins.finds_no_doubt_in_a_lack),
    ),
    "no tick waits for mail": (
        Cut(mailbox.Mailbox, "is_settled", stand_ins.never_waits_for_mail),
        Cut(mailbox.Mailbox, "may_lack_mail", stand_ins.never),
    ),
    "a host joins, and keeps its old mail": (
        Cut(mailbox.Mailbox, "join", stand_ins.forgets_no_mail),
    ),
    "requests of the future are not kept": (Cut(mailbox, "MOST_HOLD", 0),),
    "a recall is not recorded": (Cut(mailbox.Mailbox, "recall", stand_ins.nothing),),
    "a host keeps what it saw before it joined": (
        Cut(mailbox.LatestObservations, "forget", stand_ins.nothing),
    ),
    "a host goes on where physics is there again": (
        Cut(host.Host, "_track_physics", stand_ins.tracks_nothing),
    ),
    "a host that is told that it is lost does not join again": (
        Cut(Publisher, "publish_lost", stand_ins.nothing),
    ),
    "a question is sent once": (
        Cut(requests, "FETCH_SECONDS", 1e6),
        Cut(requests, "ANSWER_SECONDS", 1e6),
    ),
    "a join without a token is not tried again": (Cut(host, "JOIN_TRIES", 1),),
    "a join of a taken agent is not tried again": (Cut(host, "TAKEN_TRIES", 1),),
    "a host without its memory": (Cut(AgentRunner, "resume", stand_ins.nothing),),
    "physics gives no memory": (Cut(wire, "Joined", stand_ins.without_memories),),
    "physics keeps no memory": (Cut(RecoveryLog, "keep", stand_ins.keeps_no_memory),),
    "physics keeps the letters of one tick": (Cut(RecoveryLog, "keep", stand_ins.keeps_one_tick),),
    "physics keeps the letters of all ticks": (
        Cut(RecoveryLog, "keep", stand_ins.keeps_all_ticks),
    ),
    "physics does not ask a session that joins": (
        Cut(Drivers, "expect", stand_ins.expects_without_waking),
    ),
    "the answer of the session before counts": (
        Cut(barriers.LockstepBarrier, "expect", stand_ins.keeps_the_old_answer),
    ),
    "an answer to any tick counts": (
        Cut(barriers.LockstepBarrier, "take", stand_ins.takes_any_tick),
    ),
    "an answer of any session counts": (
        Cut(barriers.Barrier, "_refuse_other_owner", stand_ins.nothing),
    ),
    "any session may take any agent": (Cut(Roster, "may_join", stand_ins.takes_over),),
    "physics waits for no session to leave": (
        Cut(Roster, "all_have_left", stand_ins.always),
        Cut(loop, "LEAVE_SECONDS", 0.0),
    ),
    "a session that is cut off counts as left": (
        Cut(Roster, "all_have_left", lambda self: not self.tokens),
    ),
    "the end is published once": (Cut(loop, "END_SECONDS", inf),),
    "any end counts": (Cut(Ending, "end", property(lambda self: self._heard)),),
    "messages of other runs count": (Cut(inbound, "refuse_other_run", stand_ins.checks_no_run),),
    "a resumed run waits for no agent": (Cut(loop.RunLoop, "gather", stand_ins.nothing),),
    "physics begins without its hosts after a reset": (Cut(agents, "RESET", "never"),),
    "snapshots stay after a reset": (Cut(snapshot, "_outdated", lambda path: []),),
    "the newest snapshot counts, as it is": (Cut(physics, "last", stand_ins.first_in_folder),),
    "no snapshot is written": (Cut(snapshots.SnapshotWriter, "is_due", stand_ins.never),),
    "a run begins before it is kept": (Cut(PhysicsRun, "keep_at_once", stand_ins.always),),
    "a pause makes agents late": (Cut(RunClock, "__call__", stand_ins.goes_on_while_paused),),
    "realtime: old velocities drive on": (Cut(commands.RecentTicks, "is_over", stand_ins.never),),
    "physics is given up at once": (Cut(agents, "Host", stand_ins.without_patience),),
    "deeds are lost": (Cut(barriers.LockstepBarrier, "actions", stand_ins.without_deeds),),
    "deeds are done twice": (Cut(barriers.LockstepBarrier, "actions", stand_ins.with_deeds_twice),),
    "deeds are done a tick late": (
        Cut(barriers.LockstepBarrier, "actions", stand_ins.with_deeds_late),
    ),
    "a silent session keeps its agents that were not asked": (
        Cut(Drivers, "give_up", stand_ins.keeps_what_was_not_asked),
    ),
    "each join moves the deadline": (
        Cut(barriers.LockstepBarrier, "expect", stand_ins.moves_the_deadline),
    ),
    "a session that left and came back counts as left": (
        Cut(Roster, "join", stand_ins.stays_left),
    ),
    "an inbox is not emptied at a reset": (Cut(VirtualInbox, "forget", stand_ins.nothing),),
    "what comes quietly wakes nobody": (Cut(VirtualInbox, "put_quietly", stand_ins.wakes_nobody),),
    "an agent is not woken": (Cut(Engine, "wake", stand_ins.nothing),),
    "one snapshot is kept": (Cut(snapshot, "KEPT", 1),),
    "a snapshot of another run counts": (Cut(snapshots, "newest", stand_ins.newest_of_any_run),),
    "figures are kept before the step is reported": (
        Cut(loop.RunLoop, "_tick", stand_ins.keeps_before_it_reports),
    ),
    "an emergency stop is not kept": (
        Cut(inbound.Queries, "_stop", stand_ins.stops_without_keeping),
    ),
    "a snapshot forgets which robots are stopped": (
        Cut(Engine, "as_data", stand_ins.without_stops),
    ),
    "a paused run does one step too many": (
        Cut(RunClock, "count_step", stand_ins.counts_one_step_less),
    ),
    "advice drives for one tick too long": (Cut(commands, "WATCHDOG_TICKS", 6),),
    "the session of a key is not checked": (
        Cut(inbound, "_refuse_other_session", stand_ins.nothing),
    ),
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
        _with_words(
            inbound.Queries,
            "_stop",
            "run.keep_at_once()",
            "not request.stop or run.keep_at_once()",
        ),
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
            "replace(timed.report, deeds=[],",
            "replace(timed.report,",
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


# Mutation -> the test that finds it, and why no schedule does.
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
        "tests/net/test_inbox.py: a host handles what is left there before it joins, and"
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
    """Return the first seed at which the program fails with a mutation, and not without it.

    Return, too, the complaint. If no seed below `most` does it, return None and ''.
    """
    for seed in range(most):
        # It is drawn before the cut: what a schedule begins from must be that of the whole program.
        plan = draw(seed)
        with cut_out(name):
            complaints = carry_out(plan).complaints
        if complaints and not carry_out(plan).complaints:
            return seed, complaints[0].splitlines()[0][:SHOWN]
    return None, ""
