"""Rows that are picked before one's eyes: fruit under the pergola that goes, and a strip of ground that turns pale."""

from itertools import pairwise

import numpy as np
import rerun as rr

from orchard.field.layout import ROW_EAST, ROW_LENGTH, ROW_WEST, Layout
from orchard.view import palette
from orchard.view.scenery import ROW_Z

CHUNKS = 35  # a row's pieces of 2 m, each picked or not
FRUIT_IN_A_CHUNK = 8
FRUIT_Z = 1.95  # m: it hangs just below the pergola


class RowView:
    """One strip of ground and one cloud of fruit a row; `show` logs those of which another piece has been picked."""

    def __init__(self, rec: rr.RecordingStream, layout: Layout) -> None:
        self.rec, self.layout = rec, layout
        self._done = [-1] * len(layout.lanes)
        self._from_west: dict[int, bool] = {}
        self._fruit = [_fruit(lane.y, layout.scenario.row_width, lane.number) for lane in layout.lanes]
        self._pickers = [i for i, start in enumerate(layout.starts) if start.kind == "picker"]
        for lane in layout.lanes:
            points, triangles = _strip(lane.y, layout.scenario.row_width)
            strip = rr.Mesh3D.from_fields(vertex_positions=points, triangle_indices=triangles)
            rec.log(f"world/rows/row_{lane.number:02d}", strip, static=True)
            look = rr.Points3D.from_fields(radii=[0.085], colors=[palette.KIWI])
            rec.log(f"canopy/fruit/row_{lane.number:02d}", look, static=True)

    def show(self, picked: np.ndarray, poses: np.ndarray) -> None:
        """`picked`: metres of each row; `poses` tell from which end a row is picked that has just been begun."""
        for row, metres in enumerate(picked):
            done = int(CHUNKS * min(metres, ROW_LENGTH) / ROW_LENGTH + 1e-9)
            if metres > 0.0 and row not in self._from_west:
                self._from_west[row] = self._begun_in_the_west(row, float(metres), poses)
            if done != self._done[row]:
                self._done[row] = done
                self._paint(row, done, self._from_west.get(row, True))

    def _begun_in_the_west(self, row: int, metres: float, poses: np.ndarray) -> bool:
        """Whether the picker in this row is where one would be that came from the west."""
        away = np.abs(poses[self._pickers, 1] - self.layout.lanes[row].y)
        x = float(poses[self._pickers[int(np.argmin(away))], 0])
        return abs(x - (ROW_WEST + metres)) <= abs(x - (ROW_EAST - metres))

    def _paint(self, row: int, done: int, from_west: bool) -> None:
        picked = np.arange(CHUNKS) < done if from_west else np.arange(CHUNKS) >= CHUNKS - done
        colours = np.where(picked[:, None], palette.ROW_PICKED, palette.ROW_RIPE).astype(np.uint8)
        number = self.layout.lanes[row].number
        self.rec.log(f"world/rows/row_{number:02d}", rr.Mesh3D.from_fields(vertex_colors=np.repeat(colours, 4, axis=0)))
        self.rec.log(f"canopy/fruit/row_{number:02d}", rr.Points3D.from_fields(positions=self._fruit[row][~picked].reshape(-1, 3)))


def _strip(y: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    """A lane's ground as CHUNKS pieces of four corners each, and its triangles."""
    edges, half = np.linspace(ROW_WEST, ROW_EAST, CHUNKS + 1), width / 2 - 0.6
    south, north = y - half, y + half
    corners = [[(w, south, ROW_Z), (e, south, ROW_Z), (e, north, ROW_Z), (w, north, ROW_Z)] for w, e in pairwise(edges)]
    triangles = (4 * np.arange(CHUNKS)[:, None] + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return np.array(corners, np.float32).reshape(-1, 3), triangles.astype(np.uint32)


def _fruit(y: float, width: float, number: int) -> np.ndarray:
    """(CHUNKS, FRUIT_IN_A_CHUNK, 3): where a lane's fruit hangs; the same every time."""
    draw = np.random.default_rng(number)
    size = (CHUNKS, FRUIT_IN_A_CHUNK)
    west = ROW_WEST + ROW_LENGTH / CHUNKS * np.arange(CHUNKS)[:, None]
    x = west + ROW_LENGTH / CHUNKS * draw.random(size)
    across = y + (width - 0.8) * (draw.random(size) - 0.5)
    return np.stack([x, across, FRUIT_Z + 0.12 * draw.random(size)], axis=2).astype(np.float32)
