"""A recording in a browser, as its user sees it: Rerun's web viewer in headless Chromium."""

import io
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser
from page_server import ROOT, chromium_with, skip_without_packages
from PIL import Image
from recordings import recording_of, starts
from scripted_orchard import acted_layout

from orchard.contract.events import Frame
from orchard.field.kinds import KINDS
from orchard.view.palette import STATES
from orchard.view.web import free_pair

skip_without_packages()
SOFTWARE = "--enable-unsafe-swiftshader"  # WebGL without a graphics card
SECONDS = 240.0  # that the viewer may take on a busy machine
END = 30_000  # tick: the viewer plays four times as fast as life, and must not come there while the test looks
NEAR = 40  # sum of the differences of a colour's three parts; leaves are 59 from a pin that is green


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """A recording of two parts whose pickers pick until they call at its end; `orchard view` serves it, and prints this address."""
    layout = acted_layout(rows=3, pickers=2)
    names = ("picker_01", "picker_02")
    for file, ticks, state in (("run.rrd", (0, 10), "picking"), ("run.part2.rrd", (END, END + 10), "calling")):
        doing = dict.fromkeys(names, state)
        recording_of(tmp_path / file, layout, [Frame(tick, starts(layout), doing, states=doing) for tick in ticks])
    line = [sys.executable, str(ROOT / "run.py"), "view", "run.rrd", "--web", str(free_pair())]
    with subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://\S+", server.stdout.readline())[0]
        finally:
            server.terminate()


def pixels(browser: Browser, colour: tuple[int, int, int]) -> int:
    """How many pixels of the first view, which follows the work, have about this colour."""
    picture = np.array(Image.open(io.BytesIO(browser.driver.get_screenshot_as_png())).convert("RGB")).astype(int)
    high, wide, _ = picture.shape
    view = picture[high // 10 : high // 2, : 2 * wide // 3]
    return int((np.abs(view - colour).sum(axis=2) < NEAR).sum())


def test_a_recording_opens_at_its_beginning_with_robots_in_view(address: str, tmp_path: Path) -> None:
    with chromium_with(tmp_path / "profile", tmp_path, SOFTWARE) as browser:
        browser.driver.set_window_size(900, 700)
        browser.driver.get(address)
        browser.until(lambda: pixels(browser, STATES["picking"]) > 20, "pins of robots that pick", SECONDS)
        assert pixels(browser, KINDS["picker"].colour) > 5
        assert pixels(browser, STATES["calling"]) == 0
