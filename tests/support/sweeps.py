"""What robots sweep where rows end: each turn, drive and stand there as boxes. tests/plans uses it
to show that no two robots collide there.

`collisions` looks at each pair of sweeps. `may_be_together` says whether two can happen at the same
time. They cannot if both robots would hold the same place of the roads, or if the order of their
work keeps one away until the other one is gone. All other pairs must be apart. Stages are those of
`walks`; a job is the work of a carrier for one bin.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from walks import UNIT, Area, Walk, walks_of

from orchard.field.geometry import HEADINGS, angle_between
from orchard.field.layout import Layout
from orchard.plans.robot import Step
from orchard.plans.steps import Alone, Deliver, DriveTo, Face, FetchEmpty, LeaveBin, TakeBin

# rad between two poses of a turn: 3 degrees. The furthest corner, that of the bin behind a picker,
# is 2.8 m from the middle of the turn. Between two poses it is at most
# 2.8 m * (1 - cos 1.5 degrees) = 1 mm further out.
STEP = np.pi / 60
# m: what is nearer counts as a collision.
LEAST_GAP = 0.01
# Sweeps that lie wholly north of y = 14 m, in the queue and the bay, are left out: they are the
# same in all orchards, however far rows are from each other.
NORTH = 14.0


# The heading of a drive, and the coordinate of the road across it, m.
Road = tuple[str, float]


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a robot, or a bin that is left, covers while it stands, drives or turns."""

    # 'stand', 'drive' or 'turn' of a robot, or 'bin': a bin that it has left.
    what: str
    robot: str
    # The picker for which a carrier works; a picker itself.
    picker: str
    stage: int
    # The places that the robot holds; none for a bin.
    places: frozenset[str]
    # The places of these that it shares with no carrier of its own.
    alone: frozenset[str]
    # Of a carrier: whether it has left its empty bin for the picker. Of a picker: whether it has
    # taken that.
    has_swapped: bool
    # Whether a carrier has coupled the full bin.
    has_bin: bool
    row: int
    heading: str
    # The road that a carrier is on, and the one before.
    roads: frozenset[Road]
    # x and y where it begins, m.
    begin: tuple[float, float]
    # x and y where it ends, m.
    end: tuple[float, float]
    # (n, 5): x, y, half length, half width (m), yaw (rad).
    boxes: np.ndarray

    def __str__(self) -> str:
        at = f"({self.begin[0]:.2f}, {self.begin[1]:.2f})"
        to = f"({self.end[0]:.2f}, {self.end[1]:.2f})"
        held = ", ".join(sorted(self.places)) or "nothing"
        return f"{self.robot} {self.what} {self.heading} {at} to {to} with {held}"

    @property
    def is_picker(self) -> bool:
        return self.robot == self.picker


