"""Surveys of orchards for tests: rows in a frame of their own, and GeoJSON files of them.

In the frame of the rows x runs along the rows, from their western ends; the rows are listed from
north to south. A point is a complex number x + yj, m. So a turn is a product, a shift a sum.
"""

import cmath
import json
from pathlib import Path
from typing import Any, NamedTuple

from hypothesis import strategies as st
from stage import empty_orchard

from orchard.field.scenario import Scenario
from orchard.field.survey import CLOSEST, FURTHEST, WIDEST_GAP

# Coordinates of New Zealand, Bay of Plenty 2000, and a point in the middle of its area, m: there
# its metres are those on the ground.
CIRCUIT = "EPSG:2107"
THERE = complex(400_000.0, 800_000.0)
# 0.3 rad, times j. So far the rows of `straight_rows` are turned from east to north: they run 72.8
# degrees clockwise from north.
TURN = 0.3j


class Row(NamedTuple):
    """A row in the frame of the rows, m: how far it is south of the first row, where it begins, and
    its length.
    """

    south: float
    start: float
    length: float


UNEQUAL = (Row(0.0, 0.0, 29.0), Row(5.3, 3.5, 21.3), Row(13.1, 1.0, 30.2), Row(18.6, 6.0, 24.0))


@st.composite
def rows(draw: st.DrawFn, fewest: int = 3, most: int = 8) -> list[Row]:
    """Draw rows within all limits of a survey, in whole centimetres.

    In half of the draws a gap is as wide as if a row were missing there.
    """
    gaps = draw(
        st.lists(
            st.floats(CLOSEST, FURTHEST).map(lambda gap: round(gap, 2)),
            min_size=fewest - 1,
            max_size=most - 1,
        )
    )
    if draw(st.booleans()):
        gaps[draw(st.integers(1, len(gaps))) - 1] = round(draw(st.floats(FURTHEST, WIDEST_GAP)), 2)
    shortest = draw(st.floats(50.0, 140.0))
    # Of each row, x of its west and of its east end.
    ends = [
        (round(draw(st.floats(0.0, 29.0)), 2), round(shortest + draw(st.floats(0.0, 29.0)), 2))
        for _ in range(len(gaps) + 1)
    ]
    souths = [round(sum(gaps[:i]), 2) for i in range(len(ends))]
    west = min(start for start, _ in ends)
    return [
        Row(south, round(start - west, 2), round(end - start, 2))
        for south, (start, end) in zip(souths, ends, strict=True)
    ]


def orchard_of(rows: list[Row] | tuple[Row, ...], **changes: Any) -> Scenario:
    """Return an empty orchard with these rows as its survey, and with other values changed."""
    listed = [{"id": f"r{number}", **row._asdict()} for number, row in enumerate(rows, start=1)]
    return empty_orchard(
        rows=len(rows),
        row_length=round(max(row.start + row.length for row in rows), 6),
        survey={"rows": listed},
        **changes,
    )


def points_of(row: Row) -> list[complex]:
    """Return five points of a row at equal distances, from its west end to its east end."""
    return [complex(row.start + row.length * share / 4, -row.south) for share in range(5)]


def write_geojson(
    path: Path, lines: dict[str, list[complex]], yaw: float = 0.0, crs: str = CIRCUIT
) -> Path:
    """Write lines of the rows' frame as GeoJSON, turned by `yaw`, rad, and shifted to `THERE`."""
    turned = {
        name: [THERE + point * cmath.exp(1j * yaw) for point in points]
        for name, points in lines.items()
    }
    features = [
        {
            "type": "Feature",
            "id": name,
            "properties": {},
            "geometry": {"type": "LineString", "coordinates": [[p.real, p.imag] for p in points]},
        }
        for name, points in turned.items()
    ]
    named = {"type": "name", "properties": {"name": crs}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": named, "features": features}))
    return path


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """Return a feature of GeoJSON."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def pair(point: complex) -> list[float]:
    """Turn a point of the rows' frame, m. Return it as a pair of coordinates near `THERE`."""
    there = THERE + point * cmath.exp(TURN)
    return [there.real, there.imag]


def straight_rows(count: int = 5, spacing: float = 6.0, length: float = 60.0) -> list[dict]:
    """Return equal rows r1, r2, ... as features of GeoJSON, from north to south. Metres."""
    features = []
    for i in range(count):
        ends = [pair(complex(0.0, -spacing * i)), pair(complex(length, -spacing * i))]
        features.append(feature("LineString", ends, row=f"r{i + 1}"))
    return features


def write_features(path: Path, features: list[dict], crs: str | None = CIRCUIT) -> Path:
    """Write features as a GeoJSON file."""
    content: dict[str, Any] = {"type": "FeatureCollection", "features": features}
    if crs is not None:
        content["crs"] = {"type": "name", "properties": {"name": crs}}
    path.write_text(json.dumps(content))
    return path
