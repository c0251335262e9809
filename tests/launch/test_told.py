"""What run.py tells a user: what is ignored, chosen or not kept; and the main figures of the summary."""

from pathlib import Path

import pytest
from run_endings import harvested

from orchard.field.scenario import Scenario
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.terminal import speed_not_kept
from orchard.report.summary import as_table, main_figures
from orchard.sim.snapshot import Snapshot

OF_ONE_PROCESS = "ignored: --hosts, --patience; local mode is one process"
LIVE = "live at 4 times real time; --speed X sets another speed, --speed max none"
BEFORE = Snapshot("", {}, {"tick": 6000}, b"", {}, [], {"wall_seconds": 600.0}, [])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"mode": "local", "hosts": 0, "patience": 20.0}, [OF_ONE_PROCESS]),
        ({"hosts": 4, "patience": 20.0}, []),
        ({"view": True}, [LIVE]),
        ({"web": 9090, "mode": "local", "hosts": 1, "patience": 3.0}, [OF_ONE_PROCESS, LIVE]),
        ({"view": True, "speed": 4.0}, []),
        ({"view": True, "mode": "realtime"}, []),
    ],
)
def test_what_is_ignored_and_what_is_chosen_is_told(options, told):
    assert HarvestOptions(**options).notes() == told


@pytest.mark.parametrize(
    ("speed", "before", "wall_seconds", "told"),
    [
        (100.0, None, 48.49, "the speed of 100 times real time was not kept: the machine reached 20.0"),
        (100.0, None, 9.8, ""),
        (None, None, 500.0, ""),  # as fast as possible
        (100.0, BEFORE, 603.7, ""),  # the part before it was resumed was slow
        (100.0, BEFORE, 618.49, "the speed of 100 times real time was not kept: the machine reached 20.0"),
    ],
)
def test_a_speed_that_was_not_kept_is_told(speed, before, wall_seconds, told):
    request = RunRequest(HarvestOptions(speed=speed), Scenario(), None, Path(), before)
    assert speed_not_kept(request, harvested(wall_seconds=wall_seconds)) == told


def test_ten_figures_are_shown_and_what_is_unusual():
    summary = dict.fromkeys(
        ("hash", "seed", "rows_picked", "bins_delivered", "sim_seconds", "schedule_sim_seconds", "bins_per_hour", "limit_bins_per_hour",
         "bottleneck", "picker_waiting_seconds", "carrier_utilisation", "collisions", "weeds_flattened"), 0)  # fmt: skip
    assert len(main_figures(summary)) == 10
    assert list(main_figures(summary | {"messages_refused": {}, "stopped_seconds": {"picker_01": 3.0}}))[10:] == ["stopped_seconds"]
    assert next(iter(as_table({"lost_seconds": {}}).columns[1].cells)).startswith("known of a complete harvest only")
    gaps = as_table({"recording_gaps": [[0.0, 5.1], [7.0, 7.3]]})
    assert list(gaps.columns[1].cells) == ["0.0 to 5.1, 7.0 to 7.3 s, which no recording shows"]
    assert list(as_table({"carrier_utilisation": 0.64}).columns[1].cells) == ["64 % of the time, outside the queue"]
