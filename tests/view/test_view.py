"""The picture, read back from the file with Rerun's own reader.

`harvested` are the frames of a short harvest, and `recording` is the file that the recorder has
made of them (tests/support/recordings.py). A recording has entities, such as /world/bins/bin_01,
whose components have values from certain times on, s.
"""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from itertools import combinations, pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from made_surveys import UNEQUAL, orchard_of
from patience import PATIENCE
from recordings import SECONDS, Rows, chunks, entities_with, poses_at, recording_of, starts
from rerun.chunk import RrdReader

from orchard.contract.agent import State
from orchard.contract.events import Event, Frame
from orchard.contract.messages import as_json, type_of
from orchard.field.geometry import Rect
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port
from orchard.local import Local
from orchard.sim.frames import FrameBuilder
from orchard.view import scenery
from orchard.view.focus import FOCUS
from orchard.view.palette import CHARGING, PAINT, ROW_RIPE, SCANS, STATES, YELLOW
from orchard.view.reader import LETTERS, column, optimize, ticks_of
from orchard.view.recorder import Recorder, hits
from orchard.view.scenery import PATCH, Part

# The first parts of the paths of all entities.
LAYERS = {
    "recording",
    "world",
    "canopy",
    "scans",
    "pins",
    "plan",
    "metrics",
    "events",
    "talk",
    "legend",
    "focus",
    "tf",
}


def is_same_pose(seen: tuple[float, float, float], expected: np.ndarray) -> bool:
    """Whether two poses are equal to a tenth of a millimetre and of a milliradian."""
    turned = np.angle(np.exp(1j * (seen[2] - expected[2])))
    differences = (seen[0] - expected[0], seen[1] - expected[1], turned)
    return all(abs(difference) < 1e-4 for difference in differences)


@pytest.mark.parametrize("seconds", [0.1, 12.3, 71.0, SECONDS])
def test_every_body_is_drawn_where_the_frame_says(
    layout: Layout, harvested: list[Frame], recording: Path, seconds: float
) -> None:
    seen = poses_at(recording, seconds)
    poses = harvested[round(seconds * 10) - 1].poses
    assert set(seen) == {*layout.names, FOCUS}
    for name, pose in zip(layout.names, poses, strict=True):
        assert is_same_pose(seen[name], pose), name


def test_the_recording_shows_the_start_before_the_first_step(
    layout: Layout, harvested: list[Frame], tmp_path: Path
) -> None:
    path = recording_of(tmp_path / "start.rrd", layout, [harvested[0]])
    seen = poses_at(path, 0.0)
    for start in layout.starts:
        assert is_same_pose(seen[start.name], np.array(start.pose)), start.name
    assert Rows(path, "/world/pickers/picker_01").values("StateChange:state") == [
        (0.0, ["picking row 1"])
    ]
    assert [t for t, _ in Rows(path, "/world/rows/row_01").values("Mesh3D:vertex_colors")] == [0.0]


def test_layers_are_separate_and_time_is_physics_time(recording: Path) -> None:
    logged = [chunk for chunk in chunks(recording) if not chunk.entity_path.startswith("/__")]
    assert {chunk.entity_path.split("/")[1] for chunk in logged} - {""} == LAYERS
    assert {name for chunk in logged for name in chunk.timeline_names} == {"sim_time"}
    times = [t for t, _ in Rows(recording, "/tf").rows]
    assert min(times) == 0.0
    assert max(times) == SECONDS


def test_every_body_has_a_shape_in_a_frame_of_its_own(layout: Layout, recording: Path) -> None:
    shaped = {path.split("/")[-1] for path in entities_with(recording, "Asset3D:blob")}
    assert set(layout.names) <= shaped
    assert Rows(recording, "/world/pickers/picker_01").static["CoordinateFrame:frame"] == [
        "picker_01"
    ]


def test_what_a_robot_does_is_its_state_and_pin_colour(recording: Path) -> None:
    """picker_01 picks 70 m at 1 m/s from the start on. Colours are numbers of 8 bits each for red,
    green, blue and opacity.
    """
    lines = [
        (t, state[0])
        for t, state in Rows(recording, "/world/pickers/picker_01").values("StateChange:state")
    ]
    assert lines[:3] == [
        (0.0, "picking row 1"),
        (70.1, "leaving the full bin of row 1"),
        (77.0, "waiting for an empty bin"),
    ]
    r, g, b = STATES["waiting"]
    _, colour = Rows(recording, "/pins/picker_01").values("Points3D:colors")[-1]
    assert colour == [r << 24 | g << 16 | b << 8 | 255]


