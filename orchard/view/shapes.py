"""Shapes: triangle meshes from simple parts, shaded, and the parts of each kind of body."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from orchard.field.kinds import KINDS
from orchard.view.palette import BARK, LEAVES, POST, VINE, Colour

LIGHT = np.array([0.35, -0.5, 0.79])  # direction of the sun, for the shading of the faces


class MeshPart(NamedTuple):
    """One form with a size, an orientation, a position and a colour."""

    form: str  # a key of FORMS
    size: tuple[float, float, float]  # m along x, y, z before it is tilted
    at: tuple[float, float, float]  # m, of its middle
    colour: Colour
    pitch: float = 0.0  # degrees, nose up
    yaw: float = 0.0  # degrees, to the left


@dataclass(frozen=True)
class Mesh:
    """f triangles. Each has three vertices of its own, so that each face is flat."""

    points: np.ndarray  # (3 f, 3) float32
    normals: np.ndarray  # (3 f, 3) float32
    colours: np.ndarray  # (3 f, 3) uint8

    @property
    def triangles(self) -> np.ndarray:
        """The indices of each triangle's vertices, (f, 3) uint32."""
        return np.arange(len(self.points), dtype=np.uint32).reshape(-1, 3)


def mesh_of(parts: Iterable[MeshPart]) -> Mesh:
    """Return all parts as one shaded mesh."""
    pieces = [(_placed(part), part.colour) for part in parts]
    corners = np.concatenate([piece for piece, _ in pieces])
    colours = np.concatenate([np.tile(np.array(colour, float), (len(piece), 1)) for piece, colour in pieces])
    return faceted(corners, colours)


def faceted(corners: np.ndarray, colours: np.ndarray) -> Mesh:
    """Return a mesh of `corners`, (f, 3, 3), and face `colours`, (f, 3). A face is darker the more it is turned away from the sun."""
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
    """Return the corners of a part's triangles in their final position, (f, 3, 3)."""
    placed: np.ndarray = FORMS[part.form]() * np.array(part.size) @ _turn(part.pitch, part.yaw).T + np.array(part.at)
    return placed


def _turn(pitch: float, yaw: float) -> np.ndarray:
    """Return the rotation matrix of a pitch (nose up), then a yaw (to the left); degrees."""
    a, b = np.radians(-pitch), np.radians(yaw)
    tilt = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    swing = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    turn: np.ndarray = swing @ tilt
    return turn


# -- forms: (f, 3, 3) corners of triangles, counter-clockwise seen from outside, within a cube of 1 m around the origin


