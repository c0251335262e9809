"""Reads CSV with a line of column names: the ends of rows, or trees.

A record, a line of the table, is a point with the name of its row, or a row with both ends. Columns
may be parted by commas, semicolons or tabs. Unless commas part them, numbers may have a decimal
comma.
"""

import csv
import io
import math
import re
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.choosing import listed
from orchard.surveys.features import LINE, LONGITUDE_LATITUDE, POINT, Feature, SurveyFile
from orchard.surveys.texts import text_of

# Names of columns, in small letters and without spaces and signs.
_LATITUDE = ("latitude", "lat")
_LONGITUDE = ("longitude", "long", "lon", "lng")
_NORTHING = ("northing", "north", "y", "n")
_EASTING = ("easting", "east", "x", "e")
_ROW = ("row", "rowid", "rowname", "rownumber", "rowno", "line", "name", "id", "fid")
_TREE = ("tree", "treeid", "treeno", "vine", "plant", "plantid")
# Beginnings and ends of the names of columns that are of one end of a row.
_ENDS = (("start", "begin", "from", "1"), ("end", "to", "2"))
# If a table has more points than this of a row, on average, they are its trees, not its ends.
MOST_OF_A_LINE = 3.0
# An example for users.
COLUMNS = "row,latitude,longitude"
NO_NAMES = (
    "no column names rows or trees, so the points are taken for trees; if they are the ends of"
    " rows, name the rows in a column `row`"
)
# The separator is the one that stands most often in the first line; of equal ones the first here.
_SEPARATORS = ";\t,"


class _Columns:
    """What the columns of a table mean. A column is a number, from 0; None: there is none."""

    def __init__(self, names: list[str]) -> None:
        """Find the columns. `names`: as the file has them."""
        self.names = names
        # Without case, spaces and signs.
        plain = [re.sub(r"[^a-z0-9]", "", name.lower()) for name in names]
        #: The column with the names of rows, and the one with names of trees.
        self.row = _first(plain, _ROW)
        self.tree = _first(plain, _TREE)
        #: Whether places are degrees.
        self.is_geographic = True
        #: Columns of x and y of a point, or a pair for each end of a row; empty: none was found.
        self.places: list[tuple[int, int]] = []
        self._find(plain, _LONGITUDE, _LATITUDE)
        if not self.places:
            self.is_geographic = False
            self._find(plain, _EASTING, _NORTHING)

    def _find(
        self, plain: list[str], eastings: tuple[str, ...], northings: tuple[str, ...]
    ) -> None:
        """Find the columns of places, and set `places`.

        `plain`: the names of all columns, without case, spaces and signs. `eastings`, `northings`:
        possible names for x and for y.
        """
        x = _first(plain, eastings)
        y = _first(plain, northings)
        if x is not None and y is not None:
            self.places = [(x, y)]
            return
        ends = []
        for words in _ENDS:
            x = _first(plain, _with_end(eastings, words))
            y = _first(plain, _with_end(northings, words))
            if x is None or y is None:
                return
            ends.append((x, y))
        self.places = ends


def _first(plain: list[str], names: tuple[str, ...]) -> int | None:
    """Return the column with the first of these names that is there; None: there is none."""
    for name in names:
        if name in plain:
            return plain.index(name)
    return None


