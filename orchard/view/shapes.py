"""What each kind of body looks like, as tables of parts. Within the manual's sizes; colours of the main parts are the kind's own."""

from collections.abc import Callable

from orchard.field.kinds import KINDS
from orchard.view.mesh import MeshPart
from orchard.view.palette import BARK, LEAVES, POST, VINE, Colour

TYRE, STEEL, GLASS, LENS = (38, 38, 42), (188, 192, 200), (150, 200, 225), (20, 20, 24)
SKIN, HAIR, TROUSERS, YELLOW, STRAW = (224, 172, 130), (84, 58, 40), (52, 66, 104), (255, 214, 0), (238, 226, 190)
WHITE = (245, 245, 245)


def _darker(colour: Colour, by: float) -> Colour:
    r, g, b = (int(c * by) for c in colour)
    return r, g, b


def _wheels(x: float, y: float, across: float, width: float) -> list[MeshPart]:
    """Four wheels, `across` m high, their middles at +-x and +-y."""
    size = (across, width, across)
    return [MeshPart("wheel", size, (i * x, j * y, across / 2), TYRE) for i in (-1, 1) for j in (-1, 1)] + [
        MeshPart("wheel", (across / 2, width + 0.02, across / 2), (i * x, j * y, across / 2), STEEL) for i in (-1, 1) for j in (-1, 1)
    ]


def picker(colour: Colour) -> list[MeshPart]:
    """2.5 x 1.5 x 1.0: a long body with a row of picking arms that reach up."""
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
    """1.8 x 1.5 x 0.5: a flat sled with a fork at its back."""
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
    """1 x 1 x 1, open above: one sees what is in it."""
    rim, inner = _darker(colour, 1.25), _darker(colour, 0.55)
    long_walls = [MeshPart("box", (1.0, 0.07, 0.86), (0, y, 0.55), colour) for y in (-0.465, 0.465)]
    short_walls = [MeshPart("box", (0.07, 0.86, 0.86), (x, 0, 0.55), colour) for x in (-0.465, 0.465)]
    rims = [MeshPart("box", (1.0, 0.09, 0.05), (0, y, 0.975), rim) for y in (-0.455, 0.455)]
    rims += [MeshPart("box", (0.09, 1.0, 0.05), (x, 0, 0.975), rim) for x in (-0.455, 0.455)]
    feet = [MeshPart("box", (1.0, 0.14, 0.12), (0, y, 0.06), _darker(BARK, 0.9)) for y in (-0.4, 0.4)]
    return [MeshPart("box", (0.9, 0.9, 0.06), (0, 0, 0.15), inner), *long_walls, *short_walls, *rims, *feet]


def _someone(x: float, y: float, z: float, shirt: Colour, hat: Colour | None, height: float = 1.7) -> list[MeshPart]:
    """A person `height` m tall without the hat, standing at x, y, z."""
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
    """0.55 x 1.0 x 1.7, the yellow hat up to 1.9, a fruit bag before the chest."""
    return [*_someone(0, 0, 0, colour, YELLOW), MeshPart("box", (0.2, 0.4, 0.34), (0.2, 0, 1.05), STRAW)]


def visitor(colour: Colour) -> list[MeshPart]:
    """0.55 x 1.0 x 1.7, a sun hat (within the 1.7), a red rucksack."""
    return [*_someone(0, 0, 0, colour, STRAW, height=1.5), MeshPart("box", (0.2, 0.36, 0.42), (-0.2, 0, 1.0), (214, 70, 60))]


def tractor(colour: Colour) -> list[MeshPart]:
    """5 x 3 x 3: hood, cab, big wheels at the back, and two people on its platform."""
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
        *_someone(-0.3, 0, 1.2, (60, 80, 150), YELLOW, height=1.35),
        *_someone(-1.5, 0.7, 1.07, KINDS["worker"].colour, YELLOW), *_someone(-1.6, -0.7, 1.07, (200, 120, 60), STRAW),
        *back, *front, *pillars, *rails,
    ]  # fmt: skip


