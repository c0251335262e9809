"""A harvest that is only acted: bodies on rails, no physics, no agents. It feeds the picture in tests and measurements."""

from collections.abc import Iterator

import numpy as np

from orchard.contract.agent import State
from orchard.contract.events import Event, Frame
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout, Start, lay_out
from orchard.field.scenario import Scenario

ACTED_SECONDS = 90.0  # of the recording that tests share
WAIT = 25.0  # s that a picker waits at the end of a row


def acted_layout(**scenario: object) -> Layout:
    return lay_out(Scenario(**scenario))


def frames(layout: Layout, seconds: float, scanner: object = None) -> Iterator[Frame]:
    """Every tick of an acted harvest; with a scanner (world -> ranges) also its scans."""
    stage = Stage(layout)
    for tick in range(int(seconds * 10) + 1):
        yield stage.frame(tick, scanner)


class Stage:
    """Where everything is at a tick."""

    def __init__(self, layout: Layout) -> None:
        self.layout, n = layout, len(layout.starts)
        self.poses = np.array([start.pose for start in layout.starts], float)
        self.coupled, self.fill, self.alive = np.full(n, -1), np.zeros(n), np.ones(n, bool)
        self.row_picked, self.delivered = np.zeros(len(layout.lanes)), 0
        self.doing: dict[str, tuple[str, State]] = {}
        self.events: list[Event] = []
        for start in layout.starts:
            if start.bin:
                i, j = layout.index[start.name], layout.index[start.bin]
                self.coupled[i], self.coupled[j] = j, i
        self.ways = {start.name: self._way(start) for start in layout.starts if start.kind in ("picker", "carrier")}

    def frame(self, tick: int, scanner: object = None) -> Frame:
        self.events = []
        for i, start in enumerate(self.layout.starts):
            act = getattr(self, f"_{start.kind}", None)
            if act is not None:
                act(i, start, tick / 10)
        self._towed()
        scans = scanner(self) if scanner is not None else None
        return Frame(
            tick,
            self.poses.copy(),
            {name: words for name, (words, _) in self.doing.items()},
            scans,
            self.coupled.copy(),
            self.fill.copy(),
            self.alive.copy(),
            self.row_picked.copy(),
            self.delivered,
            list(self.events),
            states={name: state for name, (_, state) in self.doing.items()},
        )

    def _way(self, start: Start) -> np.ndarray:
        """The corners of a robot's way."""
        if start.kind == "picker":
            ends = [[(-35.5, self.layout.lane(n).y), (40.5, self.layout.lane(n).y)] for n in self.layout.blocks[start.name].rows]
            turned = [(x if i % 2 == 0 else -3 - x, y) for i, row in enumerate(ends) for x, y in row]
            return np.array(turned)
        south = self.layout.tree_lines[-1] - 6
        return np.array([start.pose[:2], (38.25, start.pose.y), (38.25, south), (-41.25, south), (-41.25, 24.5), (-30, 24.5),
                         (self.layout.queue.head - 30, 24.5), (self.layout.queue.head - 30, start.pose.y), start.pose[:2]])  # fmt: skip

    def _drive(self, i: int, way: np.ndarray, metres: float) -> None:
        legs = np.hypot(*np.diff(way, axis=0).T)
        done = np.concatenate([[0.0], np.cumsum(legs)])
        leg = int(np.clip(np.searchsorted(done, metres, side="right") - 1, 0, len(legs) - 1))
        along = min(max(metres - done[leg], 0.0), legs[leg]) / max(legs[leg], 1e-9)
        x, y = way[leg] + along * (way[leg + 1] - way[leg])
        dx, dy = way[leg + 1] - way[leg]
        self.poses[i] = x, y, np.arctan2(dy, dx)

    def _picker(self, i: int, start: Start, now: float) -> None:
        rows, name, bin_ = self.layout.blocks[start.name].rows, start.name, self.layout.index[start.bin]
        turn = 76.0 + WAIT + 7.0
        block, into = divmod(now, turn)
        if int(block) >= len(rows):
            self.doing[name] = "resting", "resting"
            return
        row = rows[int(block)]
        self._drive(
            i, self.ways[name], block * (76.0 + self.layout.scenario.row_width + 0.5) + min(into, 76.0) + max(0.0, into - 76.0 - WAIT)
        )
        self.row_picked[row - 1] = min(into, self.layout.row_length)
        self.fill[bin_] = self.row_picked[row - 1] if into < 76.0 + WAIT else 0.0
        self.doing[name] = (
            (f"picking row {row}", "picking") if into < 70
            else (f"leaving row {row}", "handling a bin") if into < 76
            else ("waiting for a bin", "waiting")
        )  # fmt: skip
        if abs(into - 70.0) < 0.05:
            callers = [s.name for s in self.layout.starts if s.kind == "carrier"]
            self.events += [Event(0, "call", start.bin, carrier, f"call, lane {row} east") for carrier in callers]
            self.events += [Event(0, "offer", carrier, start.bin, "offer, 40 m") for carrier in callers]
            self.events += [Event(0, "come", start.bin, callers[0], f"come, lane {row} east")]

    def _carrier(self, i: int, start: Start, now: float) -> None:
        wait = 8.0 * int(start.name[-2:])
        self._drive(i, self.ways[start.name], max(0.0, (now - wait) % 500.0))
        x, y = self.poses[i, :2]
        bay = y == 24.5 and -35 < x < -28
        self.doing[start.name] = (
            ("waiting in the queue", "waiting") if now < wait
            else ("unloading", "unloading") if bay
            else ("driving to row 2", "driving") if x > 0
            else ("taking a full bin", "hauling")
        )  # fmt: skip
        self.fill[self.layout.index[start.bin]] = self.layout.row_length if y < 10 or x < -31 else 0.0
        if bay and x > -28.1:
            self.delivered += 1
            self.events.append(Event(0, "delivered", start.name, "", "a bin"))

    def _tractor(self, i: int, start: Start, now: float) -> None:
        leg, into = divmod(now, 33.0)
        there = min(into, 20.0)
        self.poses[i] = (-45 + there, 29, 0.0) if leg % 2 == 0 else (-25 - there, 29, np.pi)
        self.doing[start.name] = ("driving", "driving") if into < 20 else ("waiting 5 s", "waiting")

    def _wander(self, i: int, start: Start, now: float) -> None:
        a = 0.2 * now + i
        self.poses[i] = start.pose.x + 3 * np.cos(a), start.pose.y + 3 * np.sin(a), a + np.pi / 2

    _worker = _visitor = _dog = _cat = _wander

    def _weed(self, i: int, start: Start, now: float) -> None:
        self.alive[i] = now < 20.0 * int(start.name[-2:])

    def _towed(self) -> None:
        for i, start in enumerate(self.layout.starts):
            if start.bin:
                x, y, yaw = self.poses[i]
                tows = KINDS[start.kind].tows
                self.poses[self.layout.index[start.bin]] = x - tows * np.cos(yaw), y - tows * np.sin(yaw), yaw
