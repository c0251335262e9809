"""The picture as pixels, looked at in Rerun's own viewer."""

import glob
from collections.abc import Iterator
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import pytest
from recordings import recording_of
from rerun.experimental import ViewerClient
from scripted_orchard import acted_layout, frames

from docs.pictures import at, looking_at
from orchard.contract.events import Frame
from orchard.field.layout import Layout
from orchard.view.palette import STATES
from orchard.view.scenery import plan_size

WINDOW = (1000, 640)  # pixels
LIBRARIES = ("xkbcommon-x11", "X11-xcb", "Xcursor", "Xi", "Xrandr")


def why_no_renderer() -> str:
    """What the headless viewer lacks here, or ''."""
    if not glob.glob("/usr/share/vulkan/icd.d/*.json") + glob.glob("/etc/vulkan/icd.d/*.json"):
        return "no Vulkan driver: apt-get install the list in .ci/apt-packages.txt"
    missing = [library for library in LIBRARIES if find_library(library) is None]
    return f"missing for the headless viewer: {', '.join(missing)} (see .ci/apt-packages.txt)" if missing else ""


@pytest.fixture(scope="module")
def viewer(recording: Path) -> Iterator[ViewerClient]:
    with looking_at(WINDOW, recording) as client:
        yield client


def picture(client: ViewerClient, seconds: float, view: str) -> np.ndarray:
    """(height, width, 3) of a view at a time."""
    return np.array(at(client, seconds, view)).astype(float)


@pytest.mark.skipif(bool(why_no_renderer()), reason=why_no_renderer() or "-")
class TestInTheViewer:
    def test_no_view_complains(self, viewer: ViewerClient) -> None:
        picture(viewer, 40.0, "At work")
        assert [(view.name, report.summary) for view in viewer.get_state().views for report in view.reports] == []

    def test_the_picture_is_not_blank_and_moves(self, viewer: ViewerClient) -> None:
        early, late = picture(viewer, 5.0, "At work"), picture(viewer, 60.0, "At work")
        assert early.std() > 20
        assert np.abs(early - late).max(axis=2).mean() > 0.3

    def test_robots_are_where_the_plan_says(self, viewer: ViewerClient, layout: Layout, acted: list[Frame]) -> None:
        plan, frame = picture(viewer, 80.0, "Plan"), acted[800]
        for name in ("picker_01", "picker_02"):
            column, row = on_the_plan(plan, layout, *frame.poses[layout.index[name]][:2])
            around = plan[row - 6 : row + 7, column - 6 : column + 7].reshape(-1, 3)
            assert np.abs(around - STATES["waiting"]).sum(axis=1).min() < 90, f"no waiting pin at {name}"

    @pytest.mark.soak
    def test_the_largest_orchard_opens_well(self, tmp_path: Path) -> None:
        layout = acted_layout(rows=20, pickers=20)
        with looking_at(WINDOW, recording_of(tmp_path / "large.rrd", layout, frames(layout, 2.0))) as viewer:
            assert picture(viewer, 1.0, "At work").std() > 20 and picture(viewer, 1.0, "Plan").std() > 20
            assert [(view.name, report.summary) for view in viewer.get_state().views for report in view.reports] == []


def on_the_plan(plan: np.ndarray, layout: Layout, x: float, y: float) -> tuple[int, int]:
    """Column and row of a place: the plan fits into the view, centred."""
    high, wide = plan_size(layout)
    rows, columns = plan.shape[:2]
    scale = min(rows / high, columns / wide)
    middle = (34.0 + layout.bottom) / 2
    return round(columns / 2 + x * scale), round(rows / 2 - (y - middle) * scale)
