"""Pickers as vehicles.

They pick rows, leave full bins and couple empty ones, as fleet control orders it.
"""

from collections.abc import Sequence
from typing import cast

from orchard import Heard, Layout, Picker, PickerMemory, Step
from orchard.contract.messages import Answer
from orchard.plans.steps import FetchEmpty
from orchard.roads.actions import DROP, PICK
from orchard.roads.graph import Graph
from orchard.roads.pickers import FreeWithout, Weigh, pass_at
from orchard_vda5050.calls import Calls
from orchard_vda5050.driver import Driver
from orchard_vda5050.received import ActionOrder
from orchard_vda5050.vehicle import Port, Timing, Vehicle


class PickerVehicleMemory(PickerMemory):
    """A picker's memory. `duty`: a Duty as packed msgpack."""

    duty: bytes = b""


class PickerDriver(Driver):
    """A picker at one tick."""

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        """Return the steps of an action at the end of a row."""
        # A node of pickers is named as east/out/3: a side, what it is for, and a row.
        name, _, number = self.duty.order.last_node.split("/")
        side = self.route.sides[name]
        row = int(number)
        if action.action_type == PICK:
            # D is the road of deliveries, on which a carrier brings the empty bin.
            return [FetchEmpty(side.place("D", row))]
        # The picker has picked so far, and picks no further: begin and stop are here.
        x = self.pose.x
        end_of_pass = pass_at(row, side, x, x, fill=self.duty.fill, is_full=self.duty.is_laden)
        stop_line = self.route.hold(row, side)
        return self.route.leave(end_of_pass, side, self.route.cross(side, row, stop_line))

    def why_not(self, action: ActionOrder) -> str:
        """Return why the vehicle cannot begin an action; '' if it can."""
        if action.action_type == PICK:
            return self._why_not_pick()
        if action.action_type == DROP:
            return self._why_not_drop()
        return ""

    def _why_not_pick(self) -> str:
        if self.seen.hitch is not None:
            return "it has a bin already"
        return "" if self.memory.full_bin else "it has left no bin"

    def _why_not_drop(self) -> str:
        if self.seen.hitch is None:
            return "it has no bin"
        return "" if self.duty.fill else "its bin is empty: no carrier would come"

    def why_not_drive(self) -> str:
        """Return why the vehicle cannot leave the last node; '' if it can."""
        if "/wait/" in self.duty.order.last_node and self.seen.hitch is None:
            return "it must first couple the empty bin that a carrier brings"
        return ""

    def finished(self, action: ActionOrder) -> None:
        """Note that the bin on the bar, if there is one, is empty after each action."""
        self.duty.is_laden = False
        self.duty.fill = 0.0

    def why_late(self, action: ActionOrder, seconds: float) -> str:
        """Return why an action has failed. The picker waits for a carrier as long as it takes."""
        return "" if action.action_type == PICK else super().why_late(action, seconds)


class PickerVehicle(Vehicle):
    """A picker as a vehicle of VDA 5050."""

    Memory: type[PickerVehicleMemory] = PickerVehicleMemory
    Steps = (Weigh, FreeWithout)
    drives_with = PickerDriver
    holds = True

    def __init__(
        self, layout: Layout, name: str, *, graph: Graph, port: Port, calls: Calls, timing: Timing
    ) -> None:
        """`graph`: the roads as this kind drives them. `port`: the line to fleet control."""
        robot = Picker(layout, name)
        super().__init__(robot, name, graph=graph, port=port, calls=calls, timing=timing)

    def answer(self, robot: PickerDriver, heard: Heard) -> Answer:
        """Answer as the Orchard's own pickers do."""
        return Picker.answer(cast(Picker, self.robot), robot, heard)

    def is_home(self, robot: PickerDriver) -> bool:
        """Whether a vehicle that clears the roads by itself has nothing left to do."""
        return robot.duty.order.is_idle and not robot.duty.phase

    def is_out_of_the_way(self, robot: PickerDriver) -> bool:
        """Whether the vehicle has no place on the roads, and waits for no carrier."""
        waits_for_carrier = robot.seen.hitch is None and "/wait/" in robot.duty.order.last_node
        return not robot.memory.reserved and not waits_for_carrier

    def clear_the_roads(self, robot: PickerDriver) -> None:
        """Drive out of the row, and aside.

        A vehicle that has left its bin, or is about to, couples an empty one first: a carrier would
        wait for that.
        """
        order = robot.duty.order
        side, _, row = order.decision_point[0].split("/")
        drops = any(action.action_type == DROP for action in order.queue)
        needs_bin = drops or robot.seen.hitch is None
        self.add(order, [f"{side}/wait/{row}"], PICK if needs_bin else "")
        self.add(order, [f"{side}/aside/{row}"])
