"""Zones in front of a laser: that they compare in float32 changes no result.

A zone is a rectangle in the frame of the laser, m. A return, the end of a beam, is in it or not.
"""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from orchard.contract.zone import Zone, beams, in_zone, spans
from orchard.field.kinds import AROUND, KINDS

# Beyond the range of a laser, so some zones are out of its sight.
METRES = st.floats(-12.0, 12.0)


@st.composite
def zones(draw) -> Zone:
    (west, east), (south, north) = (sorted((draw(METRES), draw(METRES))) for _ in range(2))
    return Zone(west, east, south, north)


def exact(laser, zone: Zone) -> tuple[np.ndarray, np.ndarray]:
    """Return between which ranges each beam is in a zone: from, to, each (beams,) float64, m.

    Along each axis a beam is between two sides of the zone from one range to another. A beam that
    is across the axis is there always or never.
    """
    enter = np.zeros(laser.beams)
    leave = np.full(laser.beams, np.inf)
    for direction, least, most in zip(
        beams(laser), (zone.x_min, zone.y_min), (zone.x_max, zone.y_max), strict=True
    ):
        for k, slope in enumerate(direction.tolist()):
            # Smaller cosines and sines are those of beams across the axis: rounded, not exactly 0.
            if abs(slope) >= 1e-12:
                first, last = sorted((least / slope, most / slope))
            elif least <= 0.0 <= most:
                first = -np.inf
                last = np.inf
            else:
                first = last = -np.inf
            enter[k] = max(enter[k], first)
            leave[k] = min(leave[k], last)
    return enter, leave


@given(st.sampled_from([AROUND, KINDS["picker"].laser]), zones(), st.data())
def test_a_return_is_in_a_zone_as_if_it_were_compared_exactly(laser, zone, data):
    """The ranges are those at which a beam enters or leaves a zone, and their neighbours."""
    enter, leave = exact(laser, zone)
    drawn = data.draw(arrays(np.float32, laser.beams, elements=st.floats(0.0, 11.0, width=32)))
    for edge in (enter, leave):
        with np.errstate(over="ignore"):
            near = edge.astype(np.float32)
        for scan in (
            drawn,
            near,
            np.nextafter(near, np.float32(np.inf)),
            np.nextafter(near, np.float32(-np.inf)),
        ):
            assert np.array_equal(in_zone(scan, laser, zone), (scan >= enter) & (scan < leave))
    assert spans(laser, zone).dtype == np.float32
