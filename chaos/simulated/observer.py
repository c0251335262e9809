"""Follows what physics does in a schedule, whichever process has it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

from chaos.simulated.census import KEYS, Census
from chaos.simulated.course import Course
from chaos.simulated.driving import Driving
from chaos.simulated.session import SimulatedBus
from orchard.contract.events import Event
from orchard.contract.messages import Written
from orchard.server.loop import RunLoop
from orchard.wire.messages import ResetSimulation, read


class Observer:
    """Knows each step that physics reports, and what drivers asked for."""

    def __init__(self, scene: str, census: Census, clock: Callable[[], float]) -> None:
        """`clock`: of the schedule, s."""
        self.course = Course(scene, clock)
        self._census = census
        self.driving: list[Driving] = []  # of each physics that has begun
        # What no physics may do, and one has done.
        self._wrong: list[str] = []
        # Tick -> the refusals that were counted when the snapshot of it was made that is on the
        # disk; and of each one that may not be there yet, the oldest first.
        self._refused_at: dict[int, dict[str, int]] = {}
        self._refused_in: dict[int, list[dict[str, int]]] = {}
        self._begun: SimulatedBus | None = None  # the session of the last one

    def begin(self, loop: RunLoop, buses: Sequence[SimulatedBus], is_reset: bool) -> None:
        """Follow a loop of physics, which is about to begin.

        `buses`: the sessions that physics has had so far, its own the last.
        """
        bus = buses[-1]
        if is_reset:
            self._watch_seed(loop, buses)
        self._begun = bus
        account = loop.run.account
        drivers = loop.run.drivers
        engine = loop.run.engine
        driving = Driving(engine)
        update = account.update
        self.driving.append(driving)
        self.course.begin(engine.layout.scenario.model_dump(), engine.tick, is_reset)
        bus.listener = driving.hear

        def update_and_tell(events: list[Event], letters: Mapping[str, Written]) -> None:
            update(events, letters)
            tick = engine.tick - 1
            self._census.step(events, letters)
            self.course.add(tick, events, letters, engine.digest, is_whole=not drivers.lost)
            driving.step(tick, events)

        account.update = update_and_tell  # type: ignore[method-assign]
        self._watch_refusals(loop, is_reset)
        self._watch_releases(loop)

    def _watch_seed(self, loop: RunLoop, buses: Sequence[SimulatedBus]) -> None:
        """Complain about a run that has begun again with a seed for which nobody has asked it."""
        before = self.course.parts[-1].scenario["seed"]
        since = buses.index(self._begun) if self._begun in buses else 0
        # More than one session, if a run was reset again, or killed, before it had begun.
        asked = [query for bus in buses[since:-1] for query in bus.queries]
        wanted = set()
        for key, payload in asked:
            with suppress(ValueError):
                if KEYS.parts(key) == ["reset_simulation"]:
                    seed = read(payload, ResetSimulation).seed
                    wanted.add(before if seed is None else seed)
        after = loop.run.engine.layout.scenario.seed
        if after not in wanted:
            self._wrong.append(
                f"the run was reset to seed {after}, and not to one of {sorted(wanted)}"
            )

    def is_kept(self, tick: int) -> None:
        """Know that a snapshot is on the disk."""
        if refused := self._refused_in.get(tick):
            # One that another one replaces before it is written makes this no stricter.
            self._refused_at[tick] = refused[0]
            del refused[:-1]

    def _watch_refusals(self, loop: RunLoop, is_reset: bool) -> None:
        """Complain if a run that goes on has forgotten what was refused before its snapshot."""
        run = loop.run
        keep = run.keep
        before = {} if is_reset else self._refused_at.get(run.engine.tick, {})
        now = run.refusal_totals.total()
        forgotten = [reason for reason, count in before.items() if now.get(reason, 0) < count]
        self._wrong += [f"what was refused is forgotten: {reason}" for reason in forgotten]

        self._refused_in = {}

        def keep_and_know() -> None:
            self._refused_in.setdefault(run.engine.tick, []).append(run.refusal_totals.total())
            keep()

        run.keep = keep_and_know  # type: ignore[method-assign]

    def _watch_releases(self, loop: RunLoop) -> None:
        """Complain if an agent is taken from a session twice, and none has joined with it since."""
        drivers = loop.run.drivers
        release = drivers.release
        join = drivers.roster.join
        released = set[str]()

        def release_and_know(names: set[str]) -> None:
            again = sorted(released.intersection(names))
            self._wrong += [f"{name} is taken from a session twice" for name in again]
            released.update(names)
            release(names)

        def join_and_know(name: str, owner: str) -> None:
            released.discard(name)
            join(name, owner)

        drivers.release = release_and_know  # type: ignore[method-assign]
        drivers.roster.join = join_and_know  # type: ignore[method-assign]

    @property
    def complaints(self) -> list[str]:
        """What drivers asked for, and physics did not do; and what it may not do."""
        of_drivers = [one for driving in self.driving for one in driving.complaints]
        return of_drivers + self._wrong[:1]