def test_scans_are_thinned_and_in_the_frame_of_their_robot(layout: Layout, tmp_path: Path) -> None:
    # Of 180 beams the right half hits a wall in 4 m, and the left half nothing.
    ranges = np.where(np.arange(180) < 90, np.float32(4.0), np.float32(np.inf))
    course = [
        Frame(tick, starts(layout), scans=[ranges for _ in layout.starts]) for tick in range(21)
    ]
    clouds = Rows(recording_of(tmp_path / "scans.rrd", layout, course), "/scans/carrier_01").values(
        "Points3D:positions"
    )
    assert [t for t, _ in clouds] == [0.0, 0.5, 1.0, 1.5, 2.0]
    points = np.array(clouds[0][1])
    # Every second beam of the 90 that hit, rounded to 1/32 m, so that the file is small.
    assert len(points) == 45
    assert np.all(points[:, :2] * 32 == np.round(points[:, :2] * 32))
    assert np.hypot(points[:, 0] - KINDS["carrier"].laser.ahead, points[:, 1]) == pytest.approx(
        4.0, abs=0.03
    )


def test_hits_leaves_out_what_is_not_there() -> None:
    """A beam without a return is infinite or has the range of the laser, 10 m.

    `sweeps`: (scans, beams) m. `lengths`: how many points of each scan are left.
    """
    sweeps = np.array(
        [[np.inf, 2.0, np.inf, 3.0, 10.0], [1.0, 10.0, 10.0, 10.0, np.inf]], np.float32
    )
    points, lengths = hits(sweeps, KINDS["picker"].laser, every=1)
    assert points.shape == (3, 3)
    assert lengths.tolist() == [2, 1]
    points, lengths = hits(np.full((2, 180), np.inf, np.float32), KINDS["picker"].laser, every=2)
    assert points.shape == (0, 3)
    assert lengths.tolist() == [0, 0]


def test_a_row_turns_pale_as_it_is_picked_and_its_fruit_goes(recording: Path) -> None:
    painted = Rows(recording, "/world/rows/row_01").values("Mesh3D:vertex_colors")
    fruit = Rows(recording, "/canopy/fruit/row_01").values("Points3D:positions")
    # At the beginning, and every 2 m of 70.
    assert len(painted) == 36
    assert len(set(painted[0][1])) == 1
    assert len(set(painted[10][1])) == 2
    # From the west.
    assert painted[10][1][0] != painted[0][1][0]
    counts = [len(points) for _, points in fruit]
    assert counts == sorted(counts, reverse=True)
    assert fruit[-1][1] == []


def test_a_row_picked_from_inside_turns_pale_there(layout: Layout, tmp_path: Path) -> None:
    # Of row 1, m: nothing is picked from its west end on, 10 m from its east end on, and a part
    # inside, up to 30 m from the west end and up to 45 m from the east end: from 25 m to 30 m.
    picked = np.array([[0.0, 10.0, 30.0, 45.0], [0.0] * 4, [0.0] * 4])
    path = recording_of(tmp_path / "east.rrd", layout, [Frame(0, starts(layout), row_ends=picked)])
    (_, colours), = Rows(path, "/world/rows/row_01").values("Mesh3D:vertex_colors")  # fmt: skip
    # The ground of a row is 35 pieces of 2 m, with 4 corners each. Pale are those whose middle lies
    # between 25 m and 30 m, and the last 10 m.
    assert [piece for piece in range(35) if colours[4 * piece] != colours[0]] == [
        13,
        14,
        *range(30, 35),
    ]


def test_a_bin_fills_and_its_bar_comes_and_goes(layout: Layout, tmp_path: Path) -> None:
    picker = layout.index["picker_01"]
    bin_ = layout.index["bin_01"]
    bodies = np.arange(len(layout.starts))
    frames = []
    # Metres of fruit in the bin, and what is coupled to the picker.
    for tick, (metres, towed) in enumerate([(0.0, bin_), (35.0, bin_), (70.0, -1)]):
        fill = np.where(bodies == bin_, metres, 0.0)
        coupled = np.where(bodies == picker, towed, -1)
        frames.append(Frame(tick, starts(layout), fill=fill, coupled=coupled))
    path = recording_of(tmp_path / "bins.rrd", layout, frames)
    heights = [
        pose[0][2]
        for _, pose in Rows(path, "/world/bins/bin_01/fruit").values("InstancePoses3D:translations")
    ]
    assert heights == sorted(heights)
    assert len(heights) == 3
    flags = [
        scale[0][0]
        for _, scale in Rows(path, "/world/bins/bin_01/full").values("InstancePoses3D:scales")
    ]
    assert [flag > 0.5 for flag in flags] == [False, False, True]
    assert [
        len(bars)
        for _, bars in Rows(path, "/world/pickers/picker_01/bar").values("LineStrips3D:strips")
    ] == [1, 0]


