"""The course of a run of many processes: what physics reported of each step.

It is compared with local mode, which does the same (reference.py). A run has several parts: a new
one begins at a reset and at a fork. The observer (observer.py) tells it what happens.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from math import inf
from typing import Any, NamedTuple

from chaos.simulated.harvest import digest_of_figures, digest_of_step, harvest_of
from chaos.simulated.link import LEASE
from chaos.simulated.reference import HarvestReference, Reference, Replay, first_moment
from chaos.simulated.scenes import SCENES
from orchard.contract.events import Event
from orchard.contract.messages import Written, pack, type_of, unpack
from orchard.field.scenario import Scenario
from orchard.sim.snapshot import Snapshot

LATCHED = ("stopped", "reset")  # events of emergency stops
# s for which figures of a physics that is gone may be under way: a link that is silent keeps them
# for its lease, and then they take some more time.
LATE_SECONDS = LEASE + 3.0


class Step(NamedTuple):
    """What physics reported of a step."""

    digest: bytes  # of events and messages
    hash: bytes  # of the run, after the step
    events: list[Event]
    sent: list[tuple[int, str, str]]  # of each message of agents: its tick, its type, its sender
    is_whole: bool  # whether lockstep has waited for all agents until then


class Forgotten(NamedTuple):
    """Ticks that physics has simulated before it was started again from an earlier snapshot.

    An emergency stop in one of them is forgotten, if it was not kept. Then the figures that physics
    had published of these ticks do not fit the run as it goes on.
    """

    reference: Reference  # what local mode does with the emergency stops of that time
    first: int  # the tick from which physics goes on
    last: int  # the tick to which it had come before
    until: float  # s, virtual: when such figures may arrive at the latest


class Said(NamedTuple):
    """Figures that were published."""

    tick: int
    digest: bytes
    is_whole: bool  # whether lockstep has waited for all agents until then
    at: float  # when they arrived, s


class Part:
    """A part of a run: from its beginning, a reset or a fork on.

    A step that is simulated again takes the place of the one before.
    """

    def __init__(
        self,
        scenario: Mapping[str, Any],
        reference: Reference,
        figures: Collection[int],
        first: int = 0,
    ) -> None:
        """`reference`: what local mode does without emergency stops.

        `figures`: the ticks at which figures were published. `first`: its first tick.
        """
        self.scenario = scenario
        self.first = first
        self._reference = reference
        self._figures = figures
        # Packed emergency stops -> what local mode does with them.
        self._commanded: dict[bytes, Reference] = {}
        # Tick -> the step from it.
        self.steps: dict[int, Step] = {}
        # s, virtual: when another part began; infinity: it is the present one.
        self.ended_at = inf
        # Whether a user has ended it by a reset.
        self.was_reset = False

    @property
    def tick(self) -> int:
        """The tick to which it has come."""
        return max(self.steps, default=self.first - 1) + 1

    @property
    def reference(self) -> Reference:
        """What local mode does, with the emergency stops of this run."""
        commands = {}
        for tick, step in self.steps.items():
            stops = [event for event in step.events if event.what in LATCHED]
            if stops:
                commands[tick] = stops
        if not commands:
            return self._reference
        key = pack(sorted(commands.items()))
        if key not in self._commanded:
            self._commanded[key] = self._reference.commanded(commands, self._figures)
        return self._commanded[key]

    def differences(self) -> Iterator[str]:
        """Yield a sentence on the first step that is another one than in local mode."""
        reference = self.reference
        for tick, step in sorted(self.steps.items()):
            if not step.is_whole:
                # An agent was lost: from here on nothing is promised.
                return
            if step.digest != reference.step_at(tick):
                yield f"other events or messages than in local mode: tick {tick}"
                return
            if step.hash != reference.hash_at(tick + 1):
                yield f"another hash than local mode: tick {tick + 1}"
                return

    @property
    def events(self) -> list[Event]:
        """The events of all steps, in their order."""
        return [event for _, step in sorted(self.steps.items()) for event in step.events]


class Course:
    """All parts of a run. The last one is the present one."""

    def __init__(self, scene: str, clock: Callable[[], float]) -> None:
        """`clock`: of the schedule, s."""
        self._clock = clock
        self._scenario = Scenario(**SCENES[scene]).model_dump()
        self._harvest = HarvestReference(harvest_of(scene))
        # The ticks at which figures were published.
        self._figure_ticks: set[int] = set()
        self.parts = [Part(self._scenario, self._harvest, self._figure_ticks)]
        # Whether the present part began with a reset.
        self.is_reset = False
        # How many resets there were.
        self.resets = 0
        # Complaints: after these ticks physics no longer knew that some agents had been lost.
        self.forgotten: list[str] = []
        self._figures: list[Said] = []
        # One for each restart of physics.
        self._forgotten_ticks: list[Forgotten] = []
        # Whether lockstep has waited for all agents until now.
        self.is_whole = True

    def begin(self, scenario: Mapping[str, Any], tick: int, is_reset: bool) -> None:
        """Note that physics begins with a scenario at a tick. `is_reset`: after a user's reset."""
        if is_reset:
            self.is_reset = True
            self.resets += 1
            self.parts[-1].was_reset = True
            reference: Reference = self._harvest
            if scenario != self._scenario:
                reference = replay_of(pack(scenario))
            self._begin_part(Part(scenario, reference, self._figure_ticks))
            return
        if scenario != self.parts[-1].scenario:
            # Physics has died before a reset was kept. So it goes on with the run before it, whose
            # part is the last one with this scenario.
            same = [part for part in self.parts if part.scenario == scenario]
            if same:
                self._begin_part(same[-1])
            self.is_reset = False
        elif tick < self.parts[-1].first:
            # The snapshot that a fork began with is torn, and there is none before.
            self._begin_part(Part(scenario, replay_of(pack(scenario)), self._figure_ticks))
        part = self.parts[-1]
        until = self._clock() + LATE_SECONDS
        self._forgotten_ticks.append(Forgotten(part.reference, tick, part.tick, until))

    def _begin_part(self, part: Part) -> None:
        """Let a part be the present one."""
        self.parts[-1].ended_at = self._clock()
        part.ended_at = inf
        self.parts.append(part)

    def fork(self, begin: Snapshot) -> None:
        """Note that the run goes on from a snapshot with changes."""
        replay = Replay(begin, figures=self._figure_ticks)
        self._begin_part(Part(begin.scenario, replay, self._figure_ticks, begin.tick))
        self.is_reset = False

    def add(
        self,
        tick: int,
        events: Sequence[Event],
        letters: Mapping[str, Written],
        digest: bytes,
        is_whole: bool,
    ) -> None:
        """Add the step from a tick.

        `letters`: sender -> its letters. `digest`: the run's hash after the step. `is_whole`:
        whether lockstep has waited for all agents until then.
        """
        self.is_whole = is_whole
        before = self.parts[-1].steps.get(tick - 1)
        if is_whole and before is not None and not before.is_whole:
            self.forgotten.append(f"the agents that were lost are forgotten: tick {tick}")
        sent = []
        for sender, written in letters.items():
            for _, body in written.sent:
                sent.append((tick, type_of(body), sender))
        step = Step(digest_of_step(events, letters), digest, list(events), sent, is_whole)
        self.parts[-1].steps[tick] = step

    def hear_figures(self, figures: Mapping[str, Any]) -> None:
        """Take figures that were published."""
        tick = figures["ticks"]
        self.want_figures(tick)
        said = Said(tick, digest_of_figures(figures), self.is_whole, self._clock())
        self._figures.append(said)

    def want_figures(self, tick: int) -> None:
        """Note that figures of a tick are to be compared with those of local mode."""
        self._figure_ticks.add(tick)

    def differences(self, with_figures: bool) -> Iterator[str]:
        """Yield a sentence on what is not as in local mode: steps, and figures that were
        published.
        """
        for part in self.parts:
            yield from part.differences()
        if not with_figures:
            return
        for said in self._figures:
            if said.is_whole and not self._fits_a_reference(said):
                yield f"other figures than in local mode: tick {said.tick}"
                return

    def _fits_a_reference(self, said: Said) -> bool:
        """Whether some run of local mode has these figures."""
        for reference in self._references_of(said):
            if said.digest == reference.figures_at(said.tick):
                return True
        return False

    def _references_of(self, said: Said) -> Iterator[Reference]:
        """Yield the runs of local mode of which figures may be.

        They may arrive late: then they may be of the part before, or of ticks that physics has
        forgotten since.
        """
        for part in self.parts:
            if said.at <= part.ended_at + LATE_SECONDS:
                yield part.reference
        for forgotten in self._forgotten_ticks:
            is_of_these_ticks = forgotten.first <= said.tick <= forgotten.last
            if is_of_these_ticks and said.at <= forgotten.until:
                yield forgotten.reference

    def has(self, tick: int, what: str, names: Sequence[str]) -> bool:
        """Whether robots were stopped or reset at a tick.

        It is True, too, if the run was reset at that tick: then there is no step that tells it.
        `what`: "stopped" or "reset".
        """
        found: set[str] = set()
        for part in self.parts:
            if part.was_reset and part.first <= tick and part.tick == tick:
                return True
            if tick in part.steps:
                found.update(event.who for event in part.steps[tick].events if event.what == what)
        return found.issuperset(names)


@lru_cache(maxsize=4 * len(SCENES))
def replay_of(scenario: bytes) -> Replay:
    """Return local mode's run of a packed scenario, from its first tick."""
    return Replay(first_moment(unpack(scenario, dict[str, Any])))


def summary_digest(summary: Mapping[str, Any], figures: Mapping[str, Any]) -> bytes:
    """Return the digest of those figures in a summary that a run publishes, too."""
    return digest_of_figures({key: summary[key] for key in figures})
