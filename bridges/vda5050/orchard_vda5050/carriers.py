"""Carriers as vehicles.

They bring pickers empty bins, and take full ones to the bay, as fleet control orders it.
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
from orchard_vda5050.received import ActionOrder, Node, Parameter
from orchard_vda5050.vehicle import ON_A_NODE, Port, Timing, Vehicle

# After these simulated seconds handing over has failed, if the full bin has not sent for a vehicle:
# another carrier comes.
SENT_FOR_SECONDS = 30.0


class CarrierVehicleMemory(CarrierMemory):
    """A carrier's memory.

    `duty`: a Duty as packed msgpack: a memory is small, and compared at each tick, part by part.
    """

    duty: bytes = b""


class Drop(Step, frozen=True):
    """Uncouple the bin, and remember it."""

    def act(self, robot: PlanExecutor) -> bool:
        """Return whether the vehicle has no bin any more."""
        if robot.seen.hitch is None:
            return True
        robot.memory.delivered = robot.seen.hitch.name
        robot.uncouple()
        return False


class HandOver(Step, frozen=True):
    """Leave the empty bin to the picker that has left the full one.

    The vehicle waits until the full bin, `bin`, has sent for a vehicle: this one, or one that
    stands behind it.
    """

    bin: str
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Return whether the full bin has sent for a vehicle. Then the empty one is delivered."""
        picker = cast(Driver, robot).calls.picker_of(self.bin)
        robot.action.waits_for = self.bin
        robot.hold()
        if picker:
            robot.next([Deliver(picker)])
        return bool(picker)


