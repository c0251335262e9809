"""A scenario from a file of surveyed rows: the way that all formats take.

`orchard layout import` and the page call `import_survey`. The files beside this one do its parts,
in the order in which it calls them.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from orchard.field.problems import Problem, ScenarioError, key_text
from orchard.field.queue import LONGEST_ROW
from orchard.field.scenario import check
from orchard.field.survey import CLOSEST, FEWEST_ROWS, FURTHEST, MOST_ROWS, TRUNK
from orchard.surveys.choosing import Chosen, blocks_of, chosen, listed
from orchard.surveys.features import POINT, POLYGON, Feature
from orchard.surveys.files import read_survey
from orchard.surveys.options import LANES, MOST_COMMANDS, TREES, Imported, ImportOptions, Source
from orchard.surveys.outlines import lines_of_polygons
from orchard.surveys.pieces import joined
from orchard.surveys.plane import Plane, on_a_plane, place_on_globe
from orchard.surveys.rows import (
    SurveyedLine,
    TurnedLines,
    drawn_twice,
    faults_of_lines,
    scenario_of,
    turned,
)
from orchard.surveys.swapped import reason_to_swap, with_swapped
from orchard.surveys.tree_lines import lanes_between, note_of_lines
from orchard.surveys.trees import lines_of_trees

# m. Rows of one farm lie nearer to each other.
LARGEST_FARM = 10_000.0


def import_survey(path: Path, options: ImportOptions = ImportOptions()) -> Imported:
    """Return a scenario with the rows of a file, and what was left out, joined or assumed.

    Raises ScenarioError with all that does not fit, and ModuleNotFoundError if a package of the
    extra `survey` is not installed.
    """
    source = Source(key_text(str(path)), path, options)
    _check(options)
    survey = read_survey(source)
    selection = chosen(survey.features, source)
    usable, faulty = _usable(selection.features, source)
    problems = [*survey.problems, *faulty]
    if not usable:
        raise ScenarioError([*problems, _too_few(source.file, 0)])
    system = options.crs
    if system is None:
        system = survey.crs
        if not system:
            raise ScenarioError([*problems, _no_system(source)])
    in_order = _in_order(usable, system, source)
    try:
        plane, on_ground = on_a_plane(in_order, system)
    except ValueError as error:
        raise ScenarioError([*problems, Problem(source.file, str(error))]) from None
    # What was assumed of the file may be why its rows do not fit.
    assumed = [Problem(source.file, note) for note in survey.notes]
    try:
        rows, notes = _rows_of(on_ground, plane, selection, source)
    except ScenarioError as error:
        raise ScenarioError([*error.problems, *assumed]) from None
    problems += _problems_of_rows(rows, in_order, source)
    if problems:
        raise ScenarioError([*problems, *assumed])
    latitude, longitude = place_on_globe(plane)
    return Imported(
        scenario_of(rows, plane, source.file),
        [*survey.notes, *selection.notes, *notes, *_notes_of_blocks(in_order, source)],
        latitude,
        longitude,
        math.degrees(plane.north - rows.yaw) % 180.0,
    )


def _check(options: ImportOptions) -> None:
    """Raise ScenarioError for options that would have no effect."""
    problems = []
    if options.spacing is None:
        for name, value in (("direction", options.direction), ("headland", options.headland)):
            if value is not None:
                text = "is for the outline of a block; give --spacing too"
                problems.append(Problem(f"--{name}", text))
    elif options.lines is not None:
        text = "an outline has no lines; leave out --lines or --spacing"
        problems.append(Problem("--lines", text))
    if problems:
        raise ScenarioError(problems)


def _usable(features: Sequence[Feature], source: Source) -> tuple[list[Feature], list[Problem]]:
    """Return the features that can be rows, and what is wrong with the others."""
    usable = []
    problems = []
    for feature in features:
        if feature.fault:
            problems.append(Problem(source.file, feature.fault, f"feature {feature.name}"))
        else:
            usable.append(feature)
    return usable, problems


def _no_system(source: Source) -> Problem:
    """Return that a file does not say its coordinate system, and how the user can."""
    command = source.command(crs="EPSG:2193")
    return Problem(source.file, f"does not say its coordinate system: {command}, for example")


def _too_few(file: str, count: int) -> Problem:
    """Return that a file has too few or too many rows."""
    wanted = (
        f"must be {FEWEST_ROWS} to {MOST_ROWS} LineStrings, polygons of rows, or lines of trees; of"
        " a larger orchard, a file for each block"
    )
    return Problem(file, f"has {count} rows; {wanted}")


def _in_order(features: list[Feature], system: str, source: Source) -> list[Feature]:
    """Return features with the easting first, and not the northing.

    Raises ScenarioError where coordinates seem swapped, and the user does not say whether they are.
    """
    is_swapped = source.options.swap_coordinates
    if is_swapped is None:
        reason = reason_to_swap(features, system)
        if reason:
            text = (
                f"its coordinates seem swapped: {reason}. Swap them:"
                f" {source.command(swap_coordinates=True)}; or keep them:"
                f" {source.command(swap_coordinates=False)}"
            )
            raise ScenarioError([Problem(source.file, text)])
    if not is_swapped:
        return features
    return with_swapped(features)


def _rows_of(
    features: Sequence[Feature], plane: Plane, selection: Chosen, source: Source
) -> tuple[TurnedLines, list[str]]:
    """Return the lines of rows in their frame, and notes. Raises ScenarioError."""
    # LANES or TREES; None: the user does not say it, and it does not follow from the file.
    lines_are = source.options.lines
    if selection.kind == POINT:
        lines, notes = lines_of_trees(features)
        lines_are = lines_are or TREES
    elif selection.kind == POLYGON:
        lines, notes = lines_of_polygons(features, plane.north, source)
        if source.options.spacing is not None:
            # Rows that were laid out in an outline.
            lines_are = LANES
    else:
        lines, notes = joined(features)
    if not lines:
        return TurnedLines([], 0.0), notes
    rows = turned(lines)
    if lines_are == TREES:
        return _between(rows, notes, source)
    if lines_are is None:
        notes.append(note_of_lines(features, len(lines), source))
    return rows, notes


def _between(trees: TurnedLines, notes: list[str], source: Source) -> tuple[TurnedLines, list[str]]:
    """Return the lanes between lines of trees, and notes. Raises ScenarioError."""
    problems = []
    for name, text in faults_of_lines(trees.lines):
        problems.append(Problem(source.file, text, f"line of trees {name}"))
    if problems:
        raise ScenarioError(problems)
    rows, more = lanes_between(trees)
    taken = (
        f"{len(trees.lines)} lines of trees: the {len(rows.lines)} rows are the lanes midway"
        " between them; fruit outside the outermost lines is left out"
    )
    if source.options.lines is None:
        taken += f". If the points stand on lanes: {source.command(lines=LANES)}"
    return rows, [*notes, taken, *more]


def _problems_of_rows(
    rows: TurnedLines, features: Sequence[Feature], source: Source
) -> list[Problem]:
    """Return what is wrong with rows, and hints how the user gets an answer anyway."""
    # Nothing else that is said of such rows would help.
    misplaced = [*_far_away(rows.lines, source), *_doubles(rows.lines, features, source)]
    if misplaced:
        return misplaced
    count = len(rows.lines)
    problems = []
    if not FEWEST_ROWS <= count <= MOST_ROWS:
        problems.append(_too_few(source.file, count))
    has_faults = False
    if rows.lines:
        for name, text in faults_of_lines(rows.lines):
            problems.append(Problem(source.file, text, f"feature {name}"))
            has_faults = True
    if has_faults or count > MOST_ROWS:
        problems += _hints(rows, features, source)
    return problems


def _far_away(lines: Sequence[SurveyedLine], source: Source) -> list[Problem]:
    """Return that lines lie too far apart for one farm, if they do: one problem."""
    if not lines:
        return []
    middles = [complex(line.points.mean()) for line in lines]
    distances = [abs(place - middles[0]) for place in middles]
    furthest = max(distances)
    if furthest <= LARGEST_FARM:
        return []
    name = lines[distances.index(furthest)].id
    text = (
        f"lies {furthest / 1000.0:.0f} km from {lines[0].id}. If they are in two coordinate"
        " systems, or zones, import the rows of each by themselves, each with its --crs; else"
        " correct or remove what is wrong"
    )
    return [Problem(source.file, text, f"feature {name}")]


def _doubles(
    lines: Sequence[SurveyedLine], features: Sequence[Feature], source: Source
) -> list[Problem]:
    """Return which lines are drawn twice, and how the user leaves one of each out."""
    # Name of a feature -> its place in the file.
    places = {feature.name: number for number, feature in enumerate(features)}
    problems = []
    doubles = []
    for pair in drawn_twice(lines):
        first, second = sorted(pair, key=lambda name: places.get(name, 0))
        problems.append(Problem(source.file, f"is drawn where {first} is", f"feature {second}"))
        # The option leaves out all features of a name.
        if first != second and second in places:
            doubles.append(second)
    if doubles:
        without = (*source.options.without, *doubles)
        hint = f"leave out one of each: {source.command(without=without)}"
        problems.append(Problem(source.file, hint))
    return problems


def _notes_of_blocks(features: Sequence[Feature], source: Source) -> list[str]:
    """Return that the blocks of a file are one orchard, and how to get one of them alone."""
    blocks = blocks_of(features)
    if len(blocks) <= 1:
        return []
    command = source.command(block=next(iter(blocks)))
    fleet = f"blocks {listed(list(blocks))} are one orchard with one fleet at a time"
    return [f"{fleet}; one alone: {command}"]


def _hints(rows: TurnedLines, features: Sequence[Feature], source: Source) -> list[Problem]:
    """Return hints how the user gets an answer although rows do not fit.

    They are shown as problems of the file, after the others.
    """
    hints = []
    if source.options.swap_coordinates is None and _fits(source, swap_coordinates=True):
        text = (
            f"its rows would fit with the northing first: {source.command(swap_coordinates=True)}"
        )
        hints.append(Problem(source.file, text))
    blocks = blocks_of(features)
    if source.options.block is None and len(blocks) > 1:
        commands = [source.command(block=name) for name in blocks]
        text = f"has blocks; each alone may fit: {listed(commands, MOST_COMMANDS)}"
        hints.append(Problem(source.file, text))
    text = "a line that is no row is left out by --without NAME"
    equal_rows = _equal_rows(rows.lines)
    if equal_rows:
        text = f"an answer anyway: equal rows, by a scenario with {equal_rows}; {text}"
    hints.append(Problem(source.file, text))
    return hints


def _equal_rows(lines: Sequence[SurveyedLine]) -> str:
    """Return the keys and values of a scenario with as many equal rows, in words.

    "" if no such scenario is possible.
    """
    # Along the rows: a line may come back to where it began.
    length = median([float(np.ptp(line.points.real)) for line in lines])
    spacing = _usual_spacing(lines)
    nearest_length = min(length, LONGEST_ROW)
    nearest_spacing = min(max(spacing, CLOSEST), FURTHEST)
    values = {
        "rows": len(lines),
        "row_length": round(nearest_length, 1),
        "row_width": round(nearest_spacing - TRUNK, 2),
    }
    try:
        check(values, "")
    except ScenarioError:
        return ""
    text = (
        f"`rows: {values['rows']}`, `row_length: {values['row_length']:.1f}`, `row_width:"
        f" {values['row_width']:.2f}`"
    )
    if nearest_length < length or nearest_spacing != spacing:
        text += ", the nearest that can be, with the `bins_per_row` of your rows"
    return text


def _fits(source: Source, **changes: Any) -> bool:
    """Whether the file would be imported with changes of the options."""
    try:
        import_survey(source.path, replace(source.options, **changes))
    except ScenarioError:
        return False
    return True


def _usual_spacing(lines: Sequence[SurveyedLine]) -> float:
    """Return the usual distance from the middle of a line to the nearest other one, m."""
    middles = [complex(line.points.mean()) for line in lines]
    nearest = []
    for i, middle in enumerate(middles):
        others = [abs(middle - other) for j, other in enumerate(middles) if j != i]
        if others:
            nearest.append(min(others))
    if not nearest:
        return 0.0
    return median(nearest)
