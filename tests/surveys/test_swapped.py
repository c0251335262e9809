"""Latitude and longitude, or northing and easting, in the wrong order are found and asked about."""

import pytest
from made_surveys import CIRCUIT, feature, straight_rows, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pyproj = pytest.importorskip(
    "pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'"
)


def swapped(features: list[dict]) -> list[dict]:
    """Swap the coordinates of features, in place. Return them."""
    for row in features:
        geometry = row["geometry"]
        geometry["coordinates"] = [[y, x] for x, y in geometry["coordinates"]]
    return features


def rows_at(longitude: float, latitude: float) -> list[dict]:
    """Return rows somewhere on the earth, in longitude and latitude."""
    features = straight_rows()
    middle = features[2]["geometry"]["coordinates"][0]
    # m, of a degree of latitude. Degrees of longitude are shorter: so rows are, too.
    degree = 111_000.0
    for row in features:
        geometry = row["geometry"]
        geometry["coordinates"] = [
            [longitude + (x - middle[0]) / degree, latitude + (y - middle[1]) / degree]
            for x, y in geometry["coordinates"]
        ]
    return features


@pytest.mark.parametrize(
    ("longitude", "latitude", "reason"),
    [
        (176.3, -37.8, "a latitude of 176.30 degrees cannot be"),
        # These would lie in the North Atlantic, and in the Indian Ocean.
        (20.0, -33.0, "the place lies in the sea"),
    ],
)
def test_swapped_degrees_are_found_with_the_command(tmp_path, longitude, latitude, reason):
    right = rows_at(longitude, latitude)
    path = write_features(tmp_path / "a.geojson", right, None)
    length = import_survey(path).scenario.row_length
    write_features(path, swapped(right), None)
    with pytest.raises(ScenarioError) as raised:
        import_survey(path)
    assert f"its coordinates seem swapped: {reason}" in str(raised.value)
    assert f"orchard layout import {path} --swap-coordinates" in str(raised.value)
    imported = import_survey(path, ImportOptions(swap_coordinates=True))
    assert imported.scenario.row_length == length
    assert imported.latitude == pytest.approx(latitude, abs=0.01)
    assert imported.longitude == pytest.approx(longitude, abs=0.01)


def test_northing_before_easting_is_found(tmp_path):
    features = straight_rows()
    to = pyproj.Transformer.from_crs(CIRCUIT, "EPSG:2193", always_xy=True)
    for row in features:
        geometry = row["geometry"]
        geometry["coordinates"] = [list(to.transform(*at)) for at in geometry["coordinates"]]
    path = write_features(tmp_path / "a.geojson", swapped(features), "EPSG:2193")
    with pytest.raises(ScenarioError, match="its coordinates seem swapped: the place lies outside"):
        import_survey(path)
    assert import_survey(path, ImportOptions(swap_coordinates=True)).scenario.rows == 5


def test_coordinates_in_the_sea_can_be_kept(tmp_path):
    """A user may say that they are right as they are."""
    path = write_features(tmp_path / "a.geojson", swapped(rows_at(20.0, -33.0)), None)
    imported = import_survey(path, ImportOptions(swap_coordinates=False))
    assert imported.latitude == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize("place", [(176.3, -37.8), (11.6, 44.4), (-120.5, 46.6), (-71.2, -34.9)])
def test_places_of_orchards_are_not_asked_about(tmp_path, place):
    features = rows_at(*place)
    imported = import_survey(write_features(tmp_path / "a.geojson", features, None))
    assert (imported.longitude, imported.latitude) == pytest.approx(place, abs=0.01)


def test_rows_that_fit_with_swapped_coordinates_are_told(tmp_path):
    """These rows lie in Finland, 3.8 m apart; swapped, they lie in Oman, 3.5 m apart."""
    features = []
    for i in range(5):
        latitude = 60.0 + i * 3.8 / 111_412.0
        ends = [[latitude, 24.0], [latitude, 24.0015]]
        features.append(feature("LineString", ends, row=f"r{i}"))
    path = write_features(tmp_path / "a.geojson", features, None)
    with pytest.raises(ScenarioError) as raised:
        import_survey(path)
    swap = f"orchard layout import {path} --swap-coordinates"
    assert f"its rows would fit with the northing first: {swap}" in str(raised.value)
