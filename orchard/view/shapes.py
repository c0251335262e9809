"""Shapes: models, which are GLB files for any 3-D program (as Blender), and batches of boxes and discs whose sizes the orchard gives.

A body's model stands with the middle of its base at the origin, x ahead, z up, and fills the length, width and height of its kind; a hat
may rise above them. The colours, sRGB, are those of its vertices.
"""

from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from orchard.view.palette import Colour

MODELS = Path(__file__).with_name("models")
Coordinate = float | Sequence[float] | np.ndarray  # of a middle, m; several numbers: a copy at each


class Part(NamedTuple):
    """A form of one size and colour; or several copies of it in a grid."""

    size: tuple[float, float, float]  # m along x, y, z
    at: tuple[Coordinate, Coordinate, Coordinate]
    colour: Colour | tuple[int, int, int, int]  # sRGB, and perhaps how opaque it is, up to 255


def model(name: str) -> rr.Asset3D:
    """Return the model of a kind of body, or of another thing in MODELS."""
    return rr.Asset3D(path=MODELS / f"{name}.glb")


def boxes(parts: Iterable[Part]) -> rr.Boxes3D:
    """Return all parts as boxes."""
    sizes, middles, colours = _batch(parts)
    return rr.Boxes3D(sizes=sizes, centers=middles, colors=colours, fill_mode="solid")


def discs(parts: Iterable[Part]) -> rr.Ellipsoids3D:
    """Return all parts as ellipsoids: discs, if they are flat."""
    sizes, middles, colours = _batch(parts)
    return rr.Ellipsoids3D(half_sizes=sizes / 2, centers=middles, colors=colours, fill_mode="solid")


def _batch(parts: Iterable[Part]) -> tuple[np.ndarray, np.ndarray, list[Sequence[int]]]:
    """Return the sizes, (n, 3), the middles, (n, 3), and the colours of all copies of all parts."""
    copies = [(part, middle) for part in parts for middle in product(*map(np.ravel, part.at))]
    sizes, middles = (np.array(values) for values in zip(*((part.size, middle) for part, middle in copies), strict=True))
    return sizes, middles, [part.colour for part, _ in copies]
