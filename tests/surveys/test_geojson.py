"""Surveyed rows from GeoJSON: the same scenario from any coordinate system, and each line that does
not fit is told with its id.

Rows are drawn in a frame of their own: a point is a complex number, x along the rows and y towards
the north, m; `THERE` is its origin on the map, and `yaw` turns it, rad. An EPSG code names a
coordinate system; EPSG:2193 is that of New Zealand.
"""

import cmath
import json
import math
from pathlib import Path

import pytest
from bare_world import overlapping_starts
from code_blocks import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from made_surveys import CIRCUIT, THERE, UNEQUAL, Row, points_of, rows, write_geojson
from stage import Stage

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.queue import ONE_WAY, TWO_WAY
from orchard.field.scenario import Scenario, parse, to_short_yaml, with_changes
from orchard.field.survey import CLOSEST, WIDEST_GAP
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pyproj = pytest.importorskip(
    "pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'"
)

SAMPLE = ROOT / "examples" / "te_puke.geojson"
# A coordinate system without a name that pyproj would know it by.
WKT = (
    pyproj.CRS("EPSG:2193")
    .to_wkt()
    .replace('ID["EPSG",2193]', 'REMARK["mine"]')
    .replace("New Zealand Transverse", "My")
)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    """Return the file that each test writes anew."""
    return tmp_path_factory.mktemp("survey") / "rows.geojson"


def import_rows(path: Path, crs: str | None = None) -> Scenario:
    return import_survey(path, ImportOptions(crs=crs)).scenario


def lines_of(drawn: list[Row] | tuple[Row, ...]) -> dict[str, list[complex]]:
    """Return the lines of rows by id, every second one from east to west, as a surveyor walks."""
    lines = {}
    for number, row in enumerate(drawn, start=1):
        points = points_of(row)
        if number % 2 == 0:
            points.reverse()
        lines[f"r{number}"] = points
    return lines


def error_of(file: Path, crs: str | None = None) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        import_rows(file, crs)
    return str(raised.value)


@settings(max_examples=15)
@given(drawn=rows(), yaw=st.floats(-1.57, 1.57), data=st.data())
def test_any_legal_survey_is_laid_out_without_overlaps(
    file: Path, drawn: list[Row], yaw: float, data
):
    order = data.draw(st.permutations(list(lines_of(drawn).items())))
    scenario = import_rows(write_geojson(file, dict(order), yaw))
    layout = lay_out(scenario)
    survey = scenario.survey
    # Rows come in their order from the north, whatever the order in the file. A scenario has them
    # in mm.
    assert [row.id for row in survey.rows] == list(lines_of(drawn))
    for row, wanted in zip(survey.rows, drawn, strict=True):
        assert (row.south, row.start, row.length) == pytest.approx(wanted, abs=0.002)
    assert overlapping_starts(layout) == []
    assert survey.origin.crs == CIRCUIT
    for row, lane in zip(drawn, layout.lanes, strict=True):
        there = complex(row.start, -row.south) * cmath.exp(1j * yaw)
        assert complex(*survey.origin.place(lane.west, lane.y)) - THERE == pytest.approx(
            there, abs=0.005
        )
    assert parse(to_short_yaml(scenario)) == scenario


@settings(max_examples=10)
@given(noise=st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3), yaw=st.floats(-1.5, 1.5))
def test_a_row_may_be_as_crooked_as_the_limit_says(file: Path, noise: list[float], yaw: float):
    """Points between the ends of a row may be 0.2 m off the straight line, here 0.99 of that."""
    lines = lines_of([Row(7.0 * i, 0.0, 60.0) for i in range(4)])
    lines["r2"] = [
        point + 0.99j * off for point, off in zip(lines["r2"], [0.0, *noise, 0.0], strict=True)
    ]
    assert import_rows(write_geojson(file, lines, yaw)).rows == 4


@pytest.mark.parametrize("crs", ["OGC:CRS84", "EPSG:32760", "EPSG:27200", "EPSG:3857", "EPSG:2193"])
def test_the_same_rows_come_from_any_coordinate_system(crs: str, file: Path):
    survey = import_rows(SAMPLE).survey
    content = json.loads(SAMPLE.read_text())
    to = pyproj.Transformer.from_crs("EPSG:2193", crs, always_xy=True)
    for feature in content["features"]:
        feature["geometry"] = {
            "type": "MultiLineString",
            "coordinates": [[to.transform(*at) for at in feature["geometry"]["coordinates"]]],
        }
    del content["crs"]
    file.write_text(json.dumps(content))
    other = import_rows(file, None if crs == "OGC:CRS84" else crs).survey
    for row, same in zip(survey.rows, other.rows, strict=True):
        assert (same.south, same.start, same.length) == pytest.approx(
            (row.south, row.start, row.length), abs=0.003
        )
    back = pyproj.Transformer.from_crs(other.origin.crs, "EPSG:2193", always_xy=True)
    assert back.transform(*other.origin.place(40.0, -20.0)) == pytest.approx(
        survey.origin.place(40.0, -20.0), abs=0.02
    )


