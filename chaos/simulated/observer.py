"""Follows what physics does in a schedule, whichever process has it."""

from collections.abc import Mapping

from chaos.simulated.census import Census
from chaos.simulated.course import Course
from chaos.simulated.driving import Driving
from chaos.simulated.session import SimulatedBus
from orchard.contract.events import Event
from orchard.contract.messages import Written
from orchard.server.loop import RunLoop


class Observer:
    """Knows each step that physics reports, and what drivers asked for."""

    def __init__(self, scene: str, census: Census) -> None:
        self.course = Course(scene)
        self._census = census
        self.driving: list[Driving] = []  # of each physics that has begun

    def begin(self, loop: RunLoop, bus: SimulatedBus, is_reset: bool) -> None:
        """Follow a loop of physics, which is about to begin. `bus`: its session."""
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

    @property
    def complaints(self) -> list[str]:
        """What drivers asked for, and physics did not do."""
        return [complaint for driving in self.driving for complaint in driving.complaints]
