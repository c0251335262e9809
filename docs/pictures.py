"""Makes docs/orchard.png and docs/exchange.webp: Rerun's own viewer, without a window, looks at a
run of local mode.

Needs what .ci/apt-packages.txt names, as the tests that look at pictures do.
"""

import io
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.local_run import run
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import free_port
from orchard.view.blueprint import at_work
from orchard.view.columns import TIMELINE
from orchard.view.files import viewer_program
from orchard.view.recorder import Recorder

HERE = Path(__file__).parent
SCENARIO = Scenario(rows=8, pickers=4, seed=1)
MENU = 36  # pixels of the window's top, which are cut off
GREETING = 8.0  # s of wall time after which the viewer's greeting is gone
PATIENCE = 60.0  # s of wall time

# The picture: its moment, and how far the run in it went, s; the window, pixels, without the menu.
SHOWN = 118.0
RECORDED = 380.0
WINDOW = (1600, 900)

# The film: from when to when, s. A carrier brings an empty bin, which the picker takes into its
# next row.
EXCHANGE = (86.0, 134.0)
SPEED = 4.0  # simulated s per s
RATE = 8.0  # frames per s
HOLD = 1.5  # s for which the last frame stands
SMALL_WINDOW = (720, 460)  # pixels
QUALITY = 60  # of WebP, up to 100


def record(path: Path, seconds: float) -> None:
    """Harvest for a while. `seconds`: simulated."""
    recorder = Recorder(lay_out(SCENARIO), "8 rows, 4 pickers", path)
    request = RunRequest(
        HarvestOptions(mode="local", duration=seconds), SCENARIO, path, path.with_suffix("")
    )
    run(request, recorder.tick, lambda *_: None)
    recorder.close()


@contextmanager
def looking_at(size: tuple[int, int], *files: Path) -> Iterator[ViewerClient]:
    """In this context, a viewer without a window has loaded a recording, and perhaps a blueprint.

    `size`: pixels, without the menu.
    """
    port = free_port()
    width, height = size
    command = [
        viewer_program(),
        "--headless",
        "--window-size",
        f"{width}x{height + MENU}",
        "--port",
        str(port),
        "--hide-welcome-screen",
    ]
    process = subprocess.Popen([*command, *map(str, files)], stderr=subprocess.DEVNULL)
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


def _wait_for_the_greeting(client: ViewerClient) -> None:
    """Wait until the viewer's greeting is gone.

    Time passes in the viewer only while it makes pictures.
    """
    deadline = time.monotonic() + GREETING
    while time.monotonic() < deadline:
        client.take_screenshot(max_size=100)


def _connected(port: int) -> ViewerClient:
    """Wait until the viewer answers at a port, and return a client of it."""
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


def at(client: ViewerClient, seconds: float, view: str | None = None) -> Image.Image:
    """Return the picture of the window, or of one view, at a time.

    The first pictures after a change may still be the old one: the third one counts.
    """
    client.set_time(TIMELINE, duration=seconds, play_state="paused")
    view_id = None
    for known in client.get_state().views:
        if known.name == view:
            view_id = known.view_id
    for _ in range(3):
        png = client.take_screenshot(view_id)
    return Image.open(io.BytesIO(png)).convert("RGB")


def picture(recording: Path) -> Image.Image:
    """Return the picture of the window without its menu."""
    with looking_at(WINDOW, recording) as client:
        _wait_for_the_greeting(client)
        return at(client, SHOWN).crop((0, MENU, WINDOW[0], WINDOW[1] + MENU))


def film(recording: Path) -> list[Image.Image]:
    """Return the frames of an exchange, in the view that follows the work."""
    blueprint = recording.with_suffix(".rbl")
    panels = (
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )
    rrb.Blueprint(
        rrb.Vertical(at_work(lay_out(SCENARIO))), *panels, auto_views=False, auto_layout=False
    ).save("orchard", blueprint)
    with looking_at(SMALL_WINDOW, recording, blueprint) as client:
        _wait_for_the_greeting(client)
        moments = np.arange(*EXCHANGE, SPEED / RATE)
        return [at(client, seconds, "At work") for seconds in moments]


def save_film(frames: list[Image.Image], path: Path) -> None:
    """Write an animated WebP, which READMEs show as they show GIF, in all colours and a fraction of
    GIF's size.
    """
    # ms, of each frame and of the last one.
    durations = [round(1000 / RATE)] * (len(frames) - 1) + [round(1000 * HOLD)]
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=QUALITY
    )


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        of_picture = Path(folder) / "picture.rrd"
        of_film = Path(folder) / "film.rrd"
        record(of_picture, RECORDED)
        picture(of_picture).save(HERE / "orchard.png", optimize=True)
        record(of_film, EXCHANGE[1])
        save_film(film(of_film), HERE / "exchange.webp")