def _with_end(names: tuple[str, ...], words: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of columns of one end of a row: "startlat", "latstart".

    `names`: of a coordinate. `words`: for this end.
    """
    result = []
    for word in words:
        for name in names:
            result += [f"{word}{name}", f"{name}{word}"]
    return tuple(result)


class _Record(NamedTuple):
    """A line of the table."""

    #: Of the line in the file, from 1.
    number: int
    #: A point, or both ends of a row: x + i y.
    points: list[complex]
    #: Name of a column -> text in it.
    properties: dict[str, Any]


def read_table(content: bytes, file: str) -> SurveyFile:
    """Return what a CSV text holds. Raises ScenarioError if it is none."""
    text, notes = text_of(content)
    head = text.lstrip().partition("\n")[0]
    separator = max(_SEPARATORS, key=head.count)
    columns = _columns_of(head, separator, file)
    records, problems = _records(text, separator, columns, file)
    if len(columns.places) == 2:
        features = [_row(record, columns) for record in records]
    else:
        features = _features_of_points(records, columns)
        if columns.row is None and columns.tree is None:
            notes = (*notes, NO_NAMES)
    crs = ""
    if columns.is_geographic:
        crs = LONGITUDE_LATITUDE
    return SurveyFile(features, crs, problems, notes)


def _columns_of(head: str, separator: str, file: str) -> _Columns:
    """Return what the columns mean. Raises ScenarioError if none has places.

    `head`: the first line of the table.
    """
    try:
        names = next(csv.reader([head], delimiter=separator))
    except (csv.Error, StopIteration):
        names = []
    columns = _Columns([name.strip() for name in names])
    if not columns.places:
        shown = printable(head.strip(), 60)
        text = (
            f"is neither GeoJSON nor KML, and as CSV its first line names no places: {shown}. It"
            f" must name columns such as {COLUMNS}, or row,easting,northing"
        )
        raise ScenarioError([Problem(file, text)])
    return columns


def _records(
    text: str, separator: str, columns: _Columns, file: str
) -> tuple[list[_Record], list[Problem]]:
    """Return the records of the table that can be read, and what is wrong with the others."""
    reader = csv.reader(io.StringIO(text.lstrip(), newline=""), delimiter=separator)
    records = []
    problems = []
    try:
        next(reader)
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            line = f"line {reader.line_num}"
            try:
                points = [_point(cells, place, columns, separator) for place in columns.places]
            except ValueError as error:
                problems.append(Problem(file, str(error), line))
                continue
            properties = dict(zip(columns.names, cells, strict=False))
            records.append(_Record(reader.line_num, points, properties))
    except csv.Error as error:
        problems.append(Problem(file, f"is no CSV: {error}", f"line {reader.line_num}"))
    return records, problems


def _point(cells: list[str], place: tuple[int, int], columns: _Columns, separator: str) -> complex:
    """Return the point in some cells of a record. Raises ValueError if it is no point.

    `place`: the columns of x and y.
    """
    values = []
    for column in place:
        cell = ""
        if column < len(cells):
            cell = cells[column].strip()
        if separator != "," and "." not in cell:
            cell = cell.replace(",", ".")
        try:
            # Python would read 17_6 as 176. With a space it is no number.
            value = float(cell.replace("_", " "))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(
                f"{columns.names[column]} is {printable(cell, 40)!r}; must be a decimal number,"
                " such as -37.79"
            )
        values.append(value)
    x, y = values
    return complex(x, y)


def _row_name(record: _Record, columns: _Columns) -> str:
    """Return the name of a record's row; "" if it has none."""
    if columns.row is None:
        return ""
    return str(record.properties.get(columns.names[columns.row], "")).strip()


def _row(record: _Record, columns: _Columns) -> Feature:
    """Return a record with both ends of a row as a feature."""
    name = _row_name(record, columns) or f"line {record.number}"
    points = np.array(record.points)
    feature = Feature(name, LINE, "row", (points,), record.properties)
    if points[0] == points[-1]:
        return feature._replace(fault="must have two different ends")
    return feature


def _are_trees(columns: _Columns, records_of: dict[str, list[_Record]]) -> bool:
    """Whether the points of a table are trees, and not the ends of rows.

    `records_of`: name of a row, "" for none -> its points.
    """
    if columns.tree is not None or "" in records_of:
        return True
    count = sum(len(of_row) for of_row in records_of.values())
    rows = len(records_of)
    # If each point has a name of its own, these are names of points, and not of rows.
    return count == rows or count > MOST_OF_A_LINE * rows


def _features_of_points(records: list[_Record], columns: _Columns) -> list[Feature]:
    """Return rows, if there are two or three points of each on average, else trees."""
    records_of: dict[str, list[_Record]] = defaultdict(list)
    for record in records:
        records_of[_row_name(record, columns)].append(record)
    if not _are_trees(columns, records_of):
        return [_row_of_points(name, of_row) for name, of_row in records_of.items()]
    # If no two points have the same name in it, the column names points, as an id does, not rows.
    are_in_rows = columns.row is not None and len(records) > len(records_of)
    trees = []
    for record in records:
        properties = record.properties
        if are_in_rows:
            properties = properties | {"row": _row_name(record, columns)}
        points = np.array(record.points)
        trees.append(Feature(f"line {record.number}", POINT, "point", (points,), properties))
    return trees


def _row_of_points(name: str, records: Sequence[_Record]) -> Feature:
    """Return the row that has these points. Points at one place are one end only: a fault."""
    points = np.array([record.points[0] for record in records])
    fault = ""
    if len(set(points.tolist())) < 2:
        numbers = listed([str(record.number) for record in records])
        fault = f"has one end, on line {numbers}; must have two"
    return Feature(name, LINE, "row", (points,), records[0].properties, fault=fault)
