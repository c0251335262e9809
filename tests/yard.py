"""A world that tests drive by hand, without agents. The field is bare unless a test puts walls."""

import math
from dataclasses import dataclass, field

import numpy as np
from raycaster import world_of

from orchard.contract.messages import Deed
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.layout import ROW_WEST, lay_out
from orchard.field.scenario import Scenario
from orchard.sim.physics import step
from orchard.sim.world import NOBODY, World, new_world

LANE = 10.75  # y of row 1's centre line
AHEAD = Twist(1.0)
TURN_LEFT = Twist(yaw=math.pi / 8)


@dataclass
class Yard:
    """A world that is driven by hand."""

    world: World
    events: list = field(default_factory=list)

    def drive(self, ticks: int = 1, deeds: list[tuple[str, Deed]] = (), **twists: Twist) -> list:
        """Drive the named bodies for some ticks, everything else standing; deeds go with the first."""
        index, wanted = self.world.index, np.zeros_like(self.world.pose)
        for name, twist in twists.items():
            wanted[index[name]] = twist
        due, told = [(index[name], deed) for name, deed in deeds], []
        for _ in range(ticks):
            told += step(self.world, wanted, due)
            due = []
        self.events += told
        return told

    def do(self, name: str, deed: Deed) -> list:
        return self.drive(deeds=[(name, deed)])

    def pose(self, name: str) -> Pose:
        return Pose(*self.world.pose[self.world.index[name]].tolist())

    def put(self, name: str, *pose: float) -> None:
        self.world.pose[self.world.index[name]] = pose

    def couple(self, robot: str, bin_: str) -> None:
        """Couple by fiat, wherever they are."""
        i, j = self.world.index[robot], self.world.index[bin_]
        self.world.coupled[i], self.world.coupled[j] = j, i

    def coupled(self, name: str) -> str:
        other = int(self.world.coupled[self.world.index[name]])
        return "" if other == NOBODY else self.world.layout.names[other]

    def of(self, array: str, name: str):
        return getattr(self.world, array)[self.world.index[name]]

    def told(self, what: str) -> list:
        return [event for event in self.events if event.what == what]


def yard(*bodies, **kwargs) -> Yard:
    return Yard(world_of(*bodies, **kwargs))


def picker_with_bin(x: float = ROW_WEST, y: float = LANE, yaw: float = EAST, **kwargs) -> Yard:
    """picker_01 and its bin_02 behind it, in a bare field."""
    back = Pose(x - 2.25 * math.cos(yaw), y - 2.25 * math.sin(yaw), yaw)
    alone = yard(("picker", Pose(x, y, yaw)), ("bin", back), **kwargs)
    alone.couple("picker_01", "bin_02")
    return alone


def train(**kwargs) -> dict[str, Twist]:
    """The same twist for a picker and for the bin behind it, which is right as long as it is straight."""
    return {"picker_01": Twist(**kwargs), "bin_02": Twist(**kwargs)}


def everybody() -> Yard:
    return Yard(new_world(lay_out(Scenario(rows=3))))