def boxes_at(path: Path, entity: str) -> list[tuple[float, int]]:
    """Return how many boxes an entity of the load-out shows, from when on, s."""
    rows = Rows(path, f"/world/load_out/{entity}").values("Boxes3D:half_sizes")
    return [(seconds, len(boxes)) for seconds, boxes in rows]


def test_a_trailer_leaves_and_comes_back(tmp_path: Path) -> None:
    """A trailer at the bay has a deck, and a load if bins are on it; one that is away has neither.

    `expected`: tick -> a row for each of two trailers: the bins on it, the tick at which it is
    back, and the bins with which it left. The first takes a bin at 0.5 s, leaves at 1.0 s, and is
    back at 3.0 s.
    """
    trailers = {"count": 2, "bins": 2}
    scenario = Scenario.model_validate({"load_out": {"seconds_away": 2.0, "trailers": trailers}})
    layout = lay_out(scenario)
    expected = {0: [[0, 0, 0], [0, 0, 0]], 5: [[1, 0, 0], [0, 0, 0]], 10: [[0, 30, 2], [0, 0, 0]]}
    frames = []
    for tick in range(40):
        array = np.array(expected[tick]) if tick in expected else None
        frames.append(Frame(tick, starts(layout), trailers=array))
    path = recording_of(tmp_path / "trailers.rrd", layout, frames)
    assert boxes_at(path, "trailer_1") == [(0.0, 1), (0.5, 2), (1.0, 0), (3.0, 1)]
    assert boxes_at(path, "trailer_2") == [(0.0, 1)]


def test_full_bins_wait_for_the_truck(tmp_path: Path) -> None:
    """Of the bins at the bay the full ones have another colour than the last, which is empty."""
    truck = {"every": 60.0, "bins": 2}
    scenario = Scenario.model_validate({"load_out": {"truck": truck, "empty_bins": 3}})
    layout = lay_out(scenario)
    waiting = [0, 0, 1, 2, 0]
    frames = [Frame(tick, starts(layout), waiting_bins=bins) for tick, bins in enumerate(waiting)]
    path = recording_of(tmp_path / "truck.rrd", layout, frames)
    rows = Rows(path, "/world/load_out/bins").values("Boxes3D:colors")
    full = []
    for _, colours in rows:
        of_bins = np.array(colours)
        full.append(int(np.count_nonzero(of_bins != of_bins[-1])))
    assert full == [0, 1, 2, 0]


