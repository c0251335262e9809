"""When a run will be done: the event model goes on from the run's newest snapshot.

Theory of operation. The process that shows a run reads its snapshots, so the run itself is not
slower. A thread looks at the newest one every few seconds. Where people are about, several harvests
meet them at other times, which tells how sure the answer is.
"""

import threading
import time
from contextlib import suppress
from pathlib import Path
from statistics import fmean, stdev

from orchard.behaviour.catalogue import make_agents
from orchard.dispatch.policies import POLICIES
from orchard.event_model.known import refuse_unknown
from orchard.field.layout import Layout
from orchard.field.scenario import Scenario
from orchard.plans.routes import ROUTES
from orchard.report.progress import EndOfRun
from orchard.saved_run import memories_in
from orchard.sim.restore import world_from
from orchard.sim.snapshot import Snapshot, SnapshotError, newest

# s of wall time: before the first look, and between two.
FIRST_LOOK = 3.0
AGAIN = 5.0
# After a look that took long, so many times as long passes up to the next one.
PAUSE = 40.0
# Harvests with people that are met at other times.
DRAWS = 6
# Standard deviations within which it ends in 19 of 20 runs.
SURE = 2.0


class EndForecast:
    """Tells when a run will be done. It never waits, and knows nothing at first."""

    def __init__(self, layout: Layout, snapshots: Path | None, run: str = "") -> None:
        """`snapshots`: the folder of the run's snapshots. `run`: its id; '': that of the folder."""
        self._snapshots = snapshots
        self._run = run
        self._due = time.monotonic() + FIRST_LOOK
        self._looking: threading.Thread | None = None
        self._last: EndOfRun | None = None
        # Whether it looks at all.
        self.is_wanted = snapshots is not None and _is_built_in(layout.scenario)

    def __call__(self) -> EndOfRun | None:
        """Return the newest answer; None while there is none. Look again if it is time."""
        is_looking = self._looking is not None and self._looking.is_alive()
        if self.is_wanted and not is_looking and time.monotonic() >= self._due:
            self._looking = threading.Thread(target=self._look, daemon=True)
            self._looking.start()
        return self._last

    def _look(self) -> None:
        """Take the newest snapshot, and go on from it, unless the event model must be compiled."""
        # It loads numba, which takes a second.
        from orchard.event_model.kernel import entry

        if self._snapshots is None or not entry.is_ready():
            self.is_wanted = False
            return
        begun = time.monotonic()
        with suppress(SnapshotError, OSError):
            self._last = end_of(newest(self._snapshots, [], run=self._run))
        seconds = time.monotonic() - begun
        self._due = time.monotonic() + max(AGAIN, PAUSE * seconds)


def _is_built_in(scenario: Scenario) -> bool:
    """Whether the event model knows all of a scenario, which names no code of a user: a forecast
    executes none.
    """
    try:
        refuse_unknown(scenario)
    except ValueError:
        return False
    return scenario.dispatch in POLICIES and scenario.route in ROUTES


def end_of(snapshot: Snapshot) -> EndOfRun | None:
    """Return when the run of a snapshot will be done.

    None if the event model cannot go on from it, if agents are lost or left to clients elsewhere,
    or if the harvest does not end. Raises SnapshotError.
    """
    if snapshot.elsewhere or snapshot.lost:
        return None
    from orchard.event_model.begun.begin import begin_at
    from orchard.event_model.begun.moment import RunMoment

    world = world_from(snapshot)
    layout = world.layout
    if not _is_built_in(layout.scenario):
        return None
    memories = memories_in(snapshot, make_agents(layout))
    moment = RunMoment(world, memories, dict(snapshot.letters))
    # The first harvest meets people as the run's own seed has it, the others as other seeds do.
    # Where nobody is about, all would be the same.
    ends = []
    for number in range(DRAWS):
        try:
            harvest = begin_at(moment)
        except NotImplementedError:
            return None
        if number:
            harvest.meet_as_with(layout.scenario.seed + number)
            if not harvest.model.encounters.size:
                break
        if not harvest.run().is_over:
            return None
        ends.append(harvest.seconds)
    return EndOfRun(fmean(ends), SURE * stdev(ends) if len(ends) > 1 else 0.0)
