"""Follows what physics does in a schedule, whichever process has it.

It puts functions of its own around some methods of physics, and passes on what it sees to the
course (course.py), the census (census.py) and the check of drivers (driving.py).
"""

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
        # One for each physics that has begun.
        self.driving: list[Driving] = []
        # Complaints about what physics may never do.
        self._wrong: list[str] = []
        # Tick -> the refusals that were counted when its snapshot was made, which is on the disk.
        self._refused_at: dict[int, dict[str, int]] = {}
        # Tick -> the same, of each of its snapshots that may not be on the disk yet, oldest first.
        self._refused_in: dict[int, list[dict[str, int]]] = {}
        # The session of the physics that has begun last.
        self._begun: SimulatedBus | None = None

    def begin(self, loop: RunLoop, buses: Sequence[SimulatedBus], is_reset: bool) -> None:
        """Follow a loop of physics, which is about to begin.

        `buses`: the sessions that all processes of physics have had so far, that of the loop last.
        `is_reset`: a user's reset has led to it.
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
        since = 0
        if self._begun in buses:
            since = buses.index(self._begun)
        # The queries of all sessions from the last one that has begun to the one before this.
        # These are several if a run was reset again, or killed, before it had begun.
        asked: list[tuple[str, bytes]] = []
        for bus in buses[since:-1]:
            asked += bus.queries
        wanted = set()
        for key, payload in asked:
            with suppress(ValueError):
                if KEYS.parts(key) == ["reset_simulation"]:
                    seed = read(payload, ResetSimulation).seed
                    if seed is None:
                        seed = before
                    wanted.add(seed)
        after = loop.run.engine.layout.scenario.seed
        if after not in wanted:
            self._wrong.append(
                f"the run was reset to seed {after}, and not to one of {sorted(wanted)}"
            )

    def is_kept(self, tick: int) -> None:
        """Note that a snapshot of a tick is on the disk."""
        refused = self._refused_in.get(tick)
        if refused:
            # If several were made, it is not known which one is written: another one may have
            # replaced it before. The oldest one has the fewest refusals, so it never complains in
            # vain. The newest one may still be written, so it is kept.
            self._refused_at[tick] = refused[0]
            del refused[:-1]

    def _watch_refusals(self, loop: RunLoop, is_reset: bool) -> None:
        """Complain if a run that goes on has forgotten what was refused before its snapshot."""
        run = loop.run
        keep = run.keep
        before: dict[str, int] = {}
        if not is_reset:
            before = self._refused_at.get(run.engine.tick, {})
        now = run.refusal_totals.total()
        forgotten = [reason for reason, count in before.items() if now.get(reason, 0) < count]
        self._wrong += [f"what was refused is forgotten: {reason}" for reason in forgotten]

        # A physics that has died writes no snapshot any more.
        self._refused_in = {}

        def keep_and_note() -> None:
            """Note the refusals of a snapshot, and make it."""
            self._refused_in.setdefault(run.engine.tick, []).append(run.refusal_totals.total())
            keep()

        run.keep = keep_and_note  # type: ignore[method-assign]

    def _watch_releases(self, loop: RunLoop) -> None:
        """Complain if an agent is taken from a session twice, and none has joined with it since."""
        drivers = loop.run.drivers
        release = drivers.release
        join = drivers.roster.join
        released = set[str]()

        def release_and_note(names: set[str]) -> None:
            """Note that agents lose their sessions."""
            again = sorted(released.intersection(names))
            self._wrong += [f"{name} is taken from a session twice" for name in again]
            released.update(names)
            release(names)

        def join_and_note(name: str, owner: str) -> None:
            """Note that an agent has a session again."""
            released.discard(name)
            join(name, owner)

        drivers.release = release_and_note  # type: ignore[method-assign]
        drivers.roster.join = join_and_note  # type: ignore[method-assign]

    @property
    def complaints(self) -> list[str]:
        """What drivers asked for, and physics did not do. Then the first thing that it did and may
        not do, which often causes the others.
        """
        complaints: list[str] = []
        for driving in self.driving:
            complaints += driving.complaints
        return complaints + self._wrong[:1]
