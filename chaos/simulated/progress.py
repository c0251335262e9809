"""Whether physics, started again, goes on near the tick that it had come to.

A snapshot is written often, so it must not go back far. After a reset it must not go back to before
the reset.
"""

from chaos.simulated.plan import Plan
from chaos.simulated.processes import SimulatedProcess, World
from orchard.sim.engine import Engine

# A snapshot is at most so many looks of run.py old: it is due each 0.5 s, and takes at most 0.2 s.
LOOKS = 8


class Progress:
    """Follows the engines of a schedule: a new one begins with each physics and each reset."""

    def __init__(self, plan: Plan) -> None:
        self.complaints: list[str] = []
        # The process that has the engine.
        self.process: SimulatedProcess | None = None
        # Whether all snapshots can be read that were written.
        self._is_disk_whole = not plan.has("full disk", "torn snapshot", "foreign snapshot")
        # Whether all snapshots can be written.
        self._has_disk = not plan.has("full disk")
        self._engine: Engine | None = None
        self._seed = -1
        self._resets = 0
        # The ticks of the engine at the last LOOKS looks at which it had gone on.
        self._ticks: list[int] = []

    def forget(self) -> None:
        """Note that a user has forked the run: the next physics has another scenario."""
        self.process = None

    def look(self, world: World) -> None:
        """Look at the tick that physics has come to."""
        if world.engine is not self._engine and world.engine is not None:
            self._begin(world, world.engine)
        if self._engine is not None and (not self._ticks or self._engine.tick > self._ticks[-1]):
            self._ticks = [*self._ticks, self._engine.tick][-LOOKS:]

    def _begin(self, world: World, engine: Engine) -> None:
        """Follow another engine."""
        before = self.process
        self.process = world.physics
        tick = world.begun_at
        seed = engine.layout.scenario.seed
        # Another process goes on with the run, and no reset came in between.
        is_restart = self.process is not before and before is not None
        if is_restart and world.begun_after == self._resets:
            is_long_ago = len(self._ticks) == LOOKS and tick < self._ticks[0]
            if self._is_disk_whole and is_long_ago:
                self.complaints.append(f"physics went back from tick {self._ticks[-1]} to {tick}")
            if seed != self._seed and (tick > 0 or self._has_disk):
                self.complaints.append("physics went back to before a reset")
        self._engine = engine
        self._seed = seed
        self._resets = world.begun_after
        self._ticks = []
