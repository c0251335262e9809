"""What the first look at a recording needs: names that can be read, a camera where the work is,
lines of what is said, true shapes.

`Rows` reads the recording of an entity back; `layout` and `recording` are those of a short harvest
(tests/support/recordings.py). The focus is the point at which the camera looks.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from recordings import SECONDS, Rows, poses_at, recording_of, starts

from orchard.contract.events import Event, Frame
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.view.blueprint import for_page
from orchard.view.focus import DWELL, FOCUS, Focus
from orchard.view.names import DROP, points_to_metres
from orchard.view.palette import YELLOW
from orchard.view.scenery import MODELS
from orchard.view.talk import gathered, level_of, line_of


@pytest.mark.parametrize(
    ("size", "named"),
    [({"rows": 20, "pickers": 20}, 35), ({"rows": 100, "pickers": 50, "carriers": 100}, 65)],
)
def test_no_name_on_the_plan_covers_another(size: dict, named: int, tmp_path: Path) -> None:
    """Where there is no room, a name is left out. `named`: how many robots of this layout have one
    at the start.
    """
    layout = lay_out(Scenario(**size))
    path = recording_of(tmp_path / "large.rrd", layout, [Frame(0, starts(layout))])
    ((_, points),) = Rows(path, "/plan/names").values("Points3D:positions")
    ((_, labels),) = Rows(path, "/plan/names").values("Points3D:labels")
    scale = points_to_metres(layout)
    assert len(labels) == len(points) == named
    # Rerun writes a name DROP points below its point. m, (names, 2).
    middles = np.array(points)[:, :2] - (0.0, DROP * scale)
    # The size of a name such as P01 as Rerun writes it, 28 points by 22, in m.
    wide = 28.0 * scale
    high = 22.0 * scale
    # The distances of all pairs in x and y, (names, names, 2).
    apart = np.abs(middles[:, None] - middles[None])
    covered = [
        (labels[a], labels[b])
        for a, b in np.argwhere((apart[..., 0] < wide) & (apart[..., 1] < high))
        if a < b
    ]
    assert covered == []


@pytest.mark.parametrize(("rows", "numbered"), [(20, 20), (100, 25)])
def test_no_number_of_a_row_covers_another(rows: int, numbered: int, tmp_path: Path) -> None:
    """Of 100 rows every fourth one has its number. A number is 22 points high."""
    layout = lay_out(Scenario(rows=rows))
    shown = Rows(
        recording_of(tmp_path / "rows.rrd", layout, [Frame(0, starts(layout))]), "/plan/rows"
    ).static
    places = np.array(shown["Points3D:positions"])[:, 1]
    assert len(places) == numbered
    assert shown["Points3D:labels"][0] == "1"
    assert min(-np.diff(places)) > 22.0 * points_to_metres(layout)


def test_a_name_stands_beside_its_robot(layout: Layout, tmp_path: Path) -> None:
    """Nothing else is near this robot, so its name need not move away: 2 m are the length of a
    picker.
    """
    poses = starts(layout)
    i = layout.index["picker_01"]
    poses[i, :2] = 0.0, layout.bottom + 10.0
    path = recording_of(tmp_path / "alone.rrd", layout, [Frame(0, poses)])
    ((_, names),) = Rows(path, "/plan/names").rows
    place = names["Points3D:positions"][names["Points3D:labels"].index("P01")]
    assert np.hypot(*(np.array(place)[:2] - poses[i, :2])) < 2.0


@pytest.mark.parametrize(
    ("robot", "glides"), [("picker_02", True), ("carrier_01", False)], ids=["near", "far"]
)
def test_the_camera_glides_near_and_cuts_far(robot, glides, layout) -> None:
    """The camera looks at picker_01, which works, and from tick 1 on another robot does.

    It stays for DWELL, s, before it goes on. To a robot that is near it moves smoothly, by less
    than 5 % of the way in a tick; to one that is far it jumps.
    """
    focus = Focus(layout)
    poses = starts(layout)
    states = {"picker_01": "picking", "picker_02": "waiting", "carrier_01": "waiting"}
    assert focus.follow(Frame(0, poses, states=states))[:2] == pytest.approx(
        poses[layout.index["picker_01"], :2]
    )
    goal = poses[layout.index[robot], :2]
    far = [
        np.hypot(*(focus.follow(Frame(tick, poses, states={robot: "handling a bin"}))[:2] - goal))
        for tick in range(1, 400)
    ]
    begun = round(DWELL * 10) - 1
    assert far[:begun] == [far[0]] * begun
    assert far[begun:] == sorted(far[begun:], reverse=True)
    assert far[-1] < 0.5
    assert (max(-np.diff(far)) < 0.05 * far[0]) == glides


def test_the_camera_is_near_a_robot_at_any_time(layout: Layout, recording: Path) -> None:
    robots = [name for name in layout.names if name.startswith(("picker", "carrier"))]
    for seconds in np.arange(0.0, SECONDS, 5.0):
        poses = poses_at(recording, float(seconds))
        assert (
            min(
                np.hypot(poses[FOCUS][0] - poses[name][0], poses[FOCUS][1] - poses[name][1])
                for name in robots
            )
            < 8.0
        )


@pytest.mark.parametrize("rows", [5, 20])
def test_a_page_gets_spaces_and_the_plan_alone_work_first(rows: int) -> None:
    """A page in a browser has two parts: 3D spaces, of which the one of work comes first, and the
    plan. Figures are on the page itself.
    """
    spaces, plan = for_page(lay_out(Scenario(rows=rows))).root_container.contents
    assert spaces.contents[0].name == "At work"
    assert plan.name == "Plan"


def test_events_read_like_sentences() -> None:
    assert (
        line_of(Event(0, "call", "bin_01", "carrier_02", "lane 3 east"))
        == "bin_01 > carrier_02: call, lane 3 east"
    )
    assert (
        line_of(Event(0, "row picked", "picker_01", "", "row picked: 3"))
        == "picker_01: row picked: 3"
    )
    assert level_of("claim") == "DEBUG"
    assert level_of("call") == "INFO"
    assert level_of("collision") == "WARN"


def test_many_questions_and_answers_are_one_line_each() -> None:
    carriers = [f"carrier_{i:02d}" for i in range(1, 6)]
    calls = [Event(0, "Call", "bin_01", carrier, "who is free? row 1") for carrier in carriers]
    offers = [
        Event(0, "Offer", carrier, "bin_01", f"I am, {10 * i} m away")
        for i, carrier in enumerate(carriers)
    ]
    come = Event(0, "Come", "bin_01", "carrier_02", "come, row 1")
    full = Event(0, "bin full", "bin_02", "picker_02", "row 2")
    assert [line_of(event) for event in gathered([full, *calls, *offers, come])] == [
        "bin_02 > picker_02: bin full, row 2",
        "bin_01 > 5 carriers: Call, who is free? row 1",
        "5 carriers > bin_01: Offer",
        "bin_01 > carrier_02: come, row 1",
    ]
    (two,) = gathered(offers[1:3])
    assert (
        line_of(two) == "carrier_02, carrier_03 > bin_01: Offer, I am, 10 m away; I am, 20 m away"
    )


def test_questions_of_safety_do_not_crowd_out_the_harvest() -> None:
    assert {level_of(what) for what in ("Where", "Position", "State", "BinState", "Places")} == {
        "DEBUG"
    }
    assert {
        level_of(what) for what in ("Call", "Offer", "Come", "Here", "row picked", "unloaded")
    } == {"INFO"}
    assert level_of("stopped") == "WARN"
    assert level_of("nothing recorded") == "WARN"
    assert level_of("lost") == "ERROR"


# How far a model rises above the height of its kind, m.
HATS = {"worker": 0.2}
# The numbers of types in glTF.
FLOAT = 5126
BYTE = 5121


def vertices(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions, (v, 3) m, and colours, (v, 3) up to 255, of a model's only mesh."""
    # A GLB file: a head of 12 bytes; the length and type of a part of JSON, in 8 bytes, and that
    # part; the same of a part of bytes.
    data = (MODELS / f"{name}.glb").read_bytes()
    begin = 20 + int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20:begin])
    (part,) = scene["meshes"][0]["primitives"]

    def values(attribute: str, kind: int, columns: int) -> np.ndarray:
        accessor = scene["accessors"][part["attributes"][attribute]]
        assert accessor["componentType"] == kind
        offset = begin + 8 + scene["bufferViews"][accessor["bufferView"]]["byteOffset"]
        flat = np.frombuffer(
            data, np.float32 if kind == FLOAT else np.uint8, accessor["count"] * columns, offset
        )
        return flat.reshape(-1, columns)

    return values("POSITION", FLOAT, 3), values("COLOR_0", BYTE, 4)[:, :3].astype(float)


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_of_a_body_fills_its_size_in_its_colour(kind):
    (places, colours) = vertices(kind)
    size = KINDS[kind]
    assert places.min(axis=0) == pytest.approx([-size.length / 2, -size.width / 2, 0.0], abs=1e-4)
    assert places.max(axis=0) == pytest.approx(
        [size.length / 2, size.width / 2, size.height + HATS.get(kind, 0.0)], abs=1e-4
    )
    # Faces are shaded. The brightest has the colour of the kind, to 15 of 255.
    assert np.abs(colours - size.colour).max(axis=1).min() < 15


def test_a_worker_has_a_yellow_hat():
    places, colours = vertices("worker")
    assert np.abs(colours[places[:, 2] > 1.8] - YELLOW).max() < 50


def test_the_trunk_of_a_tree_is_as_high_as_the_manual_says():
    places, _ = vertices("trunk")
    assert (places[:, 2].min(), places[:, 2].max()) == pytest.approx((0.0, 1.8))
