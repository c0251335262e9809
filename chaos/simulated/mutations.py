"""The protocol with one safety net cut out at a time: each must be found by some schedule, or the net is not needed."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from typing import Any, NamedTuple
from unittest.mock import patch

from chaos.simulated.schedule import complaints_of
from orchard.net import host, mailbox, requests
from orchard.net.ending import Ending
from orchard.processes import agents, physics
from orchard.server import barriers, commands, inbound, loop, snapshots
from orchard.server.control import RunClock
from orchard.server.drivers import Drivers
from orchard.server.publisher import Publisher
from orchard.server.roster import RecoveryLog, Roster
from orchard.server.run import Run
from orchard.sim import snapshot
from orchard.wire import messages as wire
from orchard.wire.messages import Joined


class Cut(NamedTuple):
    """What takes the place of one name of a module or class."""

    owner: Any
    name: str
    replacement: Any


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
    self.last, self._joined = tick - 1, tick


def _first_in_folder(folder: Any, run: str = "") -> Any:
    for path in snapshot._newest_first(folder, snapshot.SNAPSHOT):
        return snapshot.read(path)
    return None


def _without_patience(*arguments: Any) -> host.Host:
    return host.Host(*arguments[:-1], 0.1)  # type: ignore[call-arg]


def _goes_on_while_paused(self: RunClock) -> float:
    return self._clock()


_take, _keep = barriers.LockstepBarrier.take, RecoveryLog.keep
_always: Callable[..., bool] = lambda *_, **__: True  # noqa: E731
_never: Callable[..., bool] = lambda *_, **__: False  # noqa: E731

MUTATIONS: dict[str, tuple[Cut, ...]] = {
    "physics never sends a tick again": (Cut(loop, "AGAIN_SECONDS", inf),),
    "a host never doubts its mail": (Cut(mailbox.Mailbox, "doubts", _never),),
    "no doubt after a join": (Cut(mailbox.Mailbox, "doubts", _finds_no_doubt_when_new),),
    "no doubt if an answer is missing": (
        Cut(mailbox.Mailbox, "doubts", _finds_no_doubt_in_an_error),
    ),
    "no doubt if a request is missing": (
        Cut(mailbox.Mailbox, "doubts", _finds_no_doubt_in_a_lack),
    ),
    "no tick waits for mail": (
        Cut(mailbox.Mailbox, "is_settled", _never_waits_for_mail),
        Cut(mailbox.Mailbox, "doubts", _never),
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
    "a host without its memory": (Cut(host.AgentRunner, "resume", _nothing),),
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
    "any end counts": (Cut(Ending, "end", property(lambda self: self._said)),),
    "messages of other runs count": (Cut(inbound, "refuse_other_run", _checks_no_run),),
    "a resumed run waits for no agent": (Cut(loop.RunLoop, "gather", _nothing),),
    "physics begins without its hosts after a reset": (Cut(agents, "RESET", "never"),),
    "snapshots stay after a reset": (Cut(snapshot, "_outdated", lambda path: []),),
    "the newest snapshot counts, as it is": (Cut(physics, "last", _first_in_folder),),
    "no snapshot is written": (Cut(snapshots.SnapshotWriter, "is_due", _never),),
    "a run begins before it is kept": (Cut(Run, "keep_at_once", _always),),
    "a pause makes agents late": (Cut(RunClock, "__call__", _goes_on_while_paused),),
    "realtime: old velocities drive on": (Cut(commands.RecentTicks, "is_over", _never),),
    "physics is given up at once": (Cut(agents, "Host", _without_patience),),
}


@contextmanager
def cut_out(name: str) -> Iterator[None]:
    """Cut one safety net out of the protocol."""
    with ExitStack() as stack:
        for cut in MUTATIONS[name]:
            stack.enter_context(patch.object(cut.owner, cut.name, cut.replacement))
        yield


def first_seed(most: int, name: str) -> tuple[int | None, str]:
    """Return the first seed, below `most`, at which only the mutation fails, and what fails then; None and '' if there is none."""
    for seed in range(most):
        with cut_out(name):
            complaints = complaints_of(seed)
        if complaints and not complaints_of(seed):
            return seed, complaints[0].splitlines()[0][:100]
    return None, ""
