"""What a vehicle has to do, and the steps with which it does it: those of the Orchard's own carriers.

A node of its order becomes the steps of the edge to it, then those of the actions there. Only these steps are in the plan; at their end the
step `Onward` adds what the order has next.
"""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, cast

import msgspec
from msgspec.structs import replace

from orchard import CarrierMemory, DriveTo, Mail, Observation, PlanExecutor, Step
from orchard.agents.steps import Deliver, Need, TakeBin, Unload
from orchard.field.scenario import TIME_STEP
from orchard_vda5050 import order as orders
from orchard_vda5050.actions import DROP, HAND_OVER, PICK, UNLOAD
from orchard_vda5050.calls import Calls
from orchard_vda5050.graph import QUEUE, Graph
from orchard_vda5050.order import ActionOrder, ActionState, Edge, Error, Node, OrderState, Rejected

ACTION_SECONDS = 300.0  # after which an action that is not done has failed
SENT_FOR_SECONDS = 30.0  # after which handing over has failed, if the full bin has not sent for the vehicle: another carrier comes
ASK_AHEAD = 3.0  # m before a node at which it asks for the places of the next edge: so it need not stop


class Duty(msgspec.Struct):
    """What a vehicle has to do, and how far it is. `phase`: 'edge' or 'action' while it is under way, '' between two."""

    order: OrderState = msgspec.field(default_factory=OrderState)
    phase: str = ""
    began: int = 0  # tick at which the newest action began
    instant: list[ActionState] = []
    errors: list[Error] = []  # beside those of orders
    is_paused: bool = False
    is_halted: bool = False  # by an action that has failed
    is_laden: bool = False  # the bin on its bar is a full one
    owes: str = ""  # the full bin that it has promised to take along: it has left its empty bin for it
    is_away: bool = False  # it drives to the queue by itself
    idle_since: int = -1  # tick since which nothing is released on the roads; -1: it has something to do, or stands off the roads


class VehicleMemory(CarrierMemory):
    """A carrier's memory. `duty`: a Duty as packed msgpack: a memory is small, and compared at each tick, part by part."""

    duty: bytes = b""


class Onward(Step, frozen=True):
    """The end of the plan: what the order has next."""

    keeps_course: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        return cast(Driver, robot).goes_on()


class Drop(Step, frozen=True):
    """Uncouple the bin, and remember it."""

    def act(self, robot: PlanExecutor) -> bool:
        if robot.seen.hitch is None:
            return True
        robot.memory.delivered = robot.seen.hitch.name
        robot.uncouple()
        return False


class HandOver(Step, frozen=True):
    """Leave the empty bin to the picker that has left the full one, once that bin has sent for a vehicle: this one, or one behind it."""

    bin: str
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        picker = cast(Driver, robot).calls.picker_of(self.bin)
        robot.action.waits_for = self.bin
        robot.hold()
        if picker:
            robot.next([Deliver(picker)])
        return bool(picker)


