"""Chooses the features of a file that are rows: all must be of one kind, and may be of one block.

The others are left out, and the user is told which. A block is a part of an orchard, named by a
property of its rows.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.features import LINE, POINT, POLYGON, Feature
from orchard.surveys.options import Source

# Properties that say to which block a row belongs, in small letters.
BLOCK_KEYS = ("block", "block_name", "block_id", "blockname", "paddock", "field", "folder")
# Properties that say what a feature is.
_TYPE_KEYS = ("type", "kind", "class", "category", "building", "landuse", "description")
# Names in a list for people; of more names only the number is told.
MOST_LISTED = 10
# Characters of a block's name, and of a word that says what a feature is.
LONGEST_BLOCK = 60
LONGEST_TYPE = 30
# A closed line is an outline if its area is at least that of a square whose side is this share of
# the line's length. Else it is a row that is drawn there and back.
OUTLINE = 0.02


class Chosen(NamedTuple):
    """The features that are rows, and what was left out."""

    features: list[Feature]
    #: The kind of all of them: LINE, POLYGON or POINT.
    kind: str
    #: What was left out, a sentence each.
    notes: list[str]


def chosen(features: Sequence[Feature], source: Source) -> Chosen:
    """Return the features that are rows. Raises ScenarioError."""
    of_block = _of_block([_as_area(feature) for feature in features], source)
    _check_names(of_block, source)
    left_out_by_user = []
    rest = []
    for feature in of_block:
        if feature.name in source.options.without:
            left_out_by_user.append(feature)
        else:
            rest.append(feature)
    kind = _kind(rest, source)
    used = []
    of_other_kinds = []
    for feature in rest:
        if feature.kind == kind:
            used.append(feature)
        else:
            of_other_kinds.append(feature)
    notes = []
    if left_out_by_user:
        notes.append(f"left out, as --without says: {_listed_words(left_out_by_user)}")
    if of_other_kinds:
        words = _listed_words(of_other_kinds)
        notes.append(f"left out, as {_plural(of_other_kinds)} no {_KINDS[kind]}: {words}")
    return Chosen(used, kind, notes)


def _check_names(features: Sequence[Feature], source: Source) -> None:
    """Raise ScenarioError if a name that the user leaves out is that of no feature."""
    names = [feature.name for feature in features]
    for name in source.options.without:
        if name not in names:
            text = f"has no feature {printable(name)}; it has {listed(names)}"
            raise ScenarioError([Problem(source.file, text)])


def _listed_words(features: Sequence[Feature]) -> str:
    """Return features with their kinds as a list in words."""
    return listed([_words(feature) for feature in features])


# Kind of feature -> what a feature of it is for a row, in words.
_KINDS = {LINE: "line of a row", POLYGON: "polygon", POINT: "point of a tree"}


def _plural(features: Sequence[Feature]) -> str:
    """Return the subject and the verb for so many features."""
    if len(features) == 1:
        return "it is"
    return "each is"


def _as_area(feature: Feature) -> Feature:
    """Return a feature; a closed line around an area as a polygon: it is an outline, and no row."""
    if feature.kind != LINE or len(feature.parts) != 1:
        return feature
    points = feature.parts[0]
    # A triangle has three corners, and its first point again.
    if len(points) < 4 or points[0] != points[-1]:
        return feature
    # The area by the shoelace formula, about the first point: coordinates may be large numbers.
    local = points - points[0]
    products = local[:-1].real * local[1:].imag - local[1:].real * local[:-1].imag
    area = abs(float(np.sum(products))) / 2
    length = float(np.abs(np.diff(points)).sum())
    if area < (OUTLINE * length) ** 2:
        return feature
    return feature._replace(kind=POLYGON)


def _of_block(features: list[Feature], source: Source) -> list[Feature]:
    """Return the features of the block that the user names; all, if the user names none.

    Raises ScenarioError for a block that the file does not have.
    """
    name = source.options.block
    if name is None:
        return features
    blocks = blocks_of(features)
    if name not in blocks:
        wanted = "none of its features names one"
        if blocks:
            wanted = f"it has {listed(list(blocks))}"
        keys = listed(list(BLOCK_KEYS))
        problem = Problem(
            source.file,
            f"has no block {printable(name)}; {wanted} (a block is a property {keys} of a row)",
        )
        raise ScenarioError([problem])
    return [feature for feature in features if block_of(feature) == name]


def block_of(feature: Feature) -> str:
    """Return the name of the block to which a feature belongs; "" if it names none."""
    for key, value in feature.properties.items():
        if key.lower() in BLOCK_KEYS and isinstance(value, str | int) and str(value):
            return printable(str(value), LONGEST_BLOCK)
    return ""


def blocks_of(features: Sequence[Feature]) -> dict[str, list[Feature]]:
    """Return the features of each block, in the order of the file."""
    blocks = defaultdict(list)
    for feature in features:
        name = block_of(feature)
        if name:
            blocks[name].append(feature)
    return dict(blocks)


def _kind(features: Sequence[Feature], source: Source) -> str:
    """Return the kind of features that are rows: the first one that there is.

    That is lines before polygons before points. A user who gives a spacing wants a polygon, the
    outline of a block. Raises ScenarioError if there is none then.
    """
    kinds = {feature.kind for feature in features}
    if source.options.spacing is not None:
        if POLYGON not in kinds:
            text = "has no polygon; --spacing is for the outline of a block"
            raise ScenarioError([Problem(source.file, text)])
        return POLYGON
    for kind in (LINE, POLYGON, POINT):
        if kind in kinds:
            return kind
    return LINE


def _words(feature: Feature) -> str:
    """Return a feature in words: "number 12 (Point, shed)"."""
    parts = [feature.kind_in_file.strip("'")]
    for key in _TYPE_KEYS:
        value = feature.properties.get(key)
        if isinstance(value, str) and value:
            parts.append(printable(value, LONGEST_TYPE))
            break
    return f"{feature.name} ({', '.join(parts)})"


def listed(words: Sequence[str], most: int = MOST_LISTED) -> str:
    """Return some words as a list in a sentence, "a, b and 3 more"."""
    if len(words) > most + 1:
        words = [*words[:most], f"{len(words) - most} more"]
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
