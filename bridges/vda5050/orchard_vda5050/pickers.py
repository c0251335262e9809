"""Pickers as vehicles: they pick rows, leave full bins and couple empty ones, as fleet control
orders it.
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
from orchard_vda5050.order import ActionOrder
from orchard_vda5050.vehicle import Port, Timing, Vehicle


class VehicleMemory(PickerMemory):
    """A picker's memory. `duty`: a Duty as packed msgpack."""

    duty: bytes = b""


class PickerDriver(Driver):
    """A picker at one tick."""

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        name, _, number = self.duty.order.last_node.split("/")
        side, row = self.route.sides[name], int(number)
        if action.action_type == PICK:
            return [FetchEmpty(side.place("D", row))]
        one = pass_at(row, side, self.pose.x, self.pose.x, self.duty.fill, self.duty.is_laden)
        return self.route.leave(one, side, self.route.cross(side, row, self.route.hold(row, side)))

    def why_not(self, action: ActionOrder) -> str:
        has_bin = self.seen.hitch is not None
        if action.action_type == PICK:
            return (
                "it has a bin already"
                if has_bin
                else ""
                if self.memory.full_bin
                else "it has left no bin"
            )
        if action.action_type == DROP and not (has_bin and self.duty.fill):
            return "its bin is empty: no carrier would come" if has_bin else "it has no bin"
        return ""

    def why_not_drive(self) -> str:
        is_to_fetch = "/wait/" in self.duty.order.last_node and self.seen.hitch is None
        return "it must first couple the empty bin that a carrier brings" if is_to_fetch else ""

    def finished(self, action: ActionOrder) -> None:
        self.duty.is_laden, self.duty.fill = False, 0.0

    def is_late(self, action: ActionOrder, seconds: float) -> str:
        """It waits for a carrier for as long as it takes."""
        return "" if action.action_type == PICK else super().is_late(action, seconds)


class PickerVehicle(Vehicle):
    """A picker as a vehicle of VDA 5050."""

    Memory: type[VehicleMemory] = VehicleMemory
    Steps = (Weigh, FreeWithout)
    drives_with = PickerDriver
    holds = True

    def __init__(
        self, layout: Layout, name: str, graph: Graph, port: Port, calls: Calls, timing: Timing
    ) -> None:
        super().__init__(Picker(layout, name), name, graph, port, calls, timing)

    def answer(self, robot: PickerDriver, heard: Heard) -> Answer:
        return Picker.answer(cast(Picker, self.robot), robot, heard)

    def is_home(self, robot: PickerDriver) -> bool:
        return robot.duty.order.is_idle and not robot.duty.phase

    def is_out_of_the_way(self, robot: PickerDriver) -> bool:
        return not robot.memory.reserved and (
            robot.seen.hitch is not None or "/wait/" not in robot.duty.order.last_node
        )

    def clear_the_roads(self, robot: PickerDriver) -> None:
        """Drive out of the row, couple an empty bin if it has left one, for which a carrier would
        wait, and drive aside.
        """
        order = robot.duty.order
        side, _, row = order.decision_point[0].split("/")
        is_left = robot.seen.hitch is None or any(
            action.action_type == DROP for action in order.queue
        )
        self.add(order, [f"{side}/wait/{row}"], PICK if is_left else "")
        self.add(order, [f"{side}/aside/{row}"])
