"""A scenario from a file of surveyed rows: the way that all formats take."""

from pathlib import Path

from orchard.field.problems import Problem, ScenarioError, key_text
from orchard.field.scenario import Scenario
from orchard.field.survey import FEWEST_ROWS, MOST_ROWS
from orchard.folders import regular
from orchard.surveys.features import LINE, Feature, SurveyFile
from orchard.surveys.geojson import read_geojson
from orchard.surveys.plane import on_a_plane
from orchard.surveys.rows import SurveyedLine, faults_of_lines, scenario_of, turned

LARGEST_FILE = 10_000_000  # bytes


def import_rows(path: Path, crs: str | None = None) -> Scenario:
    """Return a scenario with the rows of a GeoJSON file.

    `crs`: their coordinate system, such as EPSG:2193; None: the one in the file.

    Raises ScenarioError with all that does not fit, and ModuleNotFoundError if pyproj is not
    installed.
    """
    file = key_text(str(path))
    content = _content(path, file)
    features, problems = _rows_of(content, file)
    if not FEWEST_ROWS <= len(features) <= MOST_ROWS:
        wanted = (
            f"must be {FEWEST_ROWS} to {MOST_ROWS} LineStrings; of a larger orchard, a file for"
            " each block"
        )
        problems.append(Problem(file, f"has {len(features)} rows; {wanted}"))
    if not features:
        raise ScenarioError(problems)
    try:
        plane, features = on_a_plane(features, content.crs if crs is None else crs)
    except ValueError as error:
        raise ScenarioError([*problems, Problem(file, str(error))]) from None
    rows = turned([SurveyedLine(feature.name, feature.parts[0]) for feature in features])
    for name, text in faults_of_lines(rows.lines):
        problems.append(Problem(file, text, f"feature {name}"))
    if problems:
        raise ScenarioError(problems)
    return scenario_of(rows, plane, file)


def _content(path: Path, file: str) -> SurveyFile:
    """Return what a file holds. Raises ScenarioError."""
    try:
        with regular(path).open("rb") as opened:
            text = opened.read(LARGEST_FILE + 1)
    except OSError as error:
        raise ScenarioError([Problem(file, f"cannot be read: {error.strerror}")]) from None
    if len(text) > LARGEST_FILE:
        raise ScenarioError([Problem(file, f"is too large; at most {LARGEST_FILE:,} bytes")])
    return read_geojson(text, file)


def _rows_of(content: SurveyFile, file: str) -> tuple[list[Feature], list[Problem]]:
    """Return the features that are rows, and what is wrong with the others."""
    rows = []
    problems = list(content.problems)
    for feature in content.features:
        fault = feature.fault
        if feature.kind != LINE or len(feature.parts) > 1:
            fault = (
                f"is {feature.kind_in_file}; each feature must be one LineString, the centre line"
                " of a row"
            )
        if fault:
            problems.append(Problem(file, fault, f"feature {feature.name}"))
        else:
            rows.append(feature)
    return rows, problems
