"""Bodies and trees are drawn in the manual's sizes."""

import numpy as np
import pytest

from orchard.field.kinds import KINDS
from orchard.view.shapes import HATS, TRUNK, body, mesh_of


def bounds(mesh) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array(mesh.vertex_positions.as_arrow_array().to_pylist())
    return corners.min(axis=0), corners.max(axis=0)


@pytest.mark.parametrize("kind", KINDS)
def test_the_drawn_mesh_of_a_body_fills_its_size_and_no_more(kind):
    low, high = bounds(body(kind))
    size = KINDS[kind]
    assert low == pytest.approx([-size.length / 2, -size.width / 2, 0.0], abs=1e-5)
    assert high == pytest.approx([size.length / 2, size.width / 2, size.height + HATS.get(kind, 0.0)], abs=1e-5)


def test_the_trunk_of_a_tree_is_as_high_as_the_manual_says():
    low, high = bounds(mesh_of(TRUNK))
    assert (low[2], high[2]) == pytest.approx((0.0, 1.8))
