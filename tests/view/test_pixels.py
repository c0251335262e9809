"""The picture as pixels, in Rerun's own viewer and in its web viewer.

`recording` is a harvest of 85 s, and `harvested` are its frames (tests/support/recordings.py).
"""

import glob
import io
import re
import subprocess
import sys
from collections.abc import Iterator
from ctypes.util import find_library
from pathlib import Path
from urllib.parse import parse_qs, urlsplit
from urllib.request import urlopen

import numpy as np
import pytest
from page_server import ROOT, chromium_with, skip_without_packages
from patience import PATIENCE
from PIL import Image
from recordings import frames, recording_of, starts
from rerun.experimental import ViewerClient

from docs.pictures import at, looking_at
from orchard.contract.events import Frame
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.view.files import parts_of
from orchard.view.palette import STATES
from orchard.view.scenery import plan_size
from orchard.view.web import free_pair

WINDOW = (1000, 640)  # pixels


def why_no_renderer() -> str:
    """Return what the headless viewer lacks here, or ''."""
    if not glob.glob("/usr/share/vulkan/icd.d/*.json") + glob.glob("/etc/vulkan/icd.d/*.json"):
        return "no Vulkan driver: apt-get install the list in .ci/apt-packages.txt"
    missing = [
        library
        for library in ("xkbcommon-x11", "X11-xcb", "Xcursor", "Xi", "Xrandr")
        if find_library(library) is None
    ]
    if missing:
        return f"missing for the headless viewer: {', '.join(missing)} (see .ci/apt-packages.txt)"
    return ""


@pytest.fixture(scope="module")
def viewer(recording: Path) -> Iterator[ViewerClient]:
    """Open the recording in Rerun's viewer, without a window."""
    with looking_at(WINDOW, recording) as client:
        yield client


def picture(client: ViewerClient, seconds: float, view: str) -> np.ndarray:
    """Return a view at a time, (height, width, 3)."""
    return np.array(at(client, seconds, view)).astype(float)


@pytest.mark.skipif(bool(why_no_renderer()), reason=why_no_renderer() or "-")
class TestInTheViewer:
    def test_no_view_complains(self, viewer: ViewerClient) -> None:
        picture(viewer, 40.0, "At work")
        assert [
            (view.name, report.summary)
            for view in viewer.get_state().views
            for report in view.reports
        ] == []

    # Values of pixels are 0 to 255. A blank picture has no deviation, and robots are small in it.
    def test_the_picture_is_not_blank_and_moves(self, viewer: ViewerClient) -> None:
        early = picture(viewer, 5.0, "At work")
        late = picture(viewer, 60.0, "At work")
        assert early.std() > 20
        assert np.abs(early - late).max(axis=2).mean() > 0.3

    def test_robots_are_where_the_plan_says(
        self, viewer: ViewerClient, layout: Layout, harvested: list[Frame]
    ) -> None:
        # The frame of 85.0 s is that of tick 850; the first frame is of tick 1.
        plan = picture(viewer, 85.0, "Plan")
        frame = harvested[850 - 1]
        for name in ("picker_01", "picker_02"):
            # The pin is within 6 pixels of it, and its colour about that of the state.
            column, row = on_the_plan(plan, layout, *frame.poses[layout.index[name]][:2])
            around = plan[row - 6 : row + 7, column - 6 : column + 7].reshape(-1, 3)
            assert np.abs(around - STATES["waiting"]).sum(axis=1).min() < 90, (
                f"no waiting pin at {name}"
            )

    @pytest.mark.soak
    def test_the_largest_orchard_opens_well(self, tmp_path: Path) -> None:
        layout = lay_out(Scenario(rows=20, pickers=20))
        with looking_at(
            WINDOW, recording_of(tmp_path / "large.rrd", layout, frames(layout, 2.0))
        ) as viewer:
            assert picture(viewer, 1.0, "At work").std() > 20
            assert picture(viewer, 1.0, "Plan").std() > 20
            assert [
                (view.name, report.summary)
                for view in viewer.get_state().views
                for report in view.reports
            ] == []


def on_the_plan(plan: np.ndarray, layout: Layout, x: float, y: float) -> tuple[int, int]:
    """Return column and row of a place, m, in pixels. The plan fits into the view, centred.

    Its top is at y = 34 m, and its middle in x at 0.
    """
    high, wide = plan_size(layout)
    rows, columns = plan.shape[:2]
    scale = min(rows / high, columns / wide)
    middle = (34.0 + layout.bottom) / 2
    return round(columns / 2 + x * scale), round(rows / 2 - (y - middle) * scale)


# An option of Chromium: WebGL without a graphics card.
SOFTWARE = "--enable-unsafe-swiftshader"
# The tick of the second part. The viewer plays four times as fast as life, and must not come there
# while the test looks.
END = 30_000
# A pixel has about a colour if the differences of red, green and blue, of 255, add up to less.
# Leaves are 59 from a pin that is green.
NEAR = 40


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Record two parts, and let `orchard view` serve them. Return the address that it prints.

    Pickers pick in the first part, and call in the second.
    """
    skip_without_packages()
    layout = lay_out(Scenario(rows=3))
    names = ("picker_01", "picker_02")
    for file, ticks, state in (
        ("run.rrd", (0, 10), "picking"),
        ("run.part2.rrd", (END, END + 10), "calling"),
    ):
        doing = dict.fromkeys(names, state)
        recording_of(
            tmp_path / file,
            layout,
            [Frame(tick, starts(layout), doing, states=doing) for tick in ticks],
        )
    line = [sys.executable, str(ROOT / "run.py"), "view", "run.rrd", "--web", str(free_pair())]
    with subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://\S+", server.stdout.readline())[0]
        finally:
            server.terminate()


def pixels(browser, colour: tuple[int, int, int]) -> int:
    """Return how many pixels of the first view, which follows the work, have about this colour."""
    picture = np.array(
        Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert("RGB")
    ).astype(int)
    high, wide, _ = picture.shape
    view = picture[high // 10 : high // 2, : 2 * wide // 3]
    return int((np.abs(view - colour).sum(axis=2) < NEAR).sum())


def test_a_recording_opens_at_its_beginning_with_robots(address: str, tmp_path: Path) -> None:
    with chromium_with(tmp_path / "profile", tmp_path, SOFTWARE) as browser:
        browser.driver.set_window_size(900, 700)
        browser.driver.get(address)
        browser.wait_until(
            lambda: pixels(browser, STATES["picking"]) > 20, "pins of robots that pick", PATIENCE
        )
        assert pixels(browser, KINDS["picker"].colour) > 5
        assert pixels(browser, STATES["calling"]) == 0
    with urlopen(parse_qs(urlsplit(address).query)["url"][0], timeout=PATIENCE) as answer:
        assert answer.read() == b"".join(
            part.read_bytes() for part in parts_of(tmp_path / "run.rrd")
        )