class UntilLeft(Step, frozen=True):
    """Stand before a lane until a full bin is left there, unless the order leads on.

    A vehicle that stays in the lane would shut the picker in.
    """

    station: str
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Return whether the vehicle may drive on."""
        driver = cast(CarrierDriver, robot)
        order = driver.duty.order
        if not driver.before(order.nodes):
            return True
        robot.action.waits_for = f"a full bin at {self.station}"
        robot.hold()
        seconds = (robot.seen.tick - robot.memory.since) * TIME_STEP
        if order.nodes[0].actions and seconds > SENT_FOR_SECONDS:
            order.queue = order.nodes[0].actions
            driver.fails(f"no full bin is left at {self.station} within {SENT_FOR_SECONDS:g} s")
        return False


class CarrierDriver(Driver):
    """A carrier at one tick."""

    def before(self, nodes: Sequence[Node]) -> Sequence[Step]:
        """Return what to wait for before a lane in which the vehicle will stay."""
        stop, *onward = nodes
        station = self.graph.station_of(stop.node_id)
        stays = bool(stop.actions) or not onward or not onward[0].released
        if not station or not stays or self.duty.is_away or self.calls.bin_at(station):
            return []
        return [UntilLeft(station)]

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        """Return the step of an action. Raises KeyError for one that carriers do not know."""
        steps = {
            PICK: TakeBin(action.load),
            DROP: Drop(),
            HAND_OVER: HandOver(action.load),
            UNLOAD: Unload(),
        }
        return [steps[action.action_type]]

    def why_not(self, action: ActionOrder) -> str:
        """Return why the vehicle cannot begin an action; '' if it can."""
        has_bin = self.seen.hitch is not None
        if action.action_type == PICK:
            return "it has a bin already" if has_bin else ""
        is_handed_over = action.action_type == HAND_OVER and self.memory.delivered
        return "" if has_bin or is_handed_over else "it has no bin"

    def finished(self, action: ActionOrder) -> None:
        """Note which bin is on the bar, and which one the vehicle has promised to take."""
        duty = self.duty
        if action.action_type == PICK:
            duty.is_laden = True
            duty.owes = ""
            self.memory.delivered = ""
        elif action.action_type in (DROP, UNLOAD):
            duty.is_laden = False
        elif action.action_type == HAND_OVER:
            duty.owes = action.load

    def why_late(self, action: ActionOrder, seconds: float) -> str:
        """Return why an action that has run for so long has failed; '' if it has not."""
        is_long = action.action_type == HAND_OVER and seconds > SENT_FOR_SECONDS
        if is_long and not self.calls.picker_of(action.load):
            return (
                f"{action.load} has not sent for a vehicle within {SENT_FOR_SECONDS:g} s:"
                " another carrier comes"
            )
        if action.action_type == UNLOAD:
            seconds -= self.machine.unloading_ticks * TIME_STEP
        return super().why_late(action, seconds)

    def after_failing(self, action: ActionOrder) -> Sequence[Step]:
        """Take back the empty bin that was left for a picker: it would be in the way of others."""
        is_dropped = self.seen.hitch is None and self.memory.delivered
        if action.action_type == HAND_OVER and is_dropped:
            return [TakeBin(self.memory.delivered)]
        return []

    def arrived(self, before: str) -> None:
        """Give back all places when the vehicle comes into the queue."""
        if not before.startswith(QUEUE):
            self.idles()

    def idles(self) -> None:
        """In the queue, keep no places.

        An edge that was given up may have left some, or has got them only now.
        """
        if self.duty.order.last_node.startswith(QUEUE):
            self.free(list(self.memory.reserved))


class CarrierVehicle(Vehicle):
    """A carrier as a vehicle of VDA 5050."""

    Memory: type[CarrierVehicleMemory] = CarrierVehicleMemory
    Steps = (Drop, HandOver, UntilLeft)
    drives_with = CarrierDriver
    holds = True

    def __init__(
        self, layout: Layout, name: str, *, graph: Graph, port: Port, calls: Calls, timing: Timing
    ) -> None:
        """`graph`: the roads as this kind drives them. `port`: the line to fleet control."""
        robot = Carrier(layout, name)
        super().__init__(robot, name, graph=graph, port=port, calls=calls, timing=timing)
        # The head of the line in which the carrier starts: carriers fill the lines one by one.
        self._home = graph.lines[(robot.number - 1) // layout.queue.places]
        self._before_each_drive = robot.route.may_fail(layout.scenario.carrying.failure)

    def answer(self, robot: Driver, heard: Heard) -> Answer:
        """Offer the vehicle to a bin that its order names, and agree with no other one."""
        body = heard.body
        order = robot.duty.order
        if isinstance(body, CarrierQuery):
            # It is never next of its line, so the dispatcher does not send it.
            job = next(order.loads(), "")
            return CarrierStatus(job, is_next=False, metres=0.0)
        if not isinstance(body, Call | Come):
            return No("a carrier knows nothing of that")
        if heard.sender not in order.loads():
            return No("fleet control orders otherwise")
        if isinstance(body, Call):
            # Nearer than any other offer, whatever the way is: fleet control has decided.
            return Offer(robot.pose.x, robot.pose.y, distance=0.0)
        return Yes()

    def is_home(self, robot: Driver) -> bool:
        """Whether a vehicle that clears the roads by itself stands in the queue."""
        order = robot.duty.order
        stands = order.is_idle or robot.seen.twist == STILL
        return order.last_node.startswith(QUEUE) and stands

    def is_held_up(self, robot: Driver) -> bool:
        """Whether the vehicle may stand on its way for ever.

        That is before a lane at which no bin is left, and at a stop with a bin right behind it: it
        cannot turn beside a picker.
        """
        return isinstance(robot.memory.plan[0], UntilLeft) or self._is_at_a_stop(robot)

    def _is_at_a_stop(self, robot: Driver) -> bool:
        """Whether the vehicle is in a lane, with its bin, and has not turned there."""
        hitch = robot.seen.hitch
        if hitch is None or abs(hitch.x - robot.pose.x) >= ON_A_NODE:
            return False
        return self.graph.station_of(robot.duty.order.last_node) != ""

    def is_out_of_the_way(self, robot: Driver) -> bool:
        """Whether the vehicle is in the queue: at a head, or behind another one."""
        last = robot.duty.order.last_node
        if not last.startswith(QUEUE):
            return False
        return last in self.graph.lines or something_ahead(robot.seen, [])

    def clear_the_roads(self, robot: Driver) -> None:
        """Drive to the queue, and with a full bin through the bay.

        A full bin that the vehicle has promised to take comes along. A picker that waits beside the
        vehicle gets its empty bin: with that one the vehicle could not turn there.
        """
        order = robot.duty.order
        promised = robot.duty.owes
        load = self._calls.bin_at(self.graph.station_of(order.last_node))
        if load and not robot.duty.phase and self._is_at_a_stop(robot):
            hand_over = ActionOrder(HAND_OVER, HAND_OVER, "HARD", [Parameter("loadId", load)])
            order.queue = [hand_over]
            promised = load
        if promised:
            self.add(order, self.graph.bins, PICK, promised)
        if promised or robot.duty.is_laden:
            self.add(order, [BAY], UNLOAD)
        self.add(order, [self._home])
