"""Carriers as vehicles: they bring pickers empty bins, and take full ones to the bay, as fleet
control orders it.
"""

from collections.abc import Sequence
from typing import ClassVar, cast

from orchard import Carrier, CarrierMemory, Heard, Layout, No, PlanExecutor, Step, Yes
from orchard.contract.messages import Answer, Call, CarrierQuery, CarrierStatus, Come, Offer
from orchard.field.geometry import STILL
from orchard.field.scenario import TIME_STEP
from orchard.plans.sense import something_ahead
from orchard.plans.steps import Deliver, TakeBin, Unload
from orchard.roads.actions import DROP, HAND_OVER, PICK, UNLOAD
from orchard.roads.graph import BAY, QUEUE, Graph
from orchard_vda5050.calls import Calls
from orchard_vda5050.driver import Driver
from orchard_vda5050.order import ActionOrder, Node, Parameter
from orchard_vda5050.vehicle import ON_A_NODE, Port, Timing, Vehicle

# After which handing over has failed, if the full bin has not sent for a vehicle: another carrier
# comes.
SENT_FOR_SECONDS = 30.0


class VehicleMemory(CarrierMemory):
    """A carrier's memory.

    `duty`: a Duty as packed msgpack: a memory is small, and compared at each tick, part by part.
    """

    duty: bytes = b""


class Drop(Step, frozen=True):
    """Uncouple the bin, and remember it."""

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None:
            return True
        robot.memory.delivered = robot.seen.hitch.name
        robot.uncouple()
        return False


class HandOver(Step, frozen=True):
    """Leave the empty bin to the picker that has left the full one, once that bin has sent for a
    vehicle: this one, or one behind it.
    """

    bin: str
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        picker = cast(Driver, robot).calls.picker_of(self.bin)
        robot.action.waits_for = self.bin
        robot.hold()
        if picker:
            robot.next([Deliver(picker)])
        return bool(picker)


class UntilLeft(Step, frozen=True):
    """Stand before a lane until a full bin is left there, unless the order leads on: a vehicle that
    stays would shut the picker in.
    """

    station: str
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        driver = cast(CarrierDriver, robot)
        order = driver.duty.order
        if not driver.before(order.nodes):
            return True
        robot.action.waits_for = f"a full bin at {self.station}"
        robot.hold()
        if (
            order.nodes[0].actions
            and (robot.seen.tick - robot.memory.since) * TIME_STEP > SENT_FOR_SECONDS
        ):
            order.queue = order.nodes[0].actions
            driver.fails(f"no full bin is left at {self.station} within {SENT_FOR_SECONDS:g} s")
        return False


class CarrierDriver(Driver):
    """A carrier at one tick."""

    def before(self, nodes: Sequence[Node]) -> Sequence[Step]:
        stop, *onward = nodes
        station, stays = (
            self.graph.station_of(stop.node_id),
            stop.actions or not onward or not onward[0].released,
        )
        return (
            [UntilLeft(station)]
            if station and stays and not self.duty.is_away and not self.calls.bin_at(station)
            else []
        )

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        load = str(action.value("loadId") or "")
        return [
            {PICK: TakeBin(load), DROP: Drop(), HAND_OVER: HandOver(load), UNLOAD: Unload()}[
                action.action_type
            ]
        ]

    def why_not(self, action: ActionOrder) -> str:
        has_bin = self.seen.hitch is not None
        if action.action_type == PICK:
            return "it has a bin already" if has_bin else ""
        is_left = action.action_type == HAND_OVER and self.memory.delivered
        return "" if has_bin or is_left else "it has no bin"

    def finished(self, action: ActionOrder) -> None:
        duty, kind = self.duty, action.action_type
        duty.is_laden = kind == PICK or (duty.is_laden and kind not in (UNLOAD, DROP))
        if kind == HAND_OVER:
            duty.owes = str(action.value("loadId"))
        if kind == PICK:
            self.memory.delivered, duty.owes = "", ""

    def is_late(self, action: ActionOrder, seconds: float) -> str:
        load = str(action.value("loadId"))
        if (
            action.action_type == HAND_OVER
            and seconds > SENT_FOR_SECONDS
            and not self.calls.picker_of(load)
        ):
            return (
                f"{load} has not sent for a vehicle within {SENT_FOR_SECONDS:g} s: another carrier"
                " comes"
            )
        return super().is_late(action, seconds)

    def after_failing(self, action: ActionOrder) -> Sequence[Step]:
        """Take back the empty bin that was left for a picker: it would stand in the way of
        others.
        """
        is_left = (
            action.action_type == HAND_OVER and self.seen.hitch is None and self.memory.delivered
        )
        return [TakeBin(self.memory.delivered)] if is_left else []

    def arrived(self, before: str) -> None:
        if not before.startswith(QUEUE):
            self.idles()

    def idles(self) -> None:
        """In the queue keep no places: an edge that was given up may have left some, or has got
        them only now.
        """
        if self.duty.order.last_node.startswith(QUEUE):
            self.free(list(self.memory.reserved))


