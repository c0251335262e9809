"""Bodies and trees are drawn in the manual's sizes, and in the colours by which they are known."""

import json

import numpy as np
import pytest

from orchard.field.kinds import KINDS
from orchard.view.palette import YELLOW
from orchard.view.scenery import MODELS

HATS = {"worker": 0.2}  # m above the height of the kind
FLOAT, BYTE = 5126, 5121  # glTF's numbers of types


def vertices(name: str) -> tuple[np.ndarray, np.ndarray]:
    """The positions, (v, 3) m, and the colours, (v, 3) up to 255, of a model's only mesh."""
    data = (MODELS / f"{name}.glb").read_bytes()
    begin = 20 + int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20:begin])
    (part,) = scene["meshes"][0]["primitives"]

    def values(attribute: str, kind: int, columns: int) -> np.ndarray:
        accessor = scene["accessors"][part["attributes"][attribute]]
        assert accessor["componentType"] == kind
        offset = begin + 8 + scene["bufferViews"][accessor["bufferView"]]["byteOffset"]
        flat = np.frombuffer(data, np.float32 if kind == FLOAT else np.uint8, accessor["count"] * columns, offset)
        return flat.reshape(-1, columns)

    return values("POSITION", FLOAT, 3), values("COLOR_0", BYTE, 4)[:, :3].astype(float)


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_of_a_body_fills_its_size_and_no_more_and_has_its_colour(kind):
    (places, colours), size = vertices(kind), KINDS[kind]
    assert places.min(axis=0) == pytest.approx([-size.length / 2, -size.width / 2, 0.0], abs=1e-4)
    assert places.max(axis=0) == pytest.approx([size.length / 2, size.width / 2, size.height + HATS.get(kind, 0.0)], abs=1e-4)
    assert np.abs(colours - size.colour).max(axis=1).min() < 15, "no face in the sun has it"


def test_a_worker_has_a_yellow_hat():
    places, colours = vertices("worker")
    assert np.abs(colours[places[:, 2] > 1.8] - YELLOW).max() < 50


def test_the_trunk_of_a_tree_is_as_high_as_the_manual_says():
    places, _ = vertices("trunk")
    assert (places[:, 2].min(), places[:, 2].max()) == pytest.approx((0.0, 1.8))
