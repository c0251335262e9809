"""Low-poly meshes out of tables of parts: boxes, wheels, posts, balls. Metres; x ahead, y to the left, z up. No rerun in here."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from orchard.view.palette import Colour

LIGHT = np.array([0.35, -0.5, 0.79])  # where the sun stands, for the shade that is painted onto the faces


class MeshPart(NamedTuple):
    """One form, stretched to a size, tilted, and put with its middle at a place."""

    form: str  # a key of FORMS
    size: tuple[float, float, float]  # m along x, y, z before it is tilted
    at: tuple[float, float, float]  # m
    colour: Colour
    pitch: float = 0.0  # degrees, nose up
    yaw: float = 0.0  # degrees, to the left


@dataclass(frozen=True)
class Mesh:
    """Triangles, three vertices of its own each, so that every face is flat."""

    points: np.ndarray  # (3 f, 3) float32
    normals: np.ndarray  # (3 f, 3) float32
    colours: np.ndarray  # (3 f, 3) uint8

    @property
    def triangles(self) -> np.ndarray:
        """(f, 3) uint32: which vertices make each triangle."""
        return np.arange(len(self.points), dtype=np.uint32).reshape(-1, 3)


def mesh_of(parts: Iterable[MeshPart]) -> Mesh:
    """All parts as one mesh, shaded."""
    pieces = [(_placed(part), part.colour) for part in parts]
    corners = np.concatenate([piece for piece, _ in pieces])
    colours = np.concatenate([np.tile(np.array(colour, float), (len(piece), 1)) for piece, colour in pieces])
    return faceted(corners, colours)


def faceted(corners: np.ndarray, colours: np.ndarray) -> Mesh:
    """A mesh of (f, 3, 3) corners and (f, 3) face colours, each face a little darker the further it looks away from the sun."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    shade = 0.90 + 0.10 * np.clip(normals @ LIGHT, -0.8, 1.0)
    painted = np.clip(colours * shade[:, None], 0, 255).astype(np.uint8)
    return Mesh(
        corners.reshape(-1, 3).astype(np.float32),
        np.repeat(normals, 3, axis=0).astype(np.float32),
        np.repeat(painted, 3, axis=0),
    )


def _placed(part: MeshPart) -> np.ndarray:
    """(f, 3, 3): the corners of a part's triangles where they belong."""
    placed: np.ndarray = FORMS[part.form]() * np.array(part.size) @ _turn(part.pitch, part.yaw).T + np.array(part.at)
    return placed


def _turn(pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix: first the nose up, then to the left; degrees."""
    a, b = np.radians(-pitch), np.radians(yaw)
    tilt = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    swing = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    turn: np.ndarray = swing @ tilt
    return turn


# -- forms: (f, 3, 3) corners of triangles, counter-clockwise from outside, within a cube of 1 m around the origin


def _hull(points: np.ndarray | Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> np.ndarray:
    """Triangles of flat faces, turned so that each looks away from the middle."""
    p = np.array(points, float)
    fans = np.array([(p[f[0]], p[f[i]], p[f[i + 1]]) for f in faces for i in range(1, len(f) - 1)])
    outward = np.cross(fans[:, 1] - fans[:, 0], fans[:, 2] - fans[:, 0])
    inside_out = np.sum(outward * (fans.mean(axis=1) - p.mean(axis=0)), axis=1) < 0
    fans[inside_out] = fans[inside_out][:, ::-1]
    return fans


@cache
def _tapered(top_x: float, top_y: float, shift: float = 0.0) -> np.ndarray:
    """A box whose top is narrower, and moved along x."""
    low = [(x, y, -0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    high = [(x * top_x + shift, y * top_y, 0.5) for x, y, _ in low]
    return _hull(low + high, [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])


@cache
def _round(sides: int, top: float, axis: int) -> np.ndarray:
    """A cylinder (top 1) or a cone (top 0) along an axis (0 x, 1 y, 2 z)."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles)], axis=1)
    low, high = np.c_[ring, np.full(sides, -0.5)], np.c_[ring * max(top, 1e-3), np.full(sides, 0.5)]
    walls = [(i, (i + 1) % sides, sides + (i + 1) % sides, sides + i) for i in range(sides)]
    faces = _hull(np.roll(np.concatenate([low, high]), axis + 1, axis=1), [tuple(range(sides)), tuple(range(sides, 2 * sides)), *walls])
    return faces


@cache
def _ball() -> np.ndarray:
    """A sphere of 20 faces (an icosahedron), 1 m across."""
    g = (1 + 5**0.5) / 2
    points = [p for a in (-1, 1) for b in (-g, g) for p in ((0, a, b), (a, b, 0), (b, 0, a))]
    p = np.array(points, float)
    near = np.linalg.norm(p[:, None] - p[None], axis=2) < 2.1
    n = range(len(p))
    faces = [(i, j, k) for i in n for j in n for k in n if i < j < k and near[i, j] and near[j, k] and near[i, k]]
    return _hull(p / np.linalg.norm(p[0]) / 2, faces)


@cache
def _bush() -> np.ndarray:
    """A rounder, uneven ball of 80 faces: leaves. The same one every time."""
    coarse = _ball()
    middle = (coarse + np.roll(coarse, -1, axis=1)) / 2  # of the sides 01, 12, 20
    corners = [(coarse[:, 0], middle[:, 0], middle[:, 2]), (coarse[:, 1], middle[:, 1], middle[:, 0]),
               (coarse[:, 2], middle[:, 2], middle[:, 1]), (middle[:, 0], middle[:, 1], middle[:, 2])]  # fmt: skip
    fine = np.concatenate([np.stack(corner, axis=1) for corner in corners])
    direction = fine / np.linalg.norm(fine, axis=2, keepdims=True)
    uneven = 1 + 0.14 * np.sin(7 * direction[..., :1] + 5 * direction[..., 1:2]) * np.cos(6 * direction[..., 2:])
    bush: np.ndarray = 0.45 * direction * uneven
    return bush


FORMS: dict[str, Callable[[], np.ndarray]] = {
    "box": lambda: _tapered(1.0, 1.0),
    "hood": lambda: _tapered(0.8, 0.85, -0.1),
    "cab": lambda: _tapered(0.85, 0.85),
    "wheel": lambda: _round(12, 1.0, 1),
    "drum": lambda: _round(10, 1.0, 2),
    "roller": lambda: _round(8, 1.0, 0),
    "stem": lambda: _round(6, 0.75, 2),
    "cone": lambda: _round(6, 0.0, 2),
    "dome": lambda: _round(10, 0.55, 2),
    "ball": _ball,
    "bush": _bush,
}
