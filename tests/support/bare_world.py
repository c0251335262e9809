"""A world that tests drive directly, without agents.

The field has no walls except those of the test.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from raycaster import world_of

from orchard.contract.messages import Deed
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.sim.kernels.boxes import RADIUS, overlap, place
from orchard.sim.physics import step
from orchard.sim.world import NONE, World

# y of row 1's centre line.
LANE = 10.75
# The fastest drive and turn of the default scenario.
AHEAD = Twist(1.0)
TURN_LEFT = Twist(yaw=math.pi / 8)


@dataclass
class Yard:
    """A world whose bodies a test drives, and the events that happened in it."""

    world: World
    events: list = field(default_factory=list)

    def drive(self, ticks: int = 1, deeds: list[tuple[str, Deed]] = (), **twists: Twist) -> list:
        """Drive the named bodies for some ticks, with the deeds at the first one.

        All other bodies stand. Return the events.
        """
        index = self.world.index
        wanted = np.zeros_like(self.world.pose)
        for name, twist in twists.items():
            wanted[index[name]] = twist
        due = [(index[name], deed) for name, deed in deeds]
        events = []
        for _ in range(ticks):
            events += step(self.world, wanted, due)
            due = []
        self.events += events
        return events

    def do(self, name: str, deed: Deed) -> list:
        """Let a robot do a deed, such as coupling a bin, in one tick in which all bodies stand."""
        return self.drive(deeds=[(name, deed)])

    def pose(self, name: str) -> Pose:
        return Pose(*self.world.pose[self.world.index[name]].tolist())

    def put(self, name: str, *pose: float) -> None:
        """Set the pose of a body: x and y, m, and yaw, rad."""
        self.world.pose[self.world.index[name]] = pose

    def couple(self, robot: str, bin_: str) -> None:
        """Couple a bin to a robot, wherever both stand."""
        i, j = self.world.index[robot], self.world.index[bin_]
        self.world.coupled[i] = j
        self.world.coupled[j] = i

    def coupled(self, name: str) -> str:
        """Return what is coupled to a body, "" if nothing is."""
        other = int(self.world.coupled[self.world.index[name]])
        return "" if other == NONE else self.world.layout.names[other]

    def of(self, array: str, name: str):
        """Return the value of a body in an array of the world, such as `fill`."""
        return getattr(self.world, array)[self.world.index[name]]

    def happened(self, what: str) -> list:
        """Return the events of a kind."""
        return [event for event in self.events if event.what == what]


def yard(*bodies, **kwargs) -> Yard:
    """Return a yard with just these bodies; the arguments are those of `raycaster.world_of`."""
    return Yard(world_of(*bodies, **kwargs))


def picker_with_bin(x: float = ROW_WEST, y: float = LANE, yaw: float = EAST, **kwargs) -> Yard:
    """Return a yard with picker_01 and bin_02 coupled behind it."""
    tows = KINDS["picker"].tows
    back = Pose(x - tows * math.cos(yaw), y - tows * math.sin(yaw), yaw)
    alone = yard(("picker", Pose(x, y, yaw)), ("bin", back), **kwargs)
    alone.couple("picker_01", "bin_02")
    return alone


def train(**kwargs) -> dict[str, Twist]:
    """Return the same twist for picker_01 and bin_02 behind it.

    That keeps the bin in place while they drive straight.
    """
    return {"picker_01": Twist(**kwargs), "bin_02": Twist(**kwargs)}


def overlapping(world: World) -> list[tuple[str, str]]:
    """Return the pairs of things that overlap. The name of a wall is its number."""
    boxes = world.fixed.shapes.copy()
    place(world.pose, boxes)
    things = np.vstack([boxes, world.fixed.walls])
    names = [*world.layout.names, *map(str, range(len(world.fixed.walls)))]
    apart = np.hypot(*(boxes[:, None, :2] - things[None, :, :2]).T)
    near = np.argwhere(boxes[:, None, RADIUS] + things[None, :, RADIUS] > apart.T)
    return [(names[i], names[j]) for i, j in near if i < j and overlap(boxes[i], things[j])]


def overlapping_starts(layout: Layout) -> list[tuple[str, str]]:
    """Return the pairs that overlap at the start and should not.

    People and animals may stand on weeds.
    """
    pairs = [(pair, {name.split("_")[0] for name in pair}) for pair in overlapping(World(layout))]
    return [pair for pair, kinds in pairs if "weed" not in kinds or not kinds & {*PEOPLE, *ANIMALS}]


def everybody() -> Yard:
    """Return a scenario with bodies of each kind."""
    return Yard(World(lay_out(Scenario(rows=3))))
