"""What the first look at a recording needs: names on the plan that can be read, and a camera that is where the work is."""

from pathlib import Path

import numpy as np
import pytest
from recordings import Rows, poses_at, recording_of, starts
from scripted_orchard import ACTED_SECONDS, acted_layout

from orchard.contract.events import Frame
from orchard.field.layout import Layout
from orchard.view.blueprint import for_page
from orchard.view.names import DROP, FOCUS, HOLD, Focus, points_to_metres


def test_no_name_on_the_plan_covers_another_in_the_largest_orchard(tmp_path: Path) -> None:
    layout = acted_layout(rows=20, pickers=20)
    path = recording_of(tmp_path / "large.rrd", layout, [Frame(0, starts(layout))])
    ((_, points),) = Rows(path, "/plan/names").values("Points3D:positions")
    labels, scale = Rows(path, "/plan/names").static["Points3D:labels"], points_to_metres(layout)
    middles = np.array(points)[:, :2] - (0.0, DROP * scale)
    wide, high = 28.0 * scale, 22.0 * scale  # of a name such as P01, as Rerun writes it
    apart = np.abs(middles[:, None] - middles[None])
    covered = [(labels[a], labels[b]) for a, b in np.argwhere((apart[..., 0] < wide) & (apart[..., 1] < high)) if a < b]
    assert covered == []


def test_a_name_stands_below_its_pin_and_stays_there(layout: Layout, tmp_path: Path) -> None:
    poses, i = starts(layout), layout.index["picker_01"]
    poses[i, :2] = 0.0, layout.bottom + 10.0
    path = recording_of(tmp_path / "alone.rrd", layout, [Frame(0, poses)])
    place = Rows(path, "/plan/names").static["Points3D:labels"].index("P01")
    assert np.hypot(*(np.array(Rows(path, "/plan/names").rows[0][1]["Points3D:positions"][place])[:2] - poses[i, :2])) < 2.0


def test_the_camera_stays_with_a_robot_for_a_while_and_then_glides_to_an_exchange(layout: Layout) -> None:
    focus, poses = Focus(layout), starts(layout)
    states = {"picker_01": "picking", "picker_02": "waiting", "carrier_01": "waiting"}
    assert focus.follow(Frame(0, poses, states=states))[:2] == pytest.approx(poses[layout.index["picker_01"], :2])
    goal = poses[layout.index["carrier_01"], :2]
    far = [np.hypot(*(focus.follow(Frame(tick, poses, states={"carrier_01": "handling a bin"}))[:2] - goal)) for tick in range(1, 400)]
    begun = round(HOLD * 10) - 1
    assert far[:begun] == [far[0]] * begun
    assert far[begun:] == sorted(far[begun:], reverse=True) and far[-1] < 0.5
    assert max(-np.diff(far)) < 0.05 * far[0]


def test_the_camera_is_near_a_robot_at_any_time(layout: Layout, recording: Path) -> None:
    robots = [name for name in layout.names if name.startswith(("picker", "carrier"))]
    for seconds in np.arange(0.0, ACTED_SECONDS, 5.0):
        poses = poses_at(recording, float(seconds))
        assert min(np.hypot(poses[FOCUS][0] - poses[name][0], poses[FOCUS][1] - poses[name][1]) for name in robots) < 8.0


@pytest.mark.parametrize("rows", [5, 20])
def test_a_page_gets_the_spaces_and_the_plan_alone_the_work_first(rows: int) -> None:
    spaces, plan = for_page(acted_layout(rows=rows, pickers=2)).root_container.contents
    assert (spaces.contents[0].name, plan.name) == ("At work", "Plan")
