"""The route `one-way`, the base of all routes: a carrier's job, and the roads for drawings.

A scenario names a route; docs/traffic.md explains the roads and the places on them. The parts of
`OneWay` stand in files of their own: the roads and their places (`road_places.py`), the ways of
pickers (`picker_ways.py`) and those of carriers (`carrier_ways.py`).
"""

from msgspec.structs import replace

from orchard.field.kinds import KINDS
from orchard.field.queue import TOP_ROAD
from orchard.plans import steps as st
from orchard.plans.carrier_ways import CarrierWays
from orchard.plans.picker_ways import PickerWays
from orchard.plans.robot import Step
from orchard.plans.sides import Road, Side

__all__ = ["ROAD_WIDTH", "OneWay", "Road", "Side"]

# m, of a road in drawings: the width of a carrier.
ROAD_WIDTH = 1.5


class OneWay(PickerWays, CarrierWays):
    """All carriers drive one way.

    They drive south on the east side, west along the bottom, north on the west side, and east along
    the top. From the rows outwards lie the full bins in the lanes' mouths, the full-bin road F, the
    delivery road D, and the pickers' waiting places and their way to the next row. Each road is cut
    into one place a lane (`east/D/3`). A carrier has a place while any part of the carrier or of
    its bin is in the place. A picker that crosses has both roads' places at its lane.

    To change the route, derive a class, change figures or replace methods, and name it in the
    scenario: `route: my_package.MyRoute`. The class is called with the layout. The figures are
    attributes of the classes above it. They are metres on the east side. Where a figure is an x,
    it is that with rows of the usual 70 m. docs/traffic.md derives them.
    """

    def fetch(self, carrier: int, lane: int, side: Side, picker: str, full_bin: str) -> list[Step]:
        """Return a carrier's whole job.

        It brings an empty bin to the picker and the full bin to the bay, and drives back to the
        queue. `carrier`: the number of its place in the queue, see `number`.
        """
        job: list[Step] = [
            st.Confirmed(full_bin, otherwise=[st.Home(), *self.wait_in_queue()]),
            st.Say(f"bringing an empty bin to {picker}", "driving"),
            *_once_left(self.approach(lane, side, carrier), full_bin, side.place("D", lane)),
            st.Deliver(picker),
            *self.loop_to_full_bin(lane, side),
            st.TakeBin(full_bin),
            st.Say(f"taking {full_bin} to the bay", "hauling"),
            *self.go_to_bay(lane, side),
            st.Say(f"unloading {full_bin}", "unloading"),
            st.Unload(),
            *self.may_charge(carrier),
            *self.go_home(carrier),
        ]
        carrying = self.layout.scenario.carrying
        # A carrier may fail on each drive but in the queue. It is away at the load-out before it
        # is free for the next job.
        before_drive = self.may_fail(carrying.failure)
        steps: list[Step] = []
        for step in job:
            if isinstance(step, st.DriveTo) and not step.queueing:
                steps += before_drive
            elif isinstance(step, st.Home):
                steps += self.haul()
            steps.append(step)
        return steps

    def distance(self, x: float, y: float, lane: int, side: Side) -> float:
        """Return the metres by road from (x, y) in the queue to the stop at a lane.

        Along the queue's line to the delivery road, and along that; to the west around the bottom.
        """
        east = self.east.x(self.D_ROAD)
        to_road = east - x
        stop = side.y(self.layout.lane(lane).y, self.STOP)
        if side is self.east:
            return to_road + y - stop
        bottom = self.outer_bottom
        west = self.west.x(self.D_ROAD)
        return to_road + (y - bottom) + (east - west) + stop - bottom

    def roads(self) -> list[Road]:
        """Return the roads, for drawings."""
        inner = self.inner_bottom
        outer = self.outer_bottom
        top = self.layout.lane(1).y
        bottom = self.layout.lanes[-1].y
        head = self.queue.head
        # x of both roads on the east and on the west side.
        d = self.east.x(self.D_ROAD)
        f = self.east.x(self.F_ROAD)
        west_d = self.west.x(self.D_ROAD)
        west_f = self.west.x(self.F_ROAD)
        loop_d = [
            (head, TOP_ROAD),
            (d, TOP_ROAD),
            (d, outer),
            (west_d, outer),
            (west_d, top + self.STOP),
        ]
        loop_f = [(f, top), (f, inner), (west_f, inner), (west_f, TOP_ROAD), (head, TOP_ROAD)]
        roads = [Road("D", loop_d, ROAD_WIDTH), Road("F", loop_f, ROAD_WIDTH)]
        for side in self.sides.values():
            x = side.x(self.WAITING)
            roads.append(Road("picker", [(x, top), (x, bottom)], 0.0))
        return roads

    def holds(self) -> list[tuple[str, float, float]]:
        """Return where fronts of carriers stop while a lane's place is taken, for drawings.

        Each is the name of the road, and x and y of the front, m.
        """
        front = KINDS["carrier"].length / 2
        places = []
        for side in self.sides.values():
            for lane in self.layout.lanes:
                y = side.y(lane.y, front - self.HOLD)
                places.append(("D", side.x(self.D_ROAD), y))
                places.append(("F", side.x(self.F_ROAD), y))
        return places


def _once_left(approach: list[Step], full_bin: str, place: str) -> list[Step]:
    """Return a carrier's approach with the change that it asks for a lane's place only after the
    full bin is left there.

    Else the carrier would come first, and keep the picker in its row. `place`: of the lane on D.
    """
    steps: list[Step] = []
    for step in approach:
        if isinstance(step, st.DriveTo):
            needs = list(step.needs)
            for number, gate in enumerate(needs):
                if place in gate.places:
                    needs[number] = replace(gate, bin=full_bin)
            steps.append(replace(step, needs=needs))
        else:
            steps.append(step)
    return steps