class Driver(PlanExecutor):
    """A vehicle at one tick: it turns its order into steps."""

    def __init__(
        self,
        seen: Observation,
        mail: Mail,
        memory: VehicleMemory,
        duty: Duty,
        bystanders: Any,
        graph: Graph,
        calls: Calls,
        before: Sequence[Step],
    ) -> None:
        """`before`: the steps before each drive."""
        super().__init__(seen, mail, memory, bystanders)
        self.duty, self.graph, self.calls, self._before = duty, graph, calls, before

    def goes_on(self) -> bool:
        """Note what is finished, and add the steps of what is next. Return False if there is nothing."""
        duty, order = self.duty, self.duty.order
        if duty.phase == "edge":
            was_out = not order.last_node.startswith(QUEUE)
            orders.arrive(order)
            if was_out:
                self._free_in_queue()
        elif duty.phase == "action":
            self._finish(order.queue.pop(0))
        duty.phase = ""
        if order.queue and not duty.is_halted:
            return self._begin(order.queue[0])
        if order.nodes and order.nodes[0].released and not (duty.is_paused or duty.is_halted):
            duty.phase = "edge"
            self.next([*self._steps_to(order.nodes[0], order.edges[0]), Onward()])
            return True
        self.hold()
        self._free_in_queue()
        self.memory.doing, self.memory.state = "waiting for an order", "waiting"
        return False

    def _free_in_queue(self) -> None:
        """In the queue keep no places: an edge that was given up may have left some, or has got them only now."""
        if self.duty.order.last_node.startswith(QUEUE):
            self.free(list(self.memory.reserved))

    def _steps_to(self, node: Node, edge: Edge) -> Iterator[Step]:
        """The steps of an edge. A node may follow itself."""
        self.memory.doing, self.memory.state = f"driving to {node.node_id}", "hauling" if self.duty.is_laden else "driving"
        known = self.graph.edges.get((self.duty.order.last_node, node.node_id))
        for step in known.steps if known else ():
            if isinstance(step, DriveTo) and not step.queueing:
                yield from self._before
            slower = edge.speed is not None and isinstance(step, DriveTo) and edge.speed < step.speed
            yield replace(step, speed=edge.speed) if slower else step

    def _begin(self, action: ActionOrder) -> bool:
        kind, load = action.action_type, str(action.value("loadId") or "")
        self.duty.phase, self.duty.began = "action", self.seen.tick
        self.memory.doing, self.memory.state = f"{kind} {load}".strip(), "handling a bin"
        self.duty.order.set(action.action_id, "RUNNING")
        if why := self._why_not(kind):
            self.fails(why)
            return False
        steps: dict[str, list[Step]] = {PICK: [TakeBin(load)], DROP: [Drop()], HAND_OVER: [HandOver(load)], UNLOAD: [Unload()]}
        self.next([*steps[kind], Onward()])
        return True

    def _why_not(self, kind: str) -> str:
        has_bin = self.seen.hitch is not None
        if kind == PICK:
            return "it has a bin already" if has_bin else ""
        if kind == HAND_OVER:
            return "" if has_bin or self.memory.delivered else "it has no bin"
        return "" if has_bin else "it has no bin"

    def _finish(self, action: ActionOrder) -> None:
        duty = self.duty
        duty.order.set(action.action_id, "FINISHED")
        duty.is_laden = action.action_type == PICK or (duty.is_laden and action.action_type not in (UNLOAD, DROP))
        if action.action_type == HAND_OVER:
            duty.owes = str(action.value("loadId"))
        if action.action_type == PICK:
            self.memory.delivered, duty.owes = "", ""

    def leave_edge(self) -> None:
        """Give back the places that the present edge needs at its beginning, which the vehicle has not left."""
        order = self.duty.order
        edge = self.graph.edges.get((order.last_node, order.nodes[0].node_id))
        for step in edge.steps if edge else ():
            if isinstance(step, Need):
                self.free(step.places)
            elif isinstance(step, DriveTo):
                self.free([place for gate in step.needs for place in gate.places])

    def why_failed(self) -> str:
        """Why the present action has taken too long; '' if it has not."""
        action, seconds = self.duty.order.queue[0], (self.seen.tick - self.duty.began) * TIME_STEP
        if action.action_type == HAND_OVER and seconds > SENT_FOR_SECONDS and not self.calls.picker_of(str(action.value("loadId"))):
            return f"{action.value('loadId')} has not sent for a vehicle within {SENT_FOR_SECONDS:g} s: another carrier comes"
        return f"not done within {ACTION_SECONDS:g} s" if seconds > ACTION_SECONDS else ""

    def fails(self, why: str) -> None:
        """The present action has failed. The vehicle stands until fleet control cancels the order."""
        duty, action = self.duty, self.duty.order.queue.pop(0)
        duty.order.set(action.action_id, "FAILED")
        duty.order.errors = [*duty.order.errors, Rejected("ACTION_FAILED", why, {"actionId": action.action_id}, "CRITICAL").error]
        is_left = (
            action.action_type == HAND_OVER and self.seen.hitch is None and self.memory.delivered
        )  # its empty bin is: it would stand in the way of others
        retake = [TakeBin(self.memory.delivered)] if is_left else []
        duty.phase, duty.is_halted, self.memory.plan, duty.owes = "", True, [*retake, Onward()], ""

    def ask_ahead(self) -> None:
        """Shortly before a node, ask for the places that the next edge needs at its beginning."""
        order = self.duty.order
        if self.duty.phase != "edge" or self.wanting or len(order.nodes) < 2 or order.nodes[0].actions or not order.nodes[1].released:
            return
        node = self.graph.nodes[order.nodes[0].node_id]
        after = self.graph.edges.get((order.nodes[0].node_id, order.nodes[1].node_id))
        drive = after.steps[0] if after else None
        if isinstance(drive, DriveTo) and drive.needs and abs(node.x - self.pose.x) + abs(node.y - self.pose.y) < ASK_AHEAD:
            places = drive.needs[0].places
            if not self.has(places):
                self.want(places)
