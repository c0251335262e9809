"""The picture, read back: with Rerun's own reader from the file, and with Rerun's own viewer as pixels."""

import glob
import io
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient
from scripted_orchard import acted_layout, frames

from orchard.frames import Event, Frame
from orchard.kinds import KINDS
from orchard.layout import Layout
from orchard.view import Recorder, optimize
from orchard.view.palette import STATES, state_of
from orchard.view.recorder import hits
from orchard.view.scenery import plan_size
from orchard.view.talk import gathered, level_of, line_of
from orchard.viewer import viewer_program

SECONDS = 90.0
LAYERS = {"world", "canopy", "scans", "pins", "plan", "metrics", "events", "talk", "legend", "tf"}


@pytest.fixture(scope="module")
def layout() -> Layout:
    return acted_layout(rows=3, pickers=2)


def scan_of(stage: object) -> list[np.ndarray]:
    """Everyone sees a wall 4 m around, and nothing to its left."""
    ranges = np.full(180, 4.0, np.float32)
    ranges[90:] = np.inf
    return [ranges for _ in stage.layout.starts]


@pytest.fixture(scope="module")
def acted(layout: Layout) -> list[Frame]:
    return list(frames(layout, SECONDS, scan_of))


@pytest.fixture(scope="module")
def recording(layout: Layout, acted: list[Frame], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("picture") / "run.rrd"
    recorder = Recorder(layout, "a test", path)
    for frame in acted:
        recorder.tick(frame)
    recorder.close()
    return path


class Rows:
    """All rows of one entity: (seconds, component -> value) in the order of time."""

    def __init__(self, path: Path, entity: str) -> None:
        self.rows: list[tuple[float, dict]] = []
        self.static: dict = {}
        for chunk in RrdReader(path).stream():
            if chunk.entity_path == entity:
                self._take(chunk)
        self.rows.sort(key=lambda row: row[0])

    def _take(self, chunk: object) -> None:
        batch = chunk.to_record_batch()
        for row in batch.drop_columns([n for n in batch.schema.names if n == "sim_time"]).to_pylist() if chunk.is_static else ():
            self.static.update({key: value for key, value in row.items() if value is not None})
        if not chunk.is_static:
            seconds = [time.value / 1e9 for time in batch["sim_time"]]
            names = [name for name in batch.schema.names if ":" in name]
            lists = {name: batch[name].to_pylist() for name in names}
            self.rows += [(t, {name: lists[name][i] for name in names}) for i, t in enumerate(seconds)]

    def values(self, component: str) -> list[tuple[float, object]]:
        return [(t, row[component]) for t, row in self.rows if row.get(component) is not None]


def chunks(path: Path) -> list:
    return list(RrdReader(path).stream())


def entities_with(path: Path, component: str) -> set[str]:
    return {chunk.entity_path for chunk in chunks(path) if component in chunk.to_record_batch().schema.names}


def poses_at(path: Path, seconds: float) -> dict[str, tuple[float, float, float]]:
    """Where the viewer draws each body: the newest pose of its frame."""
    seen = {}
    for t, row in Rows(path, "/tf").rows:
        if t <= seconds + 1e-9:
            (x, y, _), (_, _, z, w) = row["Transform3D:translation"][0], row["Transform3D:quaternion"][0]
            seen[row["Transform3D:child_frame"][0]] = (x, y, 2 * np.arctan2(z, w))
    return seen


def same_pose(seen: tuple[float, float, float], meant: np.ndarray) -> bool:
    turned = np.angle(np.exp(1j * (seen[2] - meant[2])))
    return abs(seen[0] - meant[0]) < 1e-4 and abs(seen[1] - meant[1]) < 1e-4 and abs(turned) < 1e-4


@pytest.mark.parametrize("seconds", [0.0, 12.3, 71.0, SECONDS])
def test_every_body_is_drawn_where_the_frame_says(layout: Layout, acted: list[Frame], recording: Path, seconds: float) -> None:
    seen, meant = poses_at(recording, seconds), acted[round(seconds * 10)].poses
    assert set(seen) == set(layout.names)
    assert [name for i, name in enumerate(layout.names) if not same_pose(seen[name], meant[i])] == []


def test_layers_are_separate_and_time_is_physics_time(recording: Path) -> None:
    logged = [chunk for chunk in chunks(recording) if not chunk.entity_path.startswith("/__")]
    assert {chunk.entity_path.split("/")[1] for chunk in logged} - {""} == LAYERS
    assert {name for chunk in logged for name in chunk.timeline_names} == {"sim_time"}
    times = [t for t, _ in Rows(recording, "/tf").rows]
    assert (min(times), max(times)) == (0.0, SECONDS)


def test_every_body_has_a_shape_in_a_frame_of_its_own(layout: Layout, recording: Path) -> None:
    shaped = {path.split("/")[-1] for path in entities_with(recording, "Mesh3D:vertex_positions")}
    assert set(layout.names) <= shaped
    assert Rows(recording, "/world/pickers/picker_01").static["CoordinateFrame:frame"] == ["picker_01"]


def test_what_a_robot_does_is_its_state_and_the_colour_of_its_pin(recording: Path) -> None:
    said = [(t, state[0]) for t, state in Rows(recording, "/world/pickers/picker_01").values("StateChange:state")]
    assert said[:3] == [(0.0, "picking row 1"), (70.0, "leaving row 1"), (76.0, "waiting for a bin")]
    r, g, b = STATES["waiting"]
    _, colour = Rows(recording, "/pins/picker_01").values("Points3D:colors")[-1]
    assert colour == [r << 24 | g << 16 | b << 8 | 255]


def test_scans_are_thinned_and_in_the_frame_of_their_robot(recording: Path) -> None:
    clouds = Rows(recording, "/scans/carrier_01").values("Points3D:positions")
    assert [t for t, _ in clouds] == [pytest.approx(0.5 * i) for i in range(len(clouds))]
    assert len(clouds) == 2 * SECONDS + 1
    points = np.array(clouds[0][1])
    assert len(points) == 45  # every second beam of the 90 that hit
    assert np.all(points[:, :2] * 32 == np.round(points[:, :2] * 32))
    assert np.hypot(points[:, 0] - KINDS["carrier"].laser.ahead, points[:, 1]) == pytest.approx(4.0, abs=0.03)


def test_hits_leaves_out_what_is_not_there() -> None:
    ranges = np.array([np.inf, 2.0, np.inf, 3.0, 10.0], np.float32)
    assert len(hits(ranges, KINDS["picker"].laser, every=1)) == 2
    assert hits(np.full(180, np.inf, np.float32), KINDS["picker"].laser, every=2).shape == (0, 3)


def test_a_row_turns_pale_as_it_is_picked_and_its_fruit_goes(recording: Path) -> None:
    painted = Rows(recording, "/world/rows/row_01").values("Mesh3D:vertex_colors")
    fruit = Rows(recording, "/canopy/fruit/row_01").values("Points3D:positions")
    assert len(painted) == 36  # at the beginning, and every 2 m of 70
    assert len(set(painted[0][1])) == 1 and len(set(painted[10][1])) == 2
    assert painted[10][1][0] != painted[0][1][0]  # from the west
    assert [len(points) for _, points in fruit] == sorted((len(points) for _, points in fruit), reverse=True)
    assert fruit[-1][1] == []


def test_a_row_that_is_picked_from_the_east_turns_pale_there(layout: Layout, tmp_path: Path) -> None:
    recorder, poses = Recorder(layout, "east", tmp_path / "east.rrd"), np.array([start.pose for start in layout.starts])
    poses[layout.index["picker_01"]] = 24.5, layout.lane(1).y, np.pi
    recorder.tick(Frame(0, poses, row_picked=np.array([10.0, 0.0, 0.0])))
    recorder.close()
    (_, colours), = Rows(tmp_path / "east.rrd", "/world/rows/row_01").values("Mesh3D:vertex_colors")  # fmt: skip
    assert colours[0] != colours[-1] and colours[-1] == colours[-20]


def test_a_bin_fills_and_its_bar_comes_and_goes(layout: Layout, tmp_path: Path) -> None:
    path, i, j = tmp_path / "bins.rrd", layout.index["picker_01"], layout.index["bin_01"]
    recorder, poses = Recorder(layout, "bins", path), np.array([start.pose for start in layout.starts])
    fill, coupled = np.zeros(len(poses)), np.full(len(poses), -1)
    for tick, (metres, other) in enumerate([(0.0, j), (35.0, j), (70.0, -1)]):
        fill[j], coupled[i] = metres, other
        recorder.tick(Frame(tick, poses, fill=fill, coupled=coupled))
    recorder.close()
    heights = [pose[0][2] for _, pose in Rows(path, "/world/bins/bin_01/fruit").values("InstancePoses3D:translations")]
    assert heights == sorted(heights) and len(heights) == 3
    flags = [scale[0][0] for _, scale in Rows(path, "/world/bins/bin_01/full").values("InstancePoses3D:scales")]
    assert [flag > 0.5 for flag in flags] == [False, False, True]
    assert [len(bars) for _, bars in Rows(path, "/world/pickers/picker_01/bar").values("LineStrips3D:strips")] == [1, 0]


def test_a_flattened_weed_vanishes(recording: Path) -> None:
    rows = Rows(recording, "/world/weeds/weed_01").rows
    assert any(row.get("Mesh3D:vertex_positions") for _, row in rows)
    assert any(row.get("Clear:is_recursive") == [False] for _, row in rows)


def test_the_conversation_is_logged_and_drawn(recording: Path) -> None:
    told = [(t, text[0]) for t, text in Rows(recording, "/events").values("TextLog:text")]
    assert (70.0, "bin_01 > carrier_01: come, lane 1 east") in told
    drawn = [(t, len(lines)) for t, lines in Rows(recording, "/talk").values("LineStrips3D:strips")]
    assert drawn[0][0] == 70.0 and drawn[0][1] >= 3
    assert drawn[-1][1] == 0  # and gone again


def test_events_read_like_sentences() -> None:
    assert line_of("call", "bin_01", "carrier_02", "lane 3 east") == "bin_01 > carrier_02: call, lane 3 east"
    assert line_of("row picked", "picker_01", "", "row picked: 3") == "picker_01: row picked: 3"
    assert (level_of("claim"), level_of("call"), level_of("collision")) == ("DEBUG", "INFO", "WARN")


def test_what_is_asked_of_many_and_answered_by_many_is_one_line_each() -> None:
    carriers = [f"carrier_{i:02d}" for i in range(1, 6)]
    calls = [Event("Call", "bin_01", carrier, "who is free? row 1") for carrier in carriers]
    offers = [Event("Offer", carrier, "bin_01", f"I am, {10 * i} m away") for i, carrier in enumerate(carriers)]
    come, full = Event("Come", "bin_01", "carrier_02", "come, row 1"), Event("bin full", "bin_02", "picker_02", "row 2")
    assert [line_of(*event) for event in gathered([full, *calls, *offers, come])] == [
        "bin_02 > picker_02: bin full, row 2",
        "bin_01 > 5 carriers: Call, who is free? row 1",
        "5 carriers > bin_01: Offer",
        "bin_01 > carrier_02: come, row 1",
    ]
    (two,) = gathered(offers[1:3])
    assert line_of(*two) == "carrier_02, carrier_03 > bin_01: Offer, I am, 10 m away; I am, 20 m away"


def test_questions_of_safety_do_not_crowd_out_the_harvest() -> None:
    assert {level_of(what) for what in ("Where", "Position", "State", "BinState", "Places")} == {"DEBUG"}
    assert {level_of(what) for what in ("Call", "Offer", "Come", "Here", "row picked", "unloaded")} == {"INFO"}
    assert (level_of("stopped"), level_of("nothing recorded"), level_of("lost")) == ("WARN", "WARN", "ERROR")


def test_the_legend_names_every_state_and_its_colour(recording: Path) -> None:
    look = Rows(recording, "/legend").static
    shown = dict(zip(look["Points2D:labels"], look["Points2D:colors"], strict=True))
    for state, (r, g, b) in STATES.items():
        assert shown[state] == r << 24 | g << 16 | b << 8 | 255


def test_what_is_said_again_is_no_news(layout: Layout, tmp_path: Path) -> None:
    path, poses = tmp_path / "again.rrd", np.array([start.pose for start in layout.starts])
    recorder = Recorder(layout, "again", path)
    for tick in (0, 20, 40, 400):
        recorder.tick(Frame(tick, poses, events=[("call", "bin_01", "carrier_01", "")]))
    recorder.close()
    assert [level[0] for _, level in Rows(path, "/events").values("TextLog:level")] == ["INFO", "DEBUG", "DEBUG", "INFO"]


def test_a_live_recording_is_served_on_the_loopback_only(layout: Layout) -> None:
    port = free_port()
    recorder = Recorder(layout, "live", serve=True, port=port)
    assert recorder.uri.startswith("rerun+http://127.0.0.1:")
    with socket.create_connection(("127.0.0.1", port), timeout=5):
        pass
    recorder.close()


@pytest.mark.parametrize(
    ("doing", "state"),
    [
        ("picking row 3", "picking"),
        ("waiting for a bin", "waiting"),
        ("stopped: obstacle ahead", "stopped"),
        ("full, calling", "calling"),
        ("coupling bin_03", "handling a bin"),
        ("unloading", "unloading"),
        ("taking bin_02 to the bay", "hauling a full bin"),
        ("driving to the queue", "driving"),
        ("", "resting"),
    ],
)
def test_states(doing: str, state: str) -> None:
    assert state_of(doing) == state


def test_figures_become_plots(recording: Path) -> None:
    full = Rows(recording, "/metrics/bins/full").values("Scalars:scalars")
    waiting = Rows(recording, "/metrics/robots/pickers_waiting").values("Scalars:scalars")
    assert full[0] == (0.0, [0.0])
    assert max(value[0] for _, value in waiting) == 2.0


def test_a_recording_brings_its_blueprint(recording: Path) -> None:
    assert len(RrdReader(recording).blueprints()) == 1


def test_optimize_packs_without_loss(recording: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed.rrd"
    packed.write_bytes(recording.read_bytes())
    optimize(packed)
    assert packed.stat().st_size < recording.stat().st_size
    assert poses_at(packed, 50.0) == poses_at(recording, 50.0)
    assert list(tmp_path.iterdir()) == [packed]


KILLED = """
import os, signal, sys
from scripted_orchard import acted_layout, frames
from orchard.view import Recorder
layout = acted_layout(rows=3, pickers=2)
recorder = Recorder(layout, "killed", sys.argv[1])
for frame in frames(layout, 20.0):
    recorder.tick(frame)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_recording_opens_after_a_kill(tmp_path: Path) -> None:
    path, here = tmp_path / "killed.rrd", Path(__file__).parent
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(here), str(here.parent)])}
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], env=environment, timeout=60, check=False)
    assert killed.returncode < 0
    assert max(t for t, _ in Rows(path, "/tf").rows) == 20.0
    optimize(path)
    assert RrdReader(path).recordings()


# -- looked at


LIBRARIES = ("xkbcommon-x11", "X11-xcb", "Xcursor", "Xi", "Xrandr")


def why_no_renderer() -> str:
    """What the headless viewer lacks here, or ''."""
    if not glob.glob("/usr/share/vulkan/icd.d/*.json") + glob.glob("/etc/vulkan/icd.d/*.json"):
        return "no Vulkan driver: apt-get install the list in .ci/apt-packages.txt"
    missing = [library for library in LIBRARIES if find_library(library) is None]
    return f"missing for the headless viewer: {', '.join(missing)} (see .ci/apt-packages.txt)" if missing else ""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def looking_at(path: Path) -> Iterator[ViewerClient]:
    """A viewer without a window that has loaded a recording."""
    client = ViewerClient.spawn(headless=True, port=free_port(), hide_welcome_screen=True, executable_path=viewer_program())
    try:
        client.open(str(path))
        deadline = time.monotonic() + 60
        while not client.get_state().views or client.get_state().loading:
            assert time.monotonic() < deadline, "the viewer did not load the recording within 60 s"
            client.take_screenshot(max_size=100)
        yield client
    finally:
        client.quit()


@pytest.fixture(scope="module")
def viewer(recording: Path) -> Iterator[ViewerClient]:
    with looking_at(recording) as client:
        yield client


def picture(client: ViewerClient, seconds: float, view: str) -> np.ndarray:
    """(height, width, 3) of a view at a time; the first picture after a change may still be the old one."""
    client.set_time("sim_time", duration=seconds, play_state="paused")
    (shown,) = [v for v in client.get_state().views if v.name == view]
    for _ in range(3):
        png = client.take_screenshot(shown.view_id)
    return np.array(Image.open(io.BytesIO(png)).convert("RGB")).astype(float)


@pytest.mark.skipif(bool(why_no_renderer()), reason=why_no_renderer() or "-")
class TestInTheViewer:
    def test_no_view_complains(self, viewer: ViewerClient) -> None:
        picture(viewer, 40.0, "Orchard")
        assert [(view.name, report.summary) for view in viewer.get_state().views for report in view.reports] == []

    def test_the_picture_is_not_blank_and_moves(self, viewer: ViewerClient) -> None:
        early, late = picture(viewer, 5.0, "Orchard"), picture(viewer, 60.0, "Orchard")
        assert early.std() > 20
        assert np.abs(early - late).max(axis=2).mean() > 0.3

    def test_robots_are_where_the_plan_says(self, viewer: ViewerClient, layout: Layout, acted: list[Frame]) -> None:
        plan, frame = picture(viewer, 80.0, "Plan"), acted[800]
        for name in ("picker_01", "picker_02"):
            column, row = on_the_plan(plan, layout, *frame.poses[layout.index[name]][:2])
            around = plan[row - 6 : row + 7, column - 6 : column + 7].reshape(-1, 3)
            assert np.abs(around - STATES["waiting"]).sum(axis=1).min() < 90, f"no waiting pin at {name}"

    def test_the_largest_orchard_opens_well(self, tmp_path: Path) -> None:
        recorder = Recorder(acted_layout(rows=20, pickers=20), "large", tmp_path / "large.rrd")
        for frame in frames(recorder.layout, 2.0):
            recorder.tick(frame)
        recorder.close()
        with looking_at(tmp_path / "large.rrd") as viewer:
            assert picture(viewer, 1.0, "Orchard").std() > 20 and picture(viewer, 1.0, "Plan").std() > 20
            assert [(view.name, report.summary) for view in viewer.get_state().views for report in view.reports] == []


def on_the_plan(plan: np.ndarray, layout: Layout, x: float, y: float) -> tuple[int, int]:
    """Column and row of a place: the plan fits into the view, centred."""
    high, wide = plan_size(layout)
    rows, columns = plan.shape[:2]
    scale = min(rows / high, columns / wide)
    middle = (34.0 + layout.bottom) / 2
    return round(columns / 2 + x * scale), round(rows / 2 - (y - middle) * scale)
