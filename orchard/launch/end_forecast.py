"""When a run will be done: the event model goes on from the run's newest snapshot.

Theory of operation. The process that shows a run reads its snapshots, so the run itself is not
slower. A thread looks at the newest one every few seconds. Where people walk, the event model does
several harvests, which meet them at different times: how much their ends differ tells how sure the
answer is.
"""

import threading
import time
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from statistics import fmean, stdev

from orchard.begun_harvest import harvest_from, is_built_in
from orchard.field.layout import Layout
from orchard.report.progress import EndOfRun
from orchard.sim.snapshot import Snapshot, SnapshotError, newest

# s of wall time: before the first look, and between two.
FIRST_LOOK = 3.0
AGAIN = 5.0
# The pause after a look, in lengths of that look: so it takes at most 1/40 of a core.
PAUSE = 40.0
# Harvests of one look, where people walk.
DRAWS = 6
# Standard deviations from the mean within which 19 of 20 runs end, as of a normal distribution.
SURE = 2.0


class EndForecast:
    """Tells when a run will be done. It never waits, and knows nothing at first."""

    def __init__(self, layout: Layout, snapshots: Path | None, run: str = "") -> None:
        """`snapshots`: the folder of the run's snapshots. `run`: its id; '': that of the folder."""
        self._snapshots = snapshots
        self._run = run
        # When the next look is due, s.
        self._due = time.monotonic() + FIRST_LOOK
        # The thread of the last look.
        self._looking: threading.Thread | None = None
        self._last: EndOfRun | None = None
        # Whether it looks at all.
        self.is_wanted = snapshots is not None and is_built_in(layout.scenario)

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


def end_of(snapshot: Snapshot) -> EndOfRun | None:
    """Return when the run of a snapshot will be done.

    None if the event model cannot go on from it, if agents are lost or left to clients elsewhere,
    or if the harvest does not end. Raises SnapshotError.
    """
    first = harvest_from(snapshot)
    if first is None:
        return None
    # The first harvest meets people when the seed of the run says, the others when other seeds say.
    # Without people all harvests would be the same.
    harvests = [first]
    if first.model.encounters.size:
        seed = first.layout.scenario.seed
        for number in range(1, DRAWS):
            drawn = deepcopy(first)
            drawn.meet_as_with(seed + number)
            harvests.append(drawn)
    if not all(harvest.run().is_over for harvest in harvests):
        return None
    ends = [harvest.seconds for harvest in harvests]
    if len(ends) == 1:
        return EndOfRun(ends[0], 0.0)
    return EndOfRun(fmean(ends), SURE * stdev(ends))