def _hull(points: np.ndarray | Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> np.ndarray:
    """Return the triangles of flat faces, (f, 3, 3), each oriented away from the middle."""
    p = np.array(points, float)
    fans = np.array([(p[f[0]], p[f[i]], p[f[i + 1]]) for f in faces for i in range(1, len(f) - 1)])
    outward = np.cross(fans[:, 1] - fans[:, 0], fans[:, 2] - fans[:, 0])
    inside_out = np.sum(outward * (fans.mean(axis=1) - p.mean(axis=0)), axis=1) < 0
    fans[inside_out] = fans[inside_out][:, ::-1]
    return fans


@cache
def _tapered(top_x: float, top_y: float, shift: float = 0.0) -> np.ndarray:
    """Return a box with a top that is narrower and moved along x."""
    low = [(x, y, -0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    high = [(x * top_x + shift, y * top_y, 0.5) for x, y, _ in low]
    return _hull(low + high, [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])


@cache
def _round(sides: int, top: float, axis: int) -> np.ndarray:
    """Return a cylinder (`top` 1) or a cone (`top` 0) along an axis (0 x, 1 y, 2 z)."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles)], axis=1)
    low, high = np.c_[ring, np.full(sides, -0.5)], np.c_[ring * max(top, 1e-3), np.full(sides, 0.5)]
    walls = [(i, (i + 1) % sides, sides + (i + 1) % sides, sides + i) for i in range(sides)]
    faces = _hull(np.roll(np.concatenate([low, high]), axis + 1, axis=1), [tuple(range(sides)), tuple(range(sides, 2 * sides)), *walls])
    return faces


@cache
def _ball() -> np.ndarray:
    """Return an icosahedron (20 faces), 1 m across."""
    g = (1 + 5**0.5) / 2
    points = [p for a in (-1, 1) for b in (-g, g) for p in ((0, a, b), (a, b, 0), (b, 0, a))]
    p = np.array(points, float)
    near = np.linalg.norm(p[:, None] - p[None], axis=2) < 2.1
    n = range(len(p))
    faces = [(i, j, k) for i in n for j in n for k in n if i < j < k and near[i, j] and near[j, k] and near[i, k]]
    return _hull(p / np.linalg.norm(p[0]) / 2, faces)


@cache
def _bush() -> np.ndarray:
    """Return a rounder, uneven ball of 80 faces, for leaves. It is the same every time."""
    coarse = _ball()
    middle = (coarse + np.roll(coarse, -1, axis=1)) / 2  # midpoints of the sides 01, 12, 20
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

TYRE, STEEL, GLASS, LENS = (38, 38, 42), (188, 192, 200), (150, 200, 225), (20, 20, 24)
SKIN, HAIR, TROUSERS, YELLOW, STRAW = (224, 172, 130), (84, 58, 40), (52, 66, 104), (255, 214, 0), (238, 226, 190)
WHITE = (245, 245, 245)


def _darker(colour: Colour, by: float) -> Colour:
    r, g, b = (int(c * by) for c in colour)
    return r, g, b


def _wheels(x: float, y: float, across: float, width: float) -> list[MeshPart]:
    """Return four wheels of diameter `across` (m), with their middles at +-x and +-y."""
    size = (across, width, across)
    return [MeshPart("wheel", size, (i * x, j * y, across / 2), TYRE) for i in (-1, 1) for j in (-1, 1)] + [
        MeshPart("wheel", (across / 2, width + 0.02, across / 2), (i * x, j * y, across / 2), STEEL) for i in (-1, 1) for j in (-1, 1)
    ]


def picker(colour: Colour) -> list[MeshPart]:
    """Return a picker, 2.5 x 1.5 x 1.0: a long body with two rows of picking arms that reach up."""
    arms = [MeshPart("stem", (0.1, 0.1, 0.3), (x, y, 0.85), STEEL) for x in (-0.1, 0.3, 0.7) for y in (-0.42, 0.42)]
    hands = [MeshPart("box", (0.3, 0.16, 0.06), (x, y, 0.97), WHITE) for x in (-0.1, 0.3, 0.7) for y in (-0.42, 0.42)]
    return [
        MeshPart("box", (2.5, 1.14, 0.46), (0, 0, 0.47), colour),
        MeshPart("box", (2.1, 1.5, 0.1), (0, 0, 0.68), _darker(colour, 0.8)),
        MeshPart("hood", (0.7, 1.0, 0.22), (0.85, 0, 0.8), colour),
        MeshPart("box", (0.9, 0.9, 0.16), (-0.75, 0, 0.79), _darker(colour, 0.6)),
        MeshPart("drum", (0.24, 0.24, 0.14), (1.1, 0, 0.95), LENS),
        MeshPart("box", (0.04, 0.9, 0.1), (1.25, 0, 0.5), YELLOW),
        *_wheels(0.85, 0.64, 0.56, 0.22), *arms, *hands,
    ]  # fmt: skip


def carrier(colour: Colour) -> list[MeshPart]:
    """Return a carrier, 1.8 x 1.5 x 0.5 m: a flat sled with a fork at its back."""
    fork = [MeshPart("box", (0.5, 0.12, 0.08), (-0.65, y, 0.16), STEEL) for y in (-0.35, 0.35)]
    return [
        MeshPart("box", (1.8, 1.16, 0.24), (0, 0, 0.32), colour),
        MeshPart("box", (1.3, 1.5, 0.06), (0.05, 0, 0.45), _darker(colour, 0.85)),
        MeshPart("box", (0.16, 1.1, 0.02), (0.35, 0, 0.49), WHITE),
        MeshPart("box", (0.16, 1.1, 0.02), (0.05, 0, 0.49), WHITE),
        MeshPart("drum", (0.22, 0.22, 0.1), (0.72, 0, 0.45), LENS),
        MeshPart("box", (0.04, 1.0, 0.08), (0.9, 0, 0.3), YELLOW),
        *_wheels(0.6, 0.64, 0.36, 0.2), *fork,
    ]  # fmt: skip


def bin_(colour: Colour) -> list[MeshPart]:
    """Return a bin, 1 x 1 x 1, open at the top so that its content is visible."""
    rim, inner = _darker(colour, 1.25), _darker(colour, 0.55)
    long_walls = [MeshPart("box", (1.0, 0.07, 0.86), (0, y, 0.55), colour) for y in (-0.465, 0.465)]
    short_walls = [MeshPart("box", (0.07, 0.86, 0.86), (x, 0, 0.55), colour) for x in (-0.465, 0.465)]
    rims = [MeshPart("box", (1.0, 0.09, 0.05), (0, y, 0.975), rim) for y in (-0.455, 0.455)]
    rims += [MeshPart("box", (0.09, 1.0, 0.05), (x, 0, 0.975), rim) for x in (-0.455, 0.455)]
    feet = [MeshPart("box", (1.0, 0.14, 0.12), (0, y, 0.06), _darker(BARK, 0.9)) for y in (-0.4, 0.4)]
    return [MeshPart("box", (0.9, 0.9, 0.06), (0, 0, 0.15), inner), *long_walls, *short_walls, *rims, *feet]


def _person(x: float, y: float, z: float, shirt: Colour, hat: Colour | None, height: float = 1.7) -> list[MeshPart]:
    """Return a person who stands at x, y, z; `height` in m, without the hat."""
    s = height / 1.7
    legs = [MeshPart("box", (0.18 * s, 0.18 * s, 0.8 * s), (x, y + side * 0.13 * s, z + 0.4 * s), TROUSERS) for side in (-1, 1)]
    arms = [MeshPart("stem", (0.14 * s, 0.14 * s, 0.62 * s), (x, y + side * 0.36 * s, z + 1.08 * s), shirt) for side in (-1, 1)]
    hands = [MeshPart("ball", (0.13 * s,) * 3, (x + 0.02, y + side * 0.37 * s, z + 0.76 * s), SKIN) for side in (-1, 1)]
    head = [MeshPart("ball", (0.3 * s, 0.28 * s, 0.34 * s), (x + 0.02, y, z + 1.54 * s), SKIN)]
    body = [MeshPart("cab", (0.3 * s, 0.56 * s, 0.62 * s), (x, y, z + 1.09 * s), shirt)]
    return legs + body + arms + hands + head + (_hat(x, y, z + 1.68 * s, hat) if hat else _hair(x, y, z + 1.6 * s))


def _hat(x: float, y: float, z: float, colour: Colour) -> list[MeshPart]:
    return [MeshPart("drum", (0.54, 0.54, 0.05), (x, y, z), colour), MeshPart("dome", (0.32, 0.32, 0.2), (x, y, z + 0.12), colour)]


def _hair(x: float, y: float, z: float) -> list[MeshPart]:
    return [MeshPart("dome", (0.32, 0.32, 0.18), (x - 0.02, y, z + 0.02), HAIR)]


def worker(colour: Colour) -> list[MeshPart]:
    """Return a worker, 0.55 x 1.0 x 1.7, with a yellow hat up to 1.9 m and a fruit bag in front of the chest."""
    return [*_person(0, 0, 0, colour, YELLOW), MeshPart("box", (0.2, 0.4, 0.34), (0.2, 0, 1.05), STRAW)]


def visitor(colour: Colour) -> list[MeshPart]:
    """Return a visitor, 0.55 x 1.0 x 1.7, with a sun hat (within the 1.7 m) and a red rucksack."""
    return [*_person(0, 0, 0, colour, STRAW, height=1.5), MeshPart("box", (0.2, 0.36, 0.42), (-0.2, 0, 1.0), (214, 70, 60))]


def tractor(colour: Colour) -> list[MeshPart]:
    """Return a tractor, 5 x 3 x 3: hood, cab, big wheels at the back, and two people on its platform."""
    back = [MeshPart("wheel", (1.7, 0.6, 1.7), (-1.0, y, 0.85), TYRE) for y in (-1.2, 1.2)]
    back += [MeshPart("wheel", (0.8, 0.62, 0.8), (-1.0, y, 0.85), YELLOW) for y in (-1.2, 1.2)]
    front = [MeshPart("wheel", (1.1, 0.45, 1.1), (1.6, y, 0.55), TYRE) for y in (-1.1, 1.1)]
    front += [MeshPart("wheel", (0.5, 0.47, 0.5), (1.6, y, 0.55), YELLOW) for y in (-1.1, 1.1)]
    pillars = [MeshPart("box", (0.09, 0.09, 1.2), (x, y, 2.25), LENS) for x in (-0.85, 0.4) for y in (-0.7, 0.7)]
    rails = [MeshPart("box", (0.08, 0.08, 0.5), (-2.4, y, 1.25), STEEL) for y in (-1.2, 0.0, 1.2)]
    return [
        MeshPart("hood", (2.1, 1.2, 1.0), (1.4, 0, 1.25), colour), MeshPart("box", (2.4, 0.7, 0.5), (1.0, 0, 0.75), LENS),
        MeshPart("box", (0.1, 1.0, 0.6), (2.45, 0, 1.1), STEEL), MeshPart("drum", (0.14, 0.14, 0.9), (1.6, 0.4, 2.0), LENS),
        MeshPart("box", (1.5, 1.6, 0.9), (-0.2, 0, 1.25), colour), MeshPart("box", (0.04, 1.3, 0.9), (0.42, 0, 2.2), GLASS),
        MeshPart("box", (1.7, 1.8, 0.14), (-0.22, 0, 2.93), _darker(colour, 0.8)),
        MeshPart("box", (1.7, 2.6, 0.14), (-1.65, 0, 1.0), _darker(BARK, 1.2)), MeshPart("box", (0.08, 2.5, 0.08), (-2.4, 0, 1.5), STEEL),
        *_person(-0.3, 0, 1.2, (60, 80, 150), YELLOW, height=1.35),
        *_person(-1.5, 0.7, 1.07, KINDS["worker"].colour, YELLOW), *_person(-1.6, -0.7, 1.07, (200, 120, 60), STRAW),
        *back, *front, *pillars, *rails,
    ]  # fmt: skip


def _quadruped(colour: Colour, fat: float, leg: float) -> list[MeshPart]:
    """Return the body, legs and head of a four-legged animal, 1 m long. `fat`: its width, `leg`: the length of its legs, m."""
    dark = _darker(colour, 0.75)
    legs = [MeshPart("stem", (0.12, 0.12, leg), (x, y * fat, leg / 2), dark) for x in (-0.26, 0.2) for y in (-0.34, 0.34)]
    return [
        MeshPart("box", (0.66, fat, 0.26), (-0.04, 0, leg + 0.1), colour),
        MeshPart("ball", (0.32, 0.32, 0.3), (0.32, 0, leg + 0.26), colour),
        *legs,
    ]


def dog(colour: Colour) -> list[MeshPart]:
    """Return a dog, 1.0 x 0.8 x 0.7: a snout, hanging ears, a tail that points up, a red collar."""
    ears = [MeshPart("box", (0.1, 0.05, 0.2), (0.3, y, 0.56), _darker(colour, 0.5)) for y in (-0.17, 0.17)]
    return [
        *_quadruped(colour, 0.36, 0.3), *ears, MeshPart("box", (0.24, 0.16, 0.13), (0.46, 0, 0.5), _darker(colour, 1.25)),
        MeshPart("ball", (0.07, 0.07, 0.07), (0.57, 0, 0.54), LENS), MeshPart("drum", (0.26, 0.26, 0.06), (0.22, 0, 0.48), (210, 30, 40)),
        MeshPart("roller", (0.34, 0.08, 0.08), (-0.42, 0, 0.56), colour, pitch=-50),
    ]  # fmt: skip


def cat(colour: Colour) -> list[MeshPart]:
    """Return a cat, 1.0 x 0.8 x 0.7: pointed ears, stripes, a long tail straight up."""
    ears = [MeshPart("cone", (0.12, 0.1, 0.16), (0.32, y, 0.63), colour) for y in (-0.1, 0.1)]
    stripes = [MeshPart("box", (0.06, 0.3, 0.28), (x, 0, 0.33), _darker(colour, 0.6)) for x in (-0.24, -0.08, 0.08)]
    return [
        *_quadruped(colour, 0.28, 0.22), *ears, *stripes, MeshPart("ball", (0.14, 0.16, 0.12), (0.44, 0, 0.44), WHITE),
        MeshPart("stem", (0.08, 0.08, 0.42), (-0.38, 0, 0.49), colour), MeshPart("ball", (0.1, 0.1, 0.1), (-0.38, 0, 0.66), WHITE),
    ]  # fmt: skip


def weed(colour: Colour) -> list[MeshPart]:
    """Return a weed, 0.5 x 0.5 x 0.5: a tuft of blades with a yellow flower."""
    blades = [MeshPart("cone", (0.14, 0.05, 0.46), (0, 0, 0.2), colour, pitch=30, yaw=60 * i) for i in range(6)]
    return [*blades, MeshPart("stem", (0.05, 0.05, 0.42), (0, 0, 0.21), colour), MeshPart("ball", (0.16, 0.16, 0.12), (0, 0, 0.44), YELLOW)]


BODIES: dict[str, Callable[[Colour], list[MeshPart]]] = {
    "picker": picker, "carrier": carrier, "bin": bin_, "tractor": tractor,
    "worker": worker, "visitor": visitor, "dog": dog, "cat": cat, "weed": weed,
}  # fmt: skip


def body(kind: str) -> list[MeshPart]:
    """Return the parts of a body of a kind. The origin is on the ground below its centre."""
    return BODIES[kind](KINDS[kind].colour)


TRUNK = [MeshPart("stem", (0.5, 0.5, 1.0), (0, 0, 0.5), BARK), MeshPart("stem", (0.38, 0.38, 1.1), (0, 0, 1.4), BARK)]
LINE_POST = [MeshPart("box", (0.5, 0.5, 0.3), (0, 0, 0.15), _darker(POST, 0.8)), MeshPart("box", (0.22, 0.22, 2.5), (0, 0, 1.55), POST)]
FLAG = [
    MeshPart("stem", (0.05, 0.05, 1.0), (0, 0, 1.4), WHITE),
    MeshPart("box", (0.5, 0.03, 0.34), (-0.25, 0, 1.72), YELLOW),
]  # of a full bin
CROWN = [  # 5.5 x 1.0 m, from 1.8 m up
    MeshPart("bush", (2.6, 1.1, 1.0), (0.0, 0.0, 2.4), LEAVES[0]),
    MeshPart("bush", (2.4, 1.0, 0.8), (-1.55, 0.05, 2.25), LEAVES[1]),
    MeshPart("bush", (2.4, 1.0, 0.8), (1.55, -0.05, 2.25), LEAVES[2]),
    MeshPart("bush", (1.2, 0.8, 0.6), (0.6, 0.0, 2.75), LEAVES[3]),
]


def vine_patch(width: float) -> list[MeshPart]:
    """Return the pergola's patch above a lane: 1.7 m along it, `width` m across, 0.5 m thick, at z = 2.3 m."""
    count = max(3, round(width / 1.1))
    step = width / count
    return [
        MeshPart("bush", (1.7 + 0.25 * (i % 2), step * 1.35, 0.5), (0.06 * (-1) ** i, (i + 0.5) * step - width / 2, 2.3 + 0.05 * (i % 2)),
             VINE[i % len(VINE)])
        for i in range(count)
    ]  # fmt: skip
