"""When a snapshot of a run is due.

A keyframe is a snapshot that stays, so that a run can be forked from it later.
"""

import math
from concurrent.futures import ThreadPoolExecutor

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.snapshots import SnapshotWriter


def test_a_keyframe_is_due_at_each_multiple_of_its_distance(tmp_path):
    """A keyframe is due each second, so every 10 ticks. The snapshots that a run goes on from after
    a kill are never due here: `seconds` is infinite.
    """
    with ThreadPoolExecutor(1) as executor:
        writer = SnapshotWriter(
            tmp_path, executor, lambda: 0.0, seconds=math.inf, keyframe_seconds=1.0
        )
        writer.keep(Local(Scenario(rows=3)).snapshot())
        assert writer.finish()
        assert [tick for tick in range(1, 31) if writer.is_due(tick)] == [10, 20, 30]
