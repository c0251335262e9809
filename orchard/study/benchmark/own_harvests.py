"""The harvests of a user's own policy: several at a time, each asked in a process of its own."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Event

from orchard.behaviour.dispatcher import PolicyFault
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.study.benchmark.asked import (
    GLANCE,
    AskingStopped,
    Limits,
    PolicyProcess,
    PolicyRefused,
    TooSlow,
)
from orchard.study.benchmark.play import Played, play
from orchard.study.runs import RunFailed


@dataclass(frozen=True)
class OwnHarvest:
    """A harvest to do."""

    orchard: str
    #: Its seed is that of the harvest.
    scenario: Scenario


@dataclass(frozen=True)
class OwnResult:
    """The result of a harvest."""

    played: Played
    #: What took too long, so that its score is 0; '' if nothing did.
    too_slow: str = ""


def check_policy(policy: str, scenario: Scenario, limits: Limits) -> None:
    """Make a policy once. Raises ScenarioError for one that cannot be used."""
    with PolicyProcess(policy, limits) as process:
        try:
            process.begin(scenario)
        except (PolicyRefused, PolicyFault, TooSlow) as error:
            raise ScenarioError([Problem("scenario", str(error), "dispatch", policy)]) from None


class OwnHarvests:
    """Does harvests with a policy, several at a time.

    Threads do them, because a harvest mostly waits for the process of its policy.
    """

    def __init__(self, policy: str, limits: Limits, count: int) -> None:
        """`count`: how many processes of the policy there are, and as many threads."""
        self._policy = policy
        self._limits = limits
        self._count = count
        # The attribute `version` of the policy's class; '' before the first harvest.
        self.version = ""

    def do(
        self,
        harvests: Sequence[OwnHarvest],
        is_stopped: Callable[[], bool],
    ) -> list[OwnResult] | None:
        """Return the result of each harvest; None if the user stopped the benchmark.

        Raises RunFailed with the first one, in their order, that failed.
        """
        batch = _Batch(harvests)
        with ThreadPoolExecutor(self._count) as threads:
            working = {threads.submit(self._work, batch) for _ in range(self._count)}
            while working:
                done, working = wait(working, GLANCE)
                if is_stopped():
                    batch.is_over.set()
                for future in done:
                    # It raises if the thread failed.
                    future.result()
        if batch.faults:
            raise RunFailed(batch.faults[min(batch.faults)])
        if len(batch.results) < len(harvests):
            return None
        return [batch.results[number] for number in range(len(harvests))]

    def _work(self, batch: "_Batch") -> None:
        """Do harvests of a batch until it is over, in one process of the policy."""
        with PolicyProcess(self._policy, self._limits, batch.is_over.is_set) as process:
            while not batch.is_over.is_set():
                try:
                    number = batch.queue.get_nowait()
                except Empty:
                    return
                try:
                    batch.results[number] = _played(process, batch.harvests[number])
                    self.version = process.version
                except AskingStopped:
                    return
                except (PolicyFault, PolicyRefused) as fault:
                    batch.fail(number, str(fault))


class _Batch:
    """Harvests to do, by their numbers, and their results. All threads share it.

    Each thread takes the next number from the queue. Dictionaries and queues may be used by several
    threads at once.
    """

    def __init__(self, harvests: Sequence[OwnHarvest]) -> None:
        self.harvests = harvests
        self.queue = SimpleQueue[int]()
        for number in range(len(harvests)):
            self.queue.put(number)
        self.results = dict[int, OwnResult]()
        self.faults = dict[int, str]()
        self.is_over = Event()

    def fail(self, number: int, fault: str) -> None:
        """Note that a harvest failed, and let no other one begin."""
        harvest = self.harvests[number]
        self.faults[number] = f"{harvest.orchard}, seed {harvest.scenario.seed}: {fault}"
        self.is_over.set()


def _played(process: PolicyProcess, harvest: OwnHarvest) -> OwnResult:
    """Do a harvest. If the policy is too slow it is given up, and counts as never finished.

    Raises PolicyFault, PolicyRefused or AskingStopped.
    """
    layout = lay_out(harvest.scenario)
    try:
        is_early = process.begin(harvest.scenario)
        played = play(layout, is_early, process.orders)
        process.end()
    except TooSlow as error:
        return OwnResult(Played(seconds=None), str(error))
    return OwnResult(played)