def test_rows_from_south_to_north_turn_by_the_smaller_angle(file: Path):
    """A yaw is at most 90 degrees: rows at 100 degrees are taken from their other ends, at -80.

    Then the last row lies in the north.
    """
    scenario = import_rows(write_geojson(file, lines_of(UNEQUAL), math.radians(80.0)))
    assert scenario.survey.origin.yaw == pytest.approx(math.radians(80.0), abs=1e-6)
    back = import_rows(write_geojson(file, lines_of(UNEQUAL), math.radians(100.0))).survey
    assert back.origin.yaw == pytest.approx(math.radians(-80.0), abs=1e-6)
    assert [row.id for row in back.rows] == ["r4", "r3", "r2", "r1"], "the last one in the north"


@pytest.mark.parametrize("crs", ["EPSG:5513", "EPSG:2053"])
def test_a_system_that_counts_south_mirrors_no_rows(crs: str, file: Path):
    """EPSG:5513 counts to the south and then the west, EPSG:2053 to the west and then the south.

    The import turns to the UTM zone of the place, which counts to the east and the north. `there`
    is a place in it.
    """
    utm = {"EPSG:5513": "EPSG:32633", "EPSG:2053": "EPSG:32735"}[crs]
    there = {
        "EPSG:5513": complex(500_000.0, 5_538_000.0),
        "EPSG:2053": complex(700_000.0, 7_123_000.0),
    }[crs]
    to = pyproj.Transformer.from_crs(utm, crs, always_xy=True)
    lines = {
        name: [there + p * cmath.exp(0.3j) for p in points]
        for name, points in lines_of(UNEQUAL).items()
    }
    features = [
        {
            "id": name,
            "geometry": {
                "type": "LineString",
                "coordinates": [to.transform(p.real, p.imag) for p in points],
            },
        }
        for name, points in lines.items()
    ]
    file.write_text(json.dumps({"features": features}))
    survey = import_rows(file, crs).survey
    assert survey.origin.crs == utm
    assert survey.origin.yaw == pytest.approx(0.3, abs=1e-5)
    for row, wanted in zip(survey.rows, UNEQUAL, strict=True):
        assert (row.south, row.start, row.length) == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize("x", ["400000.0", True])
def test_a_coordinate_that_is_no_number_is_refused(x, file: Path):
    write_geojson(file, lines_of(UNEQUAL))
    content = json.loads(file.read_text())
    content["features"][0]["geometry"]["coordinates"][0][0] = x
    file.write_text(json.dumps(content))
    assert "each point must be two finite numbers" in error_of(file)


@pytest.mark.filterwarnings("error")
def test_a_place_beyond_all_systems_is_refused_without_a_warning(file: Path):
    write_geojson(file, lines_of(UNEQUAL))
    content = json.loads(file.read_text())
    content["features"][0]["geometry"]["coordinates"][0][0] = 1e308
    file.write_text(json.dumps(content))
    assert "is no place in the coordinate system" in error_of(file)


def test_lines_that_go_there_and_back_are_rows(file: Path):
    there_and_back = {
        name: [*points, *points[-2::-1]] for name, points in lines_of(UNEQUAL).items()
    }
    survey, other = (
        import_rows(write_geojson(file, lines, 0.3)).survey
        for lines in (there_and_back, lines_of(UNEQUAL))
    )
    assert survey == other


@pytest.mark.parametrize(
    "name", ["1e3", "12E4", "1.5e3", "010", "on", "null", "0x1F", "2001-01-01", "a: b # c"]
)
def test_an_odd_name_stays_the_name_in_the_scenario_file(name: str, file: Path):
    """In YAML such a name looks like a number, a date or a list."""
    lines = lines_of(UNEQUAL)
    scenario = import_rows(
        write_geojson(file, {name if old == "r1" else old: points for old, points in lines.items()})
    )
    assert scenario.survey.rows[0].id == name
    assert parse(to_short_yaml(scenario)) == scenario


# What makes a line no row, given its points, and what is said of it.
BROKEN = {
    "bent": (
        lambda points: [*points[:2], points[2] + 0.5j, *points[3:]],
        "is bent: 0.25 m off a straight line; must be at most 0.2 m",
    ),
    "askew": (
        lambda points: [points[0] + (point - points[0]) * cmath.exp(0.02j) for point in points],
        "is not parallel:",
    ),
    "short": (
        lambda points: [
            points[0],
            points[0] + (points[-1] - points[0]) / abs(points[-1] - points[0]) * 19,
        ],
        "must be 20 to 400 m",
    ),
    "long": (
        lambda points: [
            points[0],
            points[0] + (points[-1] - points[0]) / abs(points[-1] - points[0]) * 401,
        ],
        "must be 20 to 400 m",
    ),
    "point": (lambda points: points[:1], "must have at least two different points"),
    "same": (lambda points: [points[0], points[0]], "must have at least two different points"),
}


