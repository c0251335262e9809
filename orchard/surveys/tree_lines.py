"""Lines of trees: the rows that are picked are the lanes between them.

A file's lines may be lanes or lines of trees. `note_of_lines` finds out which, or asks the user.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.field.survey import MISSING
from orchard.surveys.features import Feature, short_names
from orchard.surveys.options import LANES, TREES, Source
from orchard.surveys.plane import middle
from orchard.surveys.rows import SurveyedLine, TurnedLines

# Words in the name of a file, of a feature, or in a property that tell of trees.
_TREE_WORD = re.compile(r"(?<![a-z])(trees?|vines?|trunks?|canopy|canopies)(?![a-z])")


def lanes_between(trees: TurnedLines) -> tuple[TurnedLines, list[str]]:
    """Return the lanes midway between lines of trees, in the rows' frame, and notes.

    A lane is as long as the lines beside it are on average. There is none where lines of trees
    are missing, or a road passes.
    """
    # From north to south.
    ys = [middle(line.points.imag) for line in trees.lines]
    gaps = [north - south for north, south in pairwise(ys)]
    if not gaps:
        return TurnedLines([], trees.yaw), []
    usual = median(gaps)
    lanes = []
    wide_gaps = []
    names = [f"{north.id}-{south.id}" for north, south in pairwise(trees.lines)]
    short = short_names(names)
    for gap, name, (north, south) in zip(gaps, names, pairwise(trees.lines), strict=True):
        if gap >= MISSING * usual:
            wide_gaps.append(f"{short[name]} ({gap:.2f} m)")
            continue
        lanes.append(SurveyedLine(short[name], _midway(north.points, south.points)))
    notes = []
    if wide_gaps:
        notes.append(
            f"no row between these lines of trees, which lie {MISSING:g} times the usual"
            f" {usual:.2f} m apart and more: {', '.join(wide_gaps)}"
        )
    return TurnedLines(lanes, trees.yaw), notes


def _midway(north: np.ndarray, south: np.ndarray) -> np.ndarray:
    """Return the ends of the lane between two lines, (2,) complex."""
    west = (north.real.min() + south.real.min()) / 2
    east = (north.real.max() + south.real.max()) / 2
    y = (middle(north.imag) + middle(south.imag)) / 2
    return np.array([complex(west, y), complex(east, y)])


def note_of_lines(features: Sequence[Feature], count: int, source: Source) -> str:
    """Return the note that lines were taken for lanes, and how the user says otherwise.

    Raises ScenarioError where the file speaks of trees, and the user does not say what lines are.
    `count`: of the lines.
    """
    if source.options.lines == LANES:
        return ""
    word = _tree_word(features, source)
    if not word:
        return (
            f"the {count} lines are taken for lanes, which a picker drives between two lines of"
            f" trees. If they are lines of trees, there are at most {count - 1} rows:"
            f" {source.command(lines=TREES)}"
        )
    as_trees = (
        f"{source.command(lines=TREES)} (they are lines of trees: at most {count - 1} rows between)"
    )
    as_lanes = f"{source.command(lines=LANES)} (they are lanes that a picker drives: {count} rows)"
    problem = Problem(
        source.file,
        f"has {count} lines, and speaks of trees ({word}). Say what they are:"
        f" {as_trees}, or {as_lanes}",
    )
    raise ScenarioError([problem])


def _tree_word(features: Sequence[Feature], source: Source) -> str:
    """Return a name or a value of a file that tells of trees; "" if there is none."""
    texts = [source.path.stem]
    for feature in features:
        texts.append(feature.name)
        for value in feature.properties.values():
            if isinstance(value, str):
                texts.append(value)
    for text in texts:
        if _TREE_WORD.search(text.lower()):
            return printable(text, 60)
    return ""