class SweepingWalk(Walk):
    """A walk that notes what its robot sweeps."""

    def __init__(self, *values: object, **options: object) -> None:
        self.sweeps: list[Sweep] = []
        self.alone = frozenset[str]()
        self.roads: list[Road] = []
        self.has_swapped = False
        self.has_bin = False
        super().__init__(*values, **options)

    def take(self, step: Step) -> None:
        self.has_bin = self.has_bin or isinstance(step, TakeBin)
        super().take(step)
        match step:
            case Alone():
                self.alone = frozenset([step.place])
            case Deliver():
                self.has_swapped = True
            case FetchEmpty():
                self.has_swapped = True
                self.alone = frozenset()
            case LeaveBin():
                self.has_swapped = False

    def note(self, what: str, boxes: np.ndarray, end: tuple[float, float] | None = None) -> None:
        """Note a sweep of the robot, or of the bin that it leaves. `end`: None if it stays here."""
        self.sweeps.append(
            Sweep(
                what=what,
                robot=self.robot,
                picker=self.picker,
                stage=self.stage,
                places=frozenset() if what == "bin" else self.places,
                alone=self.alone & self.places,
                has_swapped=self.has_swapped,
                has_bin=self.has_bin,
                row=self.row,
                heading=self.heading,
                roads=frozenset(self.roads),
                begin=(self.x, self.y),
                end=end or (self.x, self.y),
                boxes=boxes,
            )
        )

    def bodies(self) -> list[tuple[float, float, float]]:
        """Return the boxes of the robot and of its bin: metres ahead, half length, half width."""
        bodies = [(0.0, self.kind.length / 2, self.kind.width / 2)]
        if self.tows:
            # A bin is a square of 1 m.
            bodies.append((-self.kind.tows, 0.5, 0.5))
        return bodies

    def at_yaw(self, yaw: float) -> list[tuple[float, ...]]:
        """Return the boxes of the robot and its bin if it faces this way here."""
        return [
            (self.x + ahead * np.cos(yaw), self.y + ahead * np.sin(yaw), length, width, yaw)
            for ahead, length, width in self.bodies()
        ]

    def stand(self) -> None:
        super().stand()
        if self.robot == self.picker and self.stage == 0 and self.heading == "EAST":
            # It leaves its start in the west before a carrier comes there.
            return
        self.note("stand", np.array(self.at_yaw(HEADINGS[self.heading])))

    def bin_behind(self, heading: str) -> Area:
        area = super().bin_behind(heading)
        if not heading and self.robot == self.picker:
            self.note("bin", np.array([(area.x, area.y, 0.5, 0.5, 0.0)]))
        return area

    def turn(self, step: Face) -> None:
        super().turn(step)
        start = HEADINGS[self.heading]
        turn = angle_between(start, HEADINGS[step.heading])
        count = max(1, round(abs(turn) / STEP))
        poses = [self.at_yaw(start + turn * i / count) for i in range(count + 1)]
        self.note("turn", np.array([box for pose in poses for box in pose]))

    def leg(
        self, step: DriveTo, to: float, ahead: int, wanted: frozenset[str] = frozenset()
    ) -> None:
        x, y = (self.x, to) if step.x is None else (to, self.y)
        ux, uy = UNIT[self.heading]
        yaw = HEADINGS[self.heading]
        length = abs(x - self.x) + abs(y - self.y)
        boxes = []
        for before, half_length, half_width in self.bodies():
            middle = before + length / 2
            boxes.append(
                (
                    self.x + ux * middle,
                    self.y + uy * middle,
                    half_length + length / 2,
                    half_width,
                    yaw,
                )
            )
        road = (self.heading, round(y if step.x is not None else x, 6))
        # On these roads its laser keeps a carrier behind the one ahead of it (`_follow`). A carrier
        # that does not stop for all it sees is kept behind nothing.
        if length and not step.blind_to and road not in self.roads:
            self.roads = [*self.roads[-1:], road]
        self.note("drive", np.array(boxes), (x, y))
        if step.blind_to:
            self.roads = []
        super().leg(step, to, ahead, wanted)


def sweeps_at_rows(layout: Layout) -> list[Sweep]:
    """Return what is swept near the rows. Of equal sweeps, one is returned."""
    sweeps = {}
    for walk in walks_of(layout, SweepingWalk):
        assert isinstance(walk, SweepingWalk)
        for sweep in walk.sweeps:
            if (sweep.boxes[:, 1] - sweep.boxes[:, 2]).min() < NORTH:
                key = (sweep.what, sweep.robot, sweep.stage, sweep.places, sweep.alone)
                sweeps[(*key, sweep.has_swapped, sweep.has_bin, sweep.boxes.tobytes())] = sweep
    return list(sweeps.values())


def collisions(layout: Layout) -> list[tuple[Sweep, Sweep]]:
    """Return the pairs that may be there at the same time, and are not apart."""
    sweeps = sweeps_at_rows(layout)
    reach = np.array([bounds(sweep.boxes) for sweep in sweeps])
    return [
        (sweeps[i], sweeps[j])
        for i, j in _near(reach)
        if may_be_together(sweeps[i], sweeps[j]) and not are_apart(sweeps[i].boxes, sweeps[j].boxes)
    ]


