"""Shapes: triangle meshes from simple parts, shaded, and the parts of each kind of body."""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import rerun as rr

from orchard.field.kinds import KINDS
from orchard.view.palette import BARK, LEAVES, POST, VINE, YELLOW, Colour

LIGHT = np.array([0.35, -0.5, 0.79])  # direction of the sun, for the shading of the faces
Coordinate = float | Sequence[float] | np.ndarray  # of the middle of a form, m; several numbers: a copy of the form at each


class MeshPart(NamedTuple):
    """A form with a size, an orientation, a position and a colour; or several copies of it in a grid."""

    form: str  # a key of FORMS
    size: tuple[float, float, float]  # m along x, y, z before it is tilted
    at: tuple[Coordinate, Coordinate, Coordinate]
    colour: Colour | float  # a number: the brightness of the body's own colour
    pitch: float = 0.0  # degrees, nose up
    yaw: float = 0.0  # degrees, to the left


def mesh_of(
    parts: Iterable[MeshPart], own: Colour = (0, 0, 0), alpha: int | None = None, box: tuple[float, float, float] | None = None
) -> rr.Mesh3D:
    """Return all parts as one mesh of flat faces, darker on the side away from the sun.

    `own`: the body's colour, `alpha`: 255 opaque. `box`: m along x, y, z, on the ground, which the mesh is stretched to fill.
    """
    pieces = [(_placed(part), part.colour if isinstance(part.colour, tuple) else _darker(own, part.colour)) for part in parts]
    corners = np.concatenate([piece for piece, _ in pieces])
    colours = np.concatenate([np.tile(np.array(colour, float), (len(piece), 1)) for piece, colour in pieces])
    corners = corners if box is None else _filling(corners, np.array(box))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    shade = 0.90 + 0.10 * np.clip(normals @ LIGHT, -0.8, 1.0)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3).astype(np.float32),
        triangle_indices=np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        vertex_colors=np.repeat(np.clip(colours * shade[:, None], 0, 255).astype(np.uint8), 3, axis=0),
        albedo_factor=None if alpha is None else (255, 255, 255, alpha),
    )