class CarrierVehicle(Vehicle):
    """A carrier as a vehicle of VDA 5050."""

    Memory: type[VehicleMemory] = VehicleMemory
    Steps = (Drop, HandOver, UntilLeft)
    drives_with = CarrierDriver
    holds = True

    def __init__(
        self, layout: Layout, name: str, graph: Graph, port: Port, calls: Calls, timing: Timing
    ) -> None:
        robot = Carrier(layout, name)
        super().__init__(robot, name, graph, port, calls, timing)
        self._home = graph.lines[(robot.number - 1) // layout.queue.places]
        self._before = robot.route.may_fail(layout.scenario.carrying.failure)

    def answer(self, robot: Driver, heard: Heard) -> Answer:
        """Offer the vehicle to a bin that its order names, and agree with no other one."""
        body, order = heard.body, robot.duty.order
        is_ordered = heard.sender in order.loads()
        if isinstance(body, CarrierQuery):
            return CarrierStatus(next(order.loads(), ""), False, 0.0)
        if isinstance(body, Call) and is_ordered:
            return Offer(robot.pose.x, robot.pose.y, 0.0)
        if isinstance(body, Come) and is_ordered:
            return Yes()
        return No(
            "fleet control orders otherwise"
            if isinstance(body, Call | Come)
            else "a carrier knows nothing of that"
        )

    def is_home(self, robot: Driver) -> bool:
        return robot.duty.order.last_node.startswith(QUEUE) and (
            robot.duty.order.is_idle or robot.seen.twist == STILL
        )

    def is_held_up(self, robot: Driver) -> bool:
        """Before a lane at which no bin is left, and at a stop with a bin right behind it: it
        cannot turn beside a picker.
        """
        return isinstance(robot.memory.plan[0], UntilLeft) or self._is_at_a_stop(robot)

    def _is_at_a_stop(self, robot: Driver) -> bool:
        hitch = robot.seen.hitch
        is_behind = (
            hitch is not None and abs(hitch.x - robot.pose.x) < ON_A_NODE
        )  # it has not turned
        return is_behind and self.graph.station_of(robot.duty.order.last_node) != ""

    def is_out_of_the_way(self, robot: Driver) -> bool:
        last = robot.duty.order.last_node
        return last.startswith(QUEUE) and (
            last in self.graph.lines or something_ahead(robot.seen, [])
        )

    def clear_the_roads(self, robot: Driver) -> None:
        """Drive to the queue, through the bay with a full bin, also with one that it has promised
        to take.

        A picker that waits beside it gets its empty bin: with that one it could not turn there.
        """
        order, promised = robot.duty.order, robot.duty.owes
        load = self._calls.bin_at(self.graph.station_of(order.last_node))
        if load and not robot.duty.phase and self._is_at_a_stop(robot):
            order.queue, promised = (
                [ActionOrder(HAND_OVER, HAND_OVER, "HARD", [Parameter("loadId", load)])],
                load,
            )
        if promised:
            self.add(order, self.graph.bins, PICK, promised)
        if promised or robot.duty.is_laden:
            self.add(order, [BAY], UNLOAD)
        self.add(order, [self._home])
