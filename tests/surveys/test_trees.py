"""Trees as points: their lines are found in any direction, with trees missing and noise."""

import cmath
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_surveys import CIRCUIT, THERE, feature, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")


def trees(
    lines: int, spacing: float, pitch: float, count: int, yaw: float, chance: random.Random
) -> list[dict]:
    """Return points of trees in no order, up to 5 cm off their places, a tenth missing.

    `spacing`: from line to line, and `pitch`: from tree to tree, m. `count`: the trees of a line,
    whose ends are never missing.
    """
    features = []
    for i in range(lines):
        for j in range(count):
            is_end = j in (0, count - 1)
            if not is_end and chance.random() < 0.1:
                continue
            off = complex(chance.uniform(-0.05, 0.05), chance.uniform(-0.05, 0.05))
            at = THERE + (complex(pitch * j, -spacing * i) + off) * cmath.exp(1j * yaw)
            features.append(feature("Point", [at.real, at.imag], tag=len(features)))
    chance.shuffle(features)
    return features


@settings(max_examples=12)
@given(
    lines=st.integers(4, 14),
    spacing=st.floats(3.7, 7.0),
    pitch=st.floats(1.5, 6.0),
    length=st.floats(50.0, 150.0),
    yaw=st.floats(-1.5, 1.5),
    seed=st.integers(0, 10**6),
)
def test_lines_of_trees_are_found_in_any_direction(
    tmp_path_factory, lines, spacing, pitch, length, yaw, seed
):
    count = int(length / pitch) + 1
    # If trees stand in squares, or lines are no longer than the block is wide, the other direction
    # is as good. So these get closer trees in longer lines.
    if abs(pitch - spacing) < 0.5 or lines * spacing > 0.9 * length:
        pitch = spacing / 3.0
        count = int(1.2 * lines * spacing / pitch) + 20
    drawn = trees(lines, spacing, pitch, count, yaw, random.Random(seed))
    path = write_features(tmp_path_factory.mktemp("trees") / "a.geojson", drawn)
    imported = import_survey(path)
    rows = imported.scenario.survey.rows
    assert len(rows) == lines - 1
    for number, row in enumerate(rows):
        assert row.south == pytest.approx(number * spacing, abs=0.15)
        assert row.length == pytest.approx(pitch * (count - 1), abs=0.3)
    # Twice the angle is the same for a line in either direction.
    found = imported.scenario.survey.origin.yaw
    assert abs(cmath.exp(2j * found) - cmath.exp(2j * yaw)) < 0.02


def test_trees_name_their_lines_and_the_lanes_lie_between(tmp_path):
    features = []
    for i in range(6):
        for j in range(12):
            at = THERE + complex(4.0 * j, -6.0 * i)
            features.append(feature("Point", [at.real, at.imag], row=f"r{i + 1}", tree=j))
    path = write_features(tmp_path / "a.geojson", features)
    imported = import_survey(path)
    rows = imported.scenario.survey.rows
    assert [row.id for row in rows] == ["r1-r2", "r2-r3", "r3-r4", "r4-r5", "r5-r6"]
    assert [row.length for row in rows] == pytest.approx([44.0] * 5, abs=0.01)
    assert "72 trees stand in 6 lines, 4.00 m apart in a line" in imported.notes
    lanes = import_survey(path, ImportOptions(lines="lanes"))
    assert lanes.scenario.rows == 6


def test_a_tree_outside_all_lines_is_left_out_by_name(tmp_path):
    drawn = trees(5, 5.0, 2.0, 30, 0.4, random.Random(1))
    at = THERE + (20 + 30j)
    drawn.append(feature("Point", [at.real, at.imag], name="walnut"))
    imported = import_survey(write_features(tmp_path / "a.geojson", drawn))
    assert imported.scenario.rows == 4
    assert "left out, as fewer than 3 trees stand in a line: walnut" in imported.notes


def test_points_in_no_lines_are_refused_in_words(tmp_path):
    chance = random.Random(3)
    features = []
    for _ in range(8):
        at = THERE + complex(chance.uniform(0, 400), chance.uniform(0, 400))
        features.append(feature("Point", [at.real, at.imag]))
    path = write_features(tmp_path / "a.geojson", features, CIRCUIT)
    with pytest.raises(ScenarioError, match=r"has 0 rows; must be 3 to 100"):
        import_survey(path)