def _beast(colour: Colour, fat: float, leg: float) -> list[MeshPart]:
    """Body, legs and head of a four-legged animal 1 m long; `fat` is its width, `leg` its legs' length, m."""
    dark = _darker(colour, 0.75)
    legs = [MeshPart("stem", (0.12, 0.12, leg), (x, y * fat, leg / 2), dark) for x in (-0.26, 0.2) for y in (-0.34, 0.34)]
    return [
        MeshPart("box", (0.66, fat, 0.26), (-0.04, 0, leg + 0.1), colour),
        MeshPart("ball", (0.32, 0.32, 0.3), (0.32, 0, leg + 0.26), colour),
        *legs,
    ]


def dog(colour: Colour) -> list[MeshPart]:
    """1.0 x 0.8 x 0.7: a snout, hanging ears, a tail that points up, a red collar."""
    ears = [MeshPart("box", (0.1, 0.05, 0.2), (0.3, y, 0.56), _darker(colour, 0.5)) for y in (-0.17, 0.17)]
    return [
        *_beast(colour, 0.36, 0.3), *ears, MeshPart("box", (0.24, 0.16, 0.13), (0.46, 0, 0.5), _darker(colour, 1.25)),
        MeshPart("ball", (0.07, 0.07, 0.07), (0.57, 0, 0.54), LENS), MeshPart("drum", (0.26, 0.26, 0.06), (0.22, 0, 0.48), (210, 30, 40)),
        MeshPart("roller", (0.34, 0.08, 0.08), (-0.42, 0, 0.56), colour, pitch=-50),
    ]  # fmt: skip


def cat(colour: Colour) -> list[MeshPart]:
    """1.0 x 0.8 x 0.7: pointed ears, stripes, a long tail straight up."""
    ears = [MeshPart("cone", (0.12, 0.1, 0.16), (0.32, y, 0.63), colour) for y in (-0.1, 0.1)]
    stripes = [MeshPart("box", (0.06, 0.3, 0.28), (x, 0, 0.33), _darker(colour, 0.6)) for x in (-0.24, -0.08, 0.08)]
    return [
        *_beast(colour, 0.28, 0.22), *ears, *stripes, MeshPart("ball", (0.14, 0.16, 0.12), (0.44, 0, 0.44), WHITE),
        MeshPart("stem", (0.08, 0.08, 0.42), (-0.38, 0, 0.49), colour), MeshPart("ball", (0.1, 0.1, 0.1), (-0.38, 0, 0.66), WHITE),
    ]  # fmt: skip


def weed(colour: Colour) -> list[MeshPart]:
    """0.5 x 0.5 x 0.5: a tuft of blades with a yellow flower."""
    blades = [MeshPart("cone", (0.14, 0.05, 0.46), (0, 0, 0.2), colour, pitch=30, yaw=60 * i) for i in range(6)]
    return [*blades, MeshPart("stem", (0.05, 0.05, 0.42), (0, 0, 0.21), colour), MeshPart("ball", (0.16, 0.16, 0.12), (0, 0, 0.44), YELLOW)]


BODIES: dict[str, Callable[[Colour], list[MeshPart]]] = {
    "picker": picker, "carrier": carrier, "bin": bin_, "tractor": tractor,
    "worker": worker, "visitor": visitor, "dog": dog, "cat": cat, "weed": weed,
}  # fmt: skip


def body(kind: str) -> list[MeshPart]:
    """The parts of a body of a kind; its origin lies on the ground below its centre."""
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
    """The pergola's patch above a lane: 1.7 m along it, `width` m across, 0.5 m thick at z = 2.3."""
    count = max(3, round(width / 1.1))
    step = width / count
    return [
        MeshPart("bush", (1.7 + 0.25 * (i % 2), step * 1.35, 0.5), (0.06 * (-1) ** i, (i + 0.5) * step - width / 2, 2.3 + 0.05 * (i % 2)),
             VINE[i % len(VINE)])
        for i in range(count)
    ]  # fmt: skip
