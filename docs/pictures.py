"""Makes docs/orchard.png: Rerun's own viewer, without a window, looks at a run of local mode.

Needs what .ci/apt-packages.txt names, as the tests that look at pictures do.
"""

import io
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from rerun.experimental import ViewerClient

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.local_run import run
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import free_port
from orchard.view.files import viewer_program
from orchard.view.recorder import Recorder

HERE = Path(__file__).parent
SCENARIO = Scenario(rows=8, pickers=4, seed=1)
SHOWN, RECORDED = 152.0, 380.0  # s: the moment of the picture, and how far the run went
WIDTH, HEIGHT = 1600, 900
MENU = 36  # pixels of the window's top, which are cut off
TOAST = 8.0  # s of wall time after which the viewer's greeting is gone
PATIENCE = 60.0  # s of wall time


def record(path: Path) -> None:
    """Harvest for a while."""
    recorder = Recorder(lay_out(SCENARIO), "8 rows, 4 pickers", path)
    wish = RunRequest(HarvestOptions(mode="local", duration=RECORDED), SCENARIO, path, path.parent)
    run(wish, recorder.tick, lambda *_: None)
    recorder.close()


@contextmanager
def looking_at(recording: Path) -> Iterator[ViewerClient]:
    """A viewer without a window that has loaded a recording."""
    port = free_port()
    command = [viewer_program(), "--headless", "--window-size", f"{WIDTH}x{HEIGHT + MENU}", "--port", str(port), "--hide-welcome-screen"]
    process = subprocess.Popen([*command, str(recording)], stderr=subprocess.DEVNULL)
    try:
        client = _connected(port)
        deadline = time.monotonic() + PATIENCE
        while not client.get_state().views or client.get_state().loading:
            if time.monotonic() > deadline:
                raise TimeoutError(f"the viewer did not load the recording within {PATIENCE:.0f} s")
            client.take_screenshot(max_size=100)
        yield client
    finally:
        process.terminate()
        process.wait()


def _connected(port: int) -> ViewerClient:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            return client
        except ConnectionError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


def screenshot(recording: Path) -> Image.Image:
    """The window without its menu; the first pictures after a change may still be the old one, and time passes only by pictures."""
    with looking_at(recording) as client:
        client.set_time("sim_time", duration=SHOWN, play_state="paused")
        deadline = time.monotonic() + TOAST
        while time.monotonic() < deadline:
            client.take_screenshot(max_size=100)
        png = client.take_screenshot()
    return Image.open(io.BytesIO(png)).convert("RGB").crop((0, MENU, WIDTH, HEIGHT + MENU))


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        record(Path(folder) / "run.rrd")
        picture = screenshot(Path(folder) / "run.rrd")
    picture.save(HERE / "orchard.png", optimize=True)