@settings(max_examples=20)
@given(
    drawn=rows(most=5),
    what=st.sampled_from(sorted(BROKEN)),
    yaw=st.floats(-1.5, 1.5),
    data=st.data(),
)
def test_a_line_outside_the_limits_is_refused_with_its_id(
    file: Path, drawn: list[Row], what: str, yaw: float, data
):
    lines = lines_of(drawn)
    broken = data.draw(st.sampled_from(sorted(lines_of(drawn))))
    breaks, words = BROKEN[what]
    lines[broken] = breaks(lines[broken])
    problems = error_of(write_geojson(file, lines, yaw)).splitlines()
    assert any(
        problem.startswith(f"{file}: feature {broken}: ") and words in problem
        for problem in problems
    ), problems


@settings(max_examples=15)
@given(drawn=rows(fewest=4), by=st.floats(0.05, 3.3), yaw=st.floats(-1.5, 1.5), data=st.data())
def test_rows_too_near_or_too_far_are_refused_with_the_id(
    file: Path, drawn: list[Row], by: float, yaw: float, data
):
    """A row, and all south of it, move, until it is nearer to the one before than rows may be, or
    further, by `by`, m.
    """
    number = data.draw(st.integers(2, len(drawn)))
    is_too_near = data.draw(st.booleans())
    gap = drawn[number - 1].south - drawn[number - 2].south
    if is_too_near:
        to_north = gap - (CLOSEST - by)
    else:
        to_north = gap - (WIDEST_GAP + by)
    lines = lines_of(drawn)
    for i, (name, points) in enumerate(lines.items(), start=1):
        if i >= number:
            lines[name] = [point + to_north * 1j for point in points]
    words = "must be 3.65 to 60 m from centre line to centre line"
    assert any(
        f"feature r{number}: " in problem and words in problem
        for problem in error_of(write_geojson(file, lines, yaw)).splitlines()
    )


def test_all_faults_are_told_at_once(file: Path):
    lines = lines_of([Row(5.6 * i, 0.0, 60.0) for i in range(6)])
    lines["r2"] = BROKEN["bent"][0](lines["r2"])
    lines["r4"] = [lines["r4"][0], lines["r4"][0] - 15.0]
    lines["r6"] = [point - 60.0j for point in lines["r6"]]
    problems = error_of(write_geojson(file, lines))
    words = (
        "r2: is bent",
        "r4: is 15.00 m long",
        "r6: lies 65.60 m south of row r5",
    )
    assert [one for one in words if f"feature {one}" not in problems] == []


def line(coordinates: str) -> str:
    """Return a GeoJSON text with a line."""
    return (
        '{"features": [7, {"geometry": {"type": "LineString", "coordinates":'
        f" {coordinates}}}}}]}}"
    )


TEXT = SAMPLE.read_text()
# The text of a file, the coordinate system that a user names, and what is said.
UNUSABLE = [
    ("{", None, "is not JSON"),
    ("[1, 2]", None, "must be a GeoJSON FeatureCollection"),
    ('{"features": []}', None, "has 0 rows; must be 3 to 100 LineStrings"),
    (
        line('[["a", 1]]'),
        None,
        (
            'feature number 2: its point 1 is ["a", 1]; each point must be two finite numbers, such'
            " as [176.3, -37.8]"
        ),
    ),
    (line("[[1, 2], [NaN, 1]]"), None, "feature number 2: its point 2 is [NaN, 1]; each"),
    (line("[[1, 2], null]"), None, "feature number 2: its point 2 is null; each"),
    (line("3"), None, "at least two different points"),
    (line("[]").replace("LineString", "MultiLineString"), None, "feature number 2: has no points"),
    (line("[[176, -37], [176.001, -37]]"), None, "has 1 rows; must be 3 to 100"),
    (
        '{"features": [7]}',
        None,
        "feature number 1: is 7; must be a Feature, a map with a geometry",
    ),
    (
        TEXT,
        "EPSG:4326",
        "(1892798, 5812275) of feature block-3/1 is no place in the coordinate system WGS 84",
    ),
    (
        TEXT,
        "nonsense",
        (
            "the coordinate system 'nonsense' cannot be used: unrecognized format / unknown name;"
            " name that of"
        ),
    ),
    (
        TEXT,
        "EPSG:999999",
        (
            "'EPSG:999999' cannot be used: crs not found: EPSG:999999; name that of the file,"
            " geographic or"
        ),
    ),
    (TEXT, "", "the coordinate system '' cannot be used"),
    (TEXT, "\ud800", "the coordinate system '?' cannot be used: 'utf-8' codec"),
    (TEXT, WKT, "survey.origin.crs = 'PROJCRS["),
    (
        TEXT,
        "EPSG:5773",
        "'EPSG:5773' has no places on a map: it is Vertical CRS; name that of the file",
    ),
]


@pytest.mark.parametrize(("text", "crs", "words"), UNUSABLE)
def test_a_file_that_cannot_be_used_is_told_in_words(
    text: str, crs: str | None, words: str, file: Path
):
    file.write_text(text)
    assert words in error_of(file, crs)


@pytest.mark.soak
@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
def test_soak_the_sample_is_harvested_to_the_end(route: str):
    stage = Stage(with_changes(import_rows(SAMPLE), pickers=4, route=route))
    stage.run_until(lambda: stage.local.engine.over, 2000)
    stage.assert_no_collisions()
    assert stage.world.delivered == 8