@pytest.fixture
def surveyed(tmp_path: Path) -> tuple[Layout, Path]:
    """Return a layout of four unequal rows, and a recording of its start.

    29 m of the first row are picked, all of it, and 10 m of the second.
    """
    layout = lay_out(orchard_of(UNEQUAL))
    picked = np.outer([29.0, 10.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    return layout, recording_of(
        tmp_path / "surveyed.rrd", layout, [Frame(0, starts(layout), row_ends=picked)]
    )


def test_surveyed_rows_and_their_trees_are_drawn_where_they_are(
    surveyed: tuple[Layout, Path],
) -> None:
    layout, path = surveyed
    trees = Rows(path, "/world/trees").static["InstancePoses3D:translations"]
    assert np.array(trees)[:, :2] == pytest.approx(
        np.array([(x, line.y) for line in layout.lines for x in line.trees_x]), abs=1e-4
    )
    for lane in layout.lanes:
        ground = np.array(
            Rows(path, f"/world/rows/row_{lane.number:02d}").static["Mesh3D:vertex_positions"]
        )
        assert (ground[:, 0].min(), ground[:, 0].max()) == pytest.approx(
            (lane.west, lane.east), abs=1e-4
        )
        assert np.ptp(ground[:, 1]) == pytest.approx(lane.width - 1.2, abs=1e-4)
    scales = np.array(Rows(path, "/canopy/pergola").static["InstancePoses3D:scales"])
    assert set(scales[:, 1].round(4)) == {
        round((lane.width - 0.5) / PATCH, 4) for lane in layout.lanes
    }
    painted = [
        Rows(path, f"/world/rows/row_0{n}").values("Mesh3D:vertex_colors")[0][1] for n in (1, 2, 3)
    ]
    assert [len(set(colours)) for colours in painted] == [1, 2, 1]
    assert painted[0][0] != painted[2][0]


def test_charging_lines_have_a_colour_of_their_own() -> None:
    layout = lay_out(
        Scenario(
            carriers=20, carrying={"battery": {"hours": 8.0, "hours_to_charge": 1.0}}, chargers=2
        )
    )
    colours = {round(part.at[1], 2): part.colour for part in scenery.queue_lines(layout)}
    assert {y for y, colour in colours.items() if colour == CHARGING} == {
        round(y + side, 2) for y in layout.charging_lines for side in (-1.1, 1.1)
    }
    assert set(colours.values()) == {PAINT, CHARGING}


@pytest.mark.parametrize("carriers", [2, 20])
@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_no_layers_flicker_where_they_overlap(route: str, carriers: int) -> None:
    """Flat parts of two colours that overlap, seen from above, are 5 cm apart in height.

    With few carriers on two-way roads the queue lies on the gravel of the driveway.
    """
    layout = lay_out(Scenario(rows=3, route=route, carriers=carriers))
    parts = scenery._ground(layout)
    for lane in layout.lanes:
        strip = Rect(lane.west, lane.y - lane.width / 2, lane.east, lane.y + lane.width / 2)
        parts.append(scenery._slab(strip, scenery.ROW_Z, ROW_RIPE))
    for shades in scenery._shades(layout):
        for x in np.ravel(shades.at[0]):
            parts.append(shades._replace(at=(x, *shades.at[1:])))
    for one, other in combinations(parts, 2):
        is_alike = one.colour == other.colour
        apart = abs(one.at[2] - other.at[2])
        assert is_alike or apart >= 0.05 - 1e-9 or not overlap(one, other), (one, other)


def overlap(one: Part, other: Part) -> bool:
    """Whether two flat parts overlap, seen from above, by more than an edge."""
    return all(
        abs(one.at[axis] - other.at[axis]) < (one.size[axis] + other.size[axis]) / 2 - 1e-6
        for axis in (0, 1)
    )


def test_a_flattened_weed_vanishes(recording: Path) -> None:
    rows = Rows(recording, "/world/weeds/weed_09").rows
    assert any(row.get("Asset3D:blob") for _, row in rows)
    assert any(row.get("Clear:is_recursive") == [False] for _, row in rows)


def test_the_conversation_is_logged_and_drawn(recording: Path) -> None:
    # The bin is full at 70.4 s, when the picker has driven 70 m and heard that; it calls at once.
    told = [(t, text[0]) for t, text in Rows(recording, "/events").values("TextLog:text")]
    assert (70.7, "bin_01 > carrier_01: come, row 1, east end") in told
    drawn = [(t, len(lines)) for t, lines in Rows(recording, "/talk").values("LineStrips3D:strips")]
    assert drawn[0] == (70.5, 2)
    assert max(lines for _, lines in drawn) > 4
    # And gone again.
    assert drawn[-1][1] == 0


def test_each_letter_is_recorded_with_its_fields(
    layout: Layout, harvested: list[Frame], recording: Path
) -> None:
    parts = ("sender", "recipient", "type", "content")
    recorded = []
    for chunk in chunks(recording):
        if chunk.entity_path == f"/{LETTERS}":
            texts = [[value[0] for value in column(chunk, part)] for part in parts]
            recorded += zip(ticks_of(chunk), *texts, strict=True)
    recorded.sort(key=lambda row: row[0])
    local = Local(layout.scenario)
    sent = []
    while local.engine.tick < len(harvested):
        local.tick()
        tick = local.engine.tick - 1
        for sender, written in local.post.written.get(tick, {}).items():
            sent += [(tick, sender, to, type_of(body), as_json(body)) for to, body in written.sent]
    assert recorded == sent
    calls = [json.loads(content) for _, _, _, type_, content in recorded if type_ == "call"]
    assert calls[0] == {"type": "call", "lane": 1, "side": "east", "since": 704}


def test_charges_of_batteries_are_recorded_each_second(tmp_path: Path) -> None:
    """Only changes are recorded. The first second is left out, in which all begins."""
    battery = {"hours": 0.5, "hours_to_charge": 0.2}
    scenario = Scenario(rows=3, carriers=2, carrying={"battery": battery})
    local = Local(scenario)
    meant = []
    builder = FrameBuilder(local.engine)
    carrier = local.engine.layout.index["carrier_01"]

    def harvest() -> Iterator[Frame]:
        while local.engine.tick < 400:
            frame = builder.frame(local.tick())
            if frame.tick % 10 == 0:
                meant.append((frame.tick / 10, [float(local.engine.world.charge[carrier])]))
            yield frame

    path = recording_of(tmp_path / "run.rrd", local.engine.layout, harvest())
    recorded = Rows(path, "/metrics/batteries/carrier_01").values("Scalars:scalars")
    changes = [now for before, now in pairwise(meant) if before[1] != now[1]]
    assert [row for row in recorded if row[0] > 1.0] == [row for row in changes if row[0] > 1.0]
    assert changes[-1][1][0] < 1.0


def test_without_batteries_no_charge_is_recorded(recording: Path) -> None:
    assert [path for path in entities_with(recording, "Scalars:scalars") if "batter" in path] == []


def test_the_legend_names_states_lasers_flags_and_queue(recording: Path) -> None:
    look = Rows(recording, "/legend").static
    shown = dict(zip(look["Points2D:labels"], look["Points2D:colors"], strict=True))
    for word, (r, g, b) in {**STATES, **SCANS, "full bin": YELLOW, "bay, queue": PAINT}.items():
        assert shown[word] == r << 24 | g << 16 | b << 8 | 255
    assert len(Rows(recording, "/legend/flags").static["LineStrips2D:strips"]) == 1


def test_what_is_said_again_is_no_news(layout: Layout, tmp_path: Path) -> None:
    """A call that is repeated every 2 s is a detail. After 36 s of silence it is news again."""
    call = Event(0, "call", "bin_01", "carrier_01", "")
    path = recording_of(
        tmp_path / "again.rrd",
        layout,
        [Frame(tick, starts(layout), events=[call]) for tick in (0, 20, 40, 400)],
    )
    assert [level[0] for _, level in Rows(path, "/events").values("TextLog:level")] == [
        "INFO",
        "DEBUG",
        "DEBUG",
        "INFO",
    ]


def test_a_live_recording_is_served_on_the_loopback_only(layout: Layout) -> None:
    port = free_port()
    recorder = Recorder(layout, "live", port=port)
    assert recorder.uri.startswith("rerun+http://127.0.0.1:")
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE):
        pass
    recorder.close()


def test_every_state_has_a_colour_of_its_own() -> None:
    assert set(STATES) == set(get_args(State))
    assert len(set(STATES.values())) == len(STATES)


def test_figures_become_plots(recording: Path) -> None:
    full = Rows(recording, "/metrics/bins/full").values("Scalars:scalars")
    waiting = Rows(recording, "/metrics/robots/pickers_waiting").values("Scalars:scalars")
    assert full[0] == (0.0, [0.0])
    assert max(value[0] for _, value in waiting) == 2.0


def test_a_carrier_is_busy_unless_it_waits_rests_or_is_broken(layout: Layout, tmp_path: Path):
    """Robots of other kinds do not count."""
    states = {"carrier_01": "waiting", "carrier_02": "hauling", "picker_01": "driving"}
    frame = Frame(10, starts(layout), states=states, doing=dict.fromkeys(states, "something"))
    path = recording_of(tmp_path / "busy.rrd", layout, [frame])
    assert Rows(path, "/metrics/robots/carriers_busy").values("Scalars:scalars") == [(1.0, [1.0])]


def test_optimize_packs_without_loss(recording: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed.rrd"
    packed.write_bytes(recording.read_bytes())
    optimize(packed)
    assert packed.stat().st_size < recording.stat().st_size
    assert poses_at(packed, 50.0) == poses_at(recording, 50.0)
    assert list(tmp_path.iterdir()) == [packed]


# A program that records 20 s, and is killed.
KILLED = """
import os, signal, sys
from recordings import frames
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.view.recorder import Recorder
layout = lay_out(Scenario(rows=3))
recorder = Recorder(layout, "killed", sys.argv[1])
for frame in frames(layout, 20.0):
    recorder.tick(frame)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_recording_opens_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "killed.rrd"
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(root / "tests" / "support"), str(root)])
    }
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(path)], env=environment, timeout=PATIENCE, check=False
    )
    assert killed.returncode < 0
    assert max(t for t, _ in Rows(path, "/tf").rows) == 20.0
    optimize(path)
    assert RrdReader(path).recordings()