def _near(reach: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield the pairs (i, j) of sweeps whose bounds meet, with i < j.

    `reach`: (n, 4), of each sweep least x, greatest x, least y and greatest y, m.
    """
    for i in range(len(reach)):
        rest = reach[i + 1 :]
        meet = (
            (rest[:, 0] < reach[i, 1] + LEAST_GAP)
            & (rest[:, 1] > reach[i, 0] - LEAST_GAP)
            & (rest[:, 2] < reach[i, 3] + LEAST_GAP)
            & (rest[:, 3] > reach[i, 2] - LEAST_GAP)
        )
        for j in np.flatnonzero(meet):
            yield i, i + 1 + int(j)


def bounds(boxes: np.ndarray) -> tuple[float, float, float, float]:
    """Return the least and greatest x, and the least and greatest y, of boxes, m."""
    c, s = np.abs(np.cos(boxes[:, 4])), np.abs(np.sin(boxes[:, 4]))
    half_x = c * boxes[:, 2] + s * boxes[:, 3]
    half_y = s * boxes[:, 2] + c * boxes[:, 3]
    x, y = boxes[:, 0], boxes[:, 1]
    return (x - half_x).min(), (x + half_x).max(), (y - half_y).min(), (y + half_y).max()


def are_apart(some: np.ndarray, others: np.ndarray) -> bool:
    """Whether each box of one sweep is further than LEAST_GAP from each box of another sweep.

    Two boxes are apart if a line along a side of one of them separates them. `some`: (n, 5),
    `others`: (m, 5), as `Sweep.boxes`.
    """
    # (n, m): of each pair, whether a line was found, where the second box is, and how it is turned.
    apart = np.zeros((len(some), len(others)), bool)
    dx = others[None, :, 0] - some[:, None, 0]
    dy = others[None, :, 1] - some[:, None, 1]
    turn = others[None, :, 4] - some[:, None, 4]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    for own, other, yaw in (
        (some[:, None], others[None, :], some[:, None, 4]),
        (others[None, :], some[:, None], others[None, :, 4]),
    ):
        along = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy)
        across = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx)
        length = own[..., 2] + c * other[..., 2] + s * other[..., 3]
        width = own[..., 3] + s * other[..., 2] + c * other[..., 3]
        apart |= (along > length + LEAST_GAP) | (across > width + LEAST_GAP)
    return bool(apart.all())


def may_be_together(one: Sweep, other: Sweep) -> bool:
    """Whether two sweeps can happen at the same time: see the head of this module."""
    # A robot is at one place at a time.
    if one.robot == other.robot and "bin" not in (one.what, other.what):
        return False
    # Two bins that stand were put there by pickers, which are tested. And no carrier meets the one
    # that it follows.
    if one.what == other.what == "bin" or _follow(one, other):
        return False
    # Robots of different pickers are kept apart by places alone.
    if one.picker != other.picker:
        return not one.places & other.places
    if one.is_picker and other.is_picker:
        return _meets_own_bin(one, other)
    if not one.is_picker and not other.is_picker:
        return not one.places & other.places
    picker, job = (one, other) if one.is_picker else (other, one)
    # The bin of a job is left in the stage before, and stands until the carrier has coupled it.
    if picker.what == "bin":
        return not job.has_bin and picker.stage == job.stage - 1
    # The carrier comes to the row's end only when the picker has left its bin, and has gone before
    # the picker picks in the same row again (in an even stage).
    is_back = picker.stage > job.stage and picker.row == job.row and picker.stage % 2 == 0
    if picker.stage < job.stage or is_back or not _is_in_time(picker, job):
        return False
    shared = picker.places & job.places
    return not (shared & picker.alone or shared - _shareable(picker, job))


def _meets_own_bin(one: Sweep, other: Sweep) -> bool:
    """Whether a picker may meet a bin that it left.

    It may not in its row, where it drives without a bin.
    """
    left, moving = (one, other) if one.what == "bin" else (other, one)
    if left.what != "bin" or moving.what == "bin":
        return False
    return moving.stage > left.stage + 1 and moving.row != left.row


def _is_in_time(picker: Sweep, job: Sweep) -> bool:
    """Whether a picker and the carrier that works for it can be so far at the same time."""
    if picker.stage > job.stage or picker.has_swapped:
        return job.has_swapped
    return not job.has_swapped


def _shareable(picker: Sweep, job: Sweep) -> frozenset[str]:
    """Return the place on road D that a picker and its carrier share after they have swapped."""
    if picker.stage != job.stage or not (picker.has_swapped and job.has_swapped):
        return frozenset()
    return frozenset(place for place in picker.places if "/D/" in place)


def _follow(behind: Sweep, ahead: Sweep) -> bool:
    """Whether lasers keep a carrier behind another one, on one line or round the next corner."""
    if behind.is_picker or ahead.is_picker or "bin" in (behind.what, ahead.what):
        return False
    return not behind.roads.isdisjoint(ahead.roads)


def in_words(pairs: Sequence[tuple[Sweep, Sweep]], most: int = 12) -> str:
    """Return a line for each of the first pairs, for the message of a test that fails."""
    return "\n".join(f"{one} | {other}" for one, other in pairs[:most])