def _filling(corners: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return corners, (f, 3, 3), stretched and moved to a box around the origin, on the ground."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return np.asarray((corners - low) * (box / (high - low)) - box * (0.5, 0.5, 0.0))


def _placed(part: MeshPart) -> np.ndarray:
    """Return the corners of a part's triangles in their final position, (f, 3, 3)."""
    form = FORMS[part.form] * np.array(part.size) @ _turn(part.pitch, part.yaw).T
    middles = np.array(list(product(*map(np.ravel, part.at))))
    return np.concatenate([form + middle for middle in middles])


def _turn(pitch: float, yaw: float) -> np.ndarray:
    """Return the rotation matrix of a pitch (nose up), then a yaw (to the left); degrees."""
    a, b = np.radians(-pitch), np.radians(yaw)
    tilt = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    swing = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    return np.asarray(swing @ tilt)


def _darker(colour: Colour, by: float) -> Colour:
    r, g, b = (int(c * by) for c in colour)
    return r, g, b


# -- forms: (f, 3, 3) corners of triangles, counter-clockwise seen from outside, within a cube of 1 m around the origin


def _hull(points: np.ndarray | Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> np.ndarray:
    """Return the triangles of flat faces, (f, 3, 3), each oriented away from the middle."""
    p = np.array(points, float)
    fans = np.array([(p[f[0]], p[f[i]], p[f[i + 1]]) for f in faces for i in range(1, len(f) - 1)])
    outward = np.cross(fans[:, 1] - fans[:, 0], fans[:, 2] - fans[:, 0])
    inside_out = np.sum(outward * (fans.mean(axis=1) - p.mean(axis=0)), axis=1) < 0
    fans[inside_out] = fans[inside_out][:, ::-1]
    return fans


def _tapered(top_x: float, top_y: float, shift: float = 0.0) -> np.ndarray:
    """Return a box with a top that is narrower and moved along x."""
    low = [(x, y, -0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    high = [(x * top_x + shift, y * top_y, 0.5) for x, y, _ in low]
    return _hull(low + high, [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])


def _round(sides: int, top: float, axis: int) -> np.ndarray:
    """Return a cylinder (`top` 1) or a cone (`top` 0) along an axis (0 x, 1 y, 2 z)."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles)], axis=1)
    low, high = np.c_[ring, np.full(sides, -0.5)], np.c_[ring * max(top, 1e-3), np.full(sides, 0.5)]
    walls = [(i, (i + 1) % sides, sides + (i + 1) % sides, sides + i) for i in range(sides)]
    return _hull(np.roll(np.concatenate([low, high]), axis + 1, axis=1), [tuple(range(sides)), tuple(range(sides, 2 * sides)), *walls])


def _ball() -> np.ndarray:
    """Return an icosahedron (20 faces), 1 m across."""
    g = (1 + 5**0.5) / 2
    p = np.array([p for a in (-1, 1) for b in (-g, g) for p in ((0, a, b), (a, b, 0), (b, 0, a))], float)
    near = np.linalg.norm(p[:, None] - p[None], axis=2) < 2.1
    faces = [(i, j, k) for i, j, k in combinations(range(len(p)), 3) if near[i, j] and near[j, k] and near[i, k]]
    return _hull(p / np.linalg.norm(p[0]) / 2, faces)


def _bush() -> np.ndarray:
    """Return a rounder, uneven ball of 80 faces, for leaves. It is the same every time."""
    a, b, c = _ball().swapaxes(0, 1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    fine = np.concatenate([np.stack(corners, axis=1) for corners in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    direction = fine / np.linalg.norm(fine, axis=2, keepdims=True)
    uneven = 1 + 0.14 * np.sin(7 * direction[..., :1] + 5 * direction[..., 1:2]) * np.cos(6 * direction[..., 2:])
    return np.asarray(0.45 * direction * uneven)


FORMS = {
    "box": _tapered(1.0, 1.0),
    "hood": _tapered(0.8, 0.85, -0.1),
    "cab": _tapered(0.85, 0.85),
    "wheel": _round(12, 1.0, 1),
    "drum": _round(10, 1.0, 2),
    "roller": _round(8, 1.0, 0),
    "stem": _round(6, 0.75, 2),
    "cone": _round(6, 0.0, 2),
    "dome": _round(10, 0.55, 2),
    "ball": _ball(),
    "bush": _bush(),
}

TYRE, STEEL, GLASS, LENS = (38, 38, 42), (188, 192, 200), (150, 200, 225), (20, 20, 24)
SKIN, TROUSERS, STRAW = (224, 172, 130), (52, 66, 104), (238, 226, 190)
WHITE = (245, 245, 245)


def _person(x: float, y: float, z: float, shirt: Colour | float, hat: Colour, height: float = 1.7) -> list[MeshPart]:
    """Return a person standing at x, y, z; `height` in m, without the hat."""
    s = height / 1.7
    legs, arms, hands = ((y - aside * s, y + aside * s) for aside in (0.13, 0.36, 0.37))
    return [
        MeshPart("box", (0.18 * s, 0.18 * s, 0.8 * s), (x, legs, z + 0.4 * s), TROUSERS),
        MeshPart("cab", (0.3 * s, 0.56 * s, 0.62 * s), (x, y, z + 1.09 * s), shirt),
        MeshPart("stem", (0.14 * s, 0.14 * s, 0.62 * s), (x, arms, z + 1.08 * s), shirt),
        MeshPart("ball", (0.13 * s,) * 3, (x + 0.02, hands, z + 0.76 * s), SKIN),
        MeshPart("ball", (0.3 * s, 0.28 * s, 0.34 * s), (x + 0.02, y, z + 1.54 * s), SKIN),
        MeshPart("drum", (0.54, 0.54, 0.05), (x, y, z + 1.68 * s), hat),
        MeshPart("dome", (0.32, 0.32, 0.2), (x, y, z + 1.68 * s + 0.12), hat),
    ]


def _quadruped(fat: float, leg: float) -> list[MeshPart]:
    """Return the body, legs and head of a four-legged animal, 1 m long. `fat`: its width, `leg`: the length of its legs, m."""
    return [
        MeshPart("box", (0.66, fat, 0.26), (-0.04, 0, leg + 0.1), 1.0),
        MeshPart("ball", (0.32, 0.32, 0.3), (0.32, 0, leg + 0.26), 1.0),
        MeshPart("stem", (0.12, 0.12, leg), ((-0.26, 0.2), (-0.34 * fat, 0.34 * fat), leg / 2), 0.75),
    ]


BODIES = {  # the origin is on the ground below the body's centre
    "picker": [  # 2.5 x 1.5 x 1.0 m: a long body with two rows of picking arms that reach up
        MeshPart("box", (2.5, 1.14, 0.46), (0, 0, 0.47), 1.0),
        MeshPart("box", (2.1, 1.5, 0.1), (0, 0, 0.68), 0.8),
        MeshPart("hood", (0.7, 1.0, 0.22), (0.85, 0, 0.8), 1.0),
        MeshPart("box", (0.9, 0.9, 0.16), (-0.75, 0, 0.79), 0.6),
        MeshPart("drum", (0.24, 0.24, 0.14), (1.1, 0, 0.95), LENS),
        MeshPart("box", (0.04, 0.9, 0.1), (1.25, 0, 0.5), YELLOW),
        MeshPart("wheel", (0.56, 0.22, 0.56), ((-0.85, 0.85), (-0.64, 0.64), 0.28), TYRE),
        MeshPart("wheel", (0.28, 0.24, 0.28), ((-0.85, 0.85), (-0.64, 0.64), 0.28), STEEL),
        MeshPart("stem", (0.1, 0.1, 0.3), ((-0.1, 0.3, 0.7), (-0.42, 0.42), 0.85), STEEL),
        MeshPart("box", (0.3, 0.16, 0.06), ((-0.1, 0.3, 0.7), (-0.42, 0.42), 0.97), WHITE),
    ],
    "carrier": [  # 1.8 x 1.5 x 0.5 m: a flat sled with a fork at its back
        MeshPart("box", (1.8, 1.16, 0.24), (0, 0, 0.32), 1.0),
        MeshPart("box", (1.3, 1.5, 0.06), (0.05, 0, 0.45), 0.85),
        MeshPart("box", (0.16, 1.1, 0.02), ((0.05, 0.35), 0, 0.49), WHITE),
        MeshPart("drum", (0.22, 0.22, 0.1), (0.72, 0, 0.45), LENS),
        MeshPart("box", (0.04, 1.0, 0.08), (0.9, 0, 0.3), YELLOW),
        MeshPart("wheel", (0.36, 0.2, 0.36), ((-0.6, 0.6), (-0.64, 0.64), 0.18), TYRE),
        MeshPart("wheel", (0.18, 0.22, 0.18), ((-0.6, 0.6), (-0.64, 0.64), 0.18), STEEL),
        MeshPart("box", (0.5, 0.12, 0.08), (-0.65, (-0.35, 0.35), 0.16), STEEL),
    ],
    "bin": [  # 1 x 1 x 1 m, open at the top so that its content is visible: floor, walls, rims, feet
        MeshPart("box", (0.9, 0.9, 0.06), (0, 0, 0.15), 0.55),
        MeshPart("box", (1.0, 0.07, 0.86), (0, (-0.465, 0.465), 0.55), 1.0),
        MeshPart("box", (0.07, 0.86, 0.86), ((-0.465, 0.465), 0, 0.55), 1.0),
        MeshPart("box", (1.0, 0.09, 0.05), (0, (-0.455, 0.455), 0.975), 1.25),
        MeshPart("box", (0.09, 1.0, 0.05), ((-0.455, 0.455), 0, 0.975), 1.25),
        MeshPart("box", (1.0, 0.14, 0.12), (0, (-0.4, 0.4), 0.06), _darker(BARK, 0.9)),
    ],
    "tractor": [  # 5 x 3 x 3 m: hood, cab, big wheels at the back, and people in its cab and on its platform
        MeshPart("hood", (2.1, 1.2, 1.0), (1.4, 0, 1.25), 1.0),
        MeshPart("box", (2.4, 0.7, 0.5), (1.0, 0, 0.75), LENS),
        MeshPart("box", (0.1, 1.0, 0.6), (2.45, 0, 1.1), STEEL),
        MeshPart("drum", (0.14, 0.14, 0.9), (1.6, 0.4, 2.0), LENS),
        MeshPart("box", (1.5, 1.6, 0.9), (-0.2, 0, 1.25), 1.0),
        MeshPart("box", (0.04, 1.3, 0.9), (0.42, 0, 2.2), GLASS),
        MeshPart("box", (1.7, 1.8, 0.14), (-0.22, 0, 2.93), 0.8),
        MeshPart("box", (1.7, 2.6, 0.14), (-1.65, 0, 1.0), _darker(BARK, 1.2)),
        MeshPart("box", (0.08, 2.5, 0.08), (-2.4, 0, 1.5), STEEL),
        *_person(-0.3, 0, 1.2, (60, 80, 150), YELLOW, height=1.35),
        *_person(-1.5, 0.7, 1.07, KINDS["worker"].colour, YELLOW),
        *_person(-1.6, -0.7, 1.07, (200, 120, 60), STRAW),
        MeshPart("wheel", (1.7, 0.6, 1.7), (-1.0, (-1.2, 1.2), 0.85), TYRE),
        MeshPart("wheel", (0.8, 0.62, 0.8), (-1.0, (-1.2, 1.2), 0.85), YELLOW),
        MeshPart("wheel", (1.1, 0.45, 1.1), (1.6, (-1.1, 1.1), 0.55), TYRE),
        MeshPart("wheel", (0.5, 0.47, 0.5), (1.6, (-1.1, 1.1), 0.55), YELLOW),
        MeshPart("box", (0.09, 0.09, 1.2), ((-0.85, 0.4), (-0.7, 0.7), 2.25), LENS),
        MeshPart("box", (0.08, 0.08, 0.5), (-2.4, (-1.2, 0.0, 1.2), 1.25), STEEL),
    ],
    # 0.55 x 1.0 x 1.7 m, with a yellow hat up to 1.9 m and a fruit bag in front of the chest
    "worker": [*_person(0, 0, 0, 1.0, YELLOW), MeshPart("box", (0.2, 0.4, 0.34), (0.2, 0, 1.05), STRAW)],
    # 0.55 x 1.0 x 1.7 m, with a sun hat (within the 1.7 m) and a red rucksack
    "visitor": [*_person(0, 0, 0, 1.0, STRAW, height=1.5), MeshPart("box", (0.2, 0.36, 0.42), (-0.2, 0, 1.0), (214, 70, 60))],
    "dog": [  # 1.0 x 0.8 x 0.7 m: hanging ears, a snout, a red collar, a tail that points up
        *_quadruped(0.36, 0.3),
        MeshPart("box", (0.1, 0.05, 0.2), (0.3, (-0.17, 0.17), 0.56), 0.5),
        MeshPart("box", (0.24, 0.16, 0.13), (0.46, 0, 0.5), 1.25),
        MeshPart("ball", (0.07, 0.07, 0.07), (0.57, 0, 0.54), LENS),
        MeshPart("drum", (0.26, 0.26, 0.06), (0.22, 0, 0.48), (210, 30, 40)),
        MeshPart("roller", (0.34, 0.08, 0.08), (-0.42, 0, 0.56), 1.0, pitch=-50),
    ],
    "cat": [  # 1.0 x 0.8 x 0.7 m: pointed ears, stripes, a long tail straight up
        *_quadruped(0.28, 0.22),
        MeshPart("cone", (0.12, 0.1, 0.16), (0.32, (-0.1, 0.1), 0.63), 1.0),
        MeshPart("box", (0.06, 0.3, 0.28), ((-0.24, -0.08, 0.08), 0, 0.33), 0.6),
        MeshPart("ball", (0.14, 0.16, 0.12), (0.44, 0, 0.44), WHITE),
        MeshPart("stem", (0.08, 0.08, 0.42), (-0.38, 0, 0.49), 1.0),
        MeshPart("ball", (0.1, 0.1, 0.1), (-0.38, 0, 0.66), WHITE),
    ],
    "weed": [  # 0.5 x 0.5 x 0.5 m: a tuft of blades with a yellow flower
        *(MeshPart("cone", (0.14, 0.05, 0.46), (0, 0, 0.2), 1.0, pitch=30, yaw=60 * i) for i in range(6)),
        MeshPart("stem", (0.05, 0.05, 0.42), (0, 0, 0.21), 1.0),
        MeshPart("ball", (0.16, 0.16, 0.12), (0, 0, 0.44), YELLOW),
    ],
}


HATS = {"worker": 0.2}  # m above the height of the kind


def body(kind: str) -> rr.Mesh3D:
    """Return the mesh of a body of a kind. It fills the kind's length, width and height."""
    size = KINDS[kind]
    return mesh_of(BODIES[kind], size.colour, box=(size.length, size.width, size.height + HATS.get(kind, 0.0)))


TRUNK = [MeshPart("stem", (0.5, 0.5, 1.0), (0, 0, 0.5), BARK), MeshPart("stem", (0.38, 0.38, 0.95), (0, 0, 1.325), BARK)]
LINE_POST = [MeshPart("box", (0.5, 0.5, 0.3), (0, 0, 0.15), _darker(POST, 0.8)), MeshPart("box", (0.22, 0.22, 2.5), (0, 0, 1.55), POST)]
# of a full bin
FLAG = [MeshPart("stem", (0.05, 0.05, 1.0), (0, 0, 1.4), WHITE), MeshPart("box", (0.5, 0.03, 0.34), (-0.25, 0, 1.72), YELLOW)]
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
