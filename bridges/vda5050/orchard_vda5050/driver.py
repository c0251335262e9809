"""What a vehicle has to do, and the steps with which it does it: those of the Orchard's own robots.

A node of its order becomes the steps of the edge to it, then those of the actions there. Only these
steps are in the plan; at their end the step `Onward` adds what the order has next. A kind of
vehicle derives a class, which knows its actions.
"""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, cast

import msgspec
from msgspec.structs import replace

from orchard import DriveTo, Mail, Observation, OneWay, PlanExecutor, Step
from orchard.field.scenario import TIME_STEP
from orchard.plans.steps import Need
from orchard.roads.actions import WITH_THE_BIN
from orchard.roads.graph import Graph
from orchard_vda5050.calls import Calls
from orchard_vda5050.errors import Error, Rejected
from orchard_vda5050.order_state import ActionState, OrderState, arrive
from orchard_vda5050.received import ActionOrder, Edge, Node

# After these seconds an action that is not done has failed.
ACTION_SECONDS = 300.0
# So many metres before a node a vehicle asks for the places of the next edge, so that it need not
# stop.
ASK_AHEAD = 3.0


class Duty(msgspec.Struct):
    """What a vehicle has to do, and how far it is.

    `phase`: 'edge' while the vehicle drives an edge, 'action' while it does an action, '' between
    two of them. `began`: tick at which the newest action began. `instant`: how far instant actions
    are. `errors`: those of instant actions; those of orders are in `order`.

    `is_halted`: by an action that has failed. `is_laden`: the bin on its bar is a full one. `fill`:
    m of row in a picker's bin when it was weighed. `owes`: the full bin that a carrier has promised
    to take along, for which it has left its empty bin; '' for none.

    `is_away`: it clears the roads by itself, without orders. `idle_since`: tick since which it has
    stood on the roads with nothing to do; -1: it has something to do, or is out of the way.
    """

    order: OrderState = msgspec.field(default_factory=OrderState)
    phase: str = ""
    began: int = 0
    instant: list[ActionState] = []
    errors: list[Error] = []
    is_paused: bool = False
    is_halted: bool = False
    is_laden: bool = False
    fill: float = 0.0
    owes: str = ""
    is_away: bool = False
    idle_since: int = -1


class Onward(Step, frozen=True):
    """The end of the plan: what the order has next."""

    keeps_course: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        """Add the steps of what the order has next. Return whether there is anything."""
        return cast(Driver, robot).goes_on()


class Driver(PlanExecutor):
    """A vehicle at one tick: it turns its order into steps."""

    def __init__(
        self,
        seen: Observation,
        mail: Mail,
        memory: Any,
        *,
        duty: Duty,
        robot: Any,
        graph: Graph,
        calls: Calls,
        before_each_drive: Sequence[Step],
    ) -> None:
        """`robot`: the Orchard's own agent of this kind. `before_each_drive`: steps that go before
        each drive on the roads, in which a robot may fail.
        """
        super().__init__(seen, mail, memory, robot.machine, robot.bystanders)
        self.route: OneWay = robot.route
        self.duty = duty
        self.graph = graph
        self.calls = calls
        self._before_each_drive = before_each_drive

    # -- what a kind of vehicle knows

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        """Return the steps of an action at the last node.

        Raises KeyError for one that this kind does not know.
        """
        raise NotImplementedError

    def why_not(self, action: ActionOrder) -> str:
        """Return why the vehicle cannot begin an action; '' if it can."""
        return ""

    def before(self, nodes: Sequence[Node]) -> Sequence[Step]:
        """Return the steps before the edge to the first of the nodes that lie ahead."""
        return ()

    def why_not_drive(self) -> str:
        """Return why the vehicle cannot leave the last node; '' if it can."""
        return ""

    def finished(self, action: ActionOrder) -> None:
        """Note what a finished action has changed."""

    def why_late(self, action: ActionOrder, seconds: float) -> str:
        """Return why an action that has run for so long has failed; '' if it has not."""
        return f"not done within {ACTION_SECONDS:g} s" if seconds > ACTION_SECONDS else ""

    def after_failing(self, action: ActionOrder) -> Sequence[Step]:
        """Return what must still be done when an action has failed."""
        return ()

    def arrived(self, before: str) -> None:
        """Note that the vehicle has come to the last node from the one `before`."""

    def idles(self) -> None:
        """Called while the vehicle has nothing to do."""

    # -- its order

    def goes_on(self) -> bool:
        """Note what is finished, and add the steps of what is next.

        Return False if there is nothing.
        """
        self._finish_phase()
        duty = self.duty
        order = duty.order
        if order.queue and not duty.is_halted:
            return self._begin(order.queue[0])
        if order.may_leave and not (duty.is_paused or duty.is_halted):
            return self._leave(order.nodes[0], order.edges[0])
        self.hold()
        self.idles()
        self.memory.doing = "waiting for an order"
        self.memory.state = "waiting"
        return False

    def _finish_phase(self) -> None:
        """Note that the edge, or the action, that is under way is done."""
        duty = self.duty
        order = duty.order
        if duty.phase == "edge":
            for action in order.edges[0].actions:
                order.set(action.action_id, "FINISHED")
            before = order.last_node
            arrive(order)
            self.arrived(before)
        elif duty.phase == "action":
            action = order.queue.pop(0)
            order.set(action.action_id, "FINISHED")
            self.finished(action)
        duty.phase = ""

    def _leave(self, node: Node, edge: Edge) -> bool:
        """Add the steps of an edge. Return whether the vehicle can drive it."""
        why = self.why_not_drive()
        if why:
            names = {"nodeId": node.node_id}
            self._halt(Rejected("NODE_UNREACHABLE", why, names, "CRITICAL").error)
            return False
        self.duty.phase = "edge"
        for action in edge.actions:
            self.duty.order.set(action.action_id, "RUNNING")
        self.next([*self.before(self.duty.order.nodes), *self._steps_to(node, edge), Onward()])
        return True

    def _steps_to(self, node: Node, edge: Edge) -> Iterator[Step]:
        """Yield the steps of an edge. A node may follow itself, without any step."""
        self.memory.doing = f"driving to {node.node_id}"
        self.memory.state = "hauling" if self.duty.is_laden else "driving"
        for step in self._steps_from(self.duty.order.last_node, node.node_id):
            if not isinstance(step, DriveTo):
                yield step
                continue
            if not step.queueing:
                yield from self._before_each_drive
            if edge.speed is not None and edge.speed < step.speed_of(self.machine):
                yield replace(step, speed=edge.speed)
            else:
                yield step

    def _steps_from(self, start: str, end: str) -> Sequence[Step]:
        """Return the steps between two nodes, without any if the second one is the first one."""
        edge = self.graph.edges.get((start, end))
        return () if edge is None else edge.steps

    def _begin(self, action: ActionOrder) -> bool:
        """Add the steps of an action. Return whether the vehicle can do it."""
        self.duty.phase = "action"
        self.duty.began = self.seen.tick
        self.memory.doing = f"{action.action_type} {action.load}".strip()
        self.memory.state = "handling a bin"
        self.duty.order.set(action.action_id, "RUNNING")
        why = self.why_not(action) or self._why_not_this_bin(action)
        if why:
            self.fails(why)
            return False
        self.next([*self.steps_of(action), Onward()])
        return True

    def _why_not_this_bin(self, action: ActionOrder) -> str:
        """Return why an action with the bin on the bar cannot be done; '' if it can."""
        hitch = self.seen.hitch
        if hitch is None or action.action_type not in WITH_THE_BIN:
            return ""
        if action.load in ("", hitch.name):
            return ""
        return f"its bin is {hitch.name}, not {action.load}"

    def leave_edge(self) -> None:
        """Give back the places that the present edge needs at its beginning.

        To be called for a vehicle that stands at the beginning of the edge.
        """
        order = self.duty.order
        for step in self._steps_from(order.last_node, order.nodes[0].node_id):
            if isinstance(step, Need):
                self.free(step.places)
            elif isinstance(step, DriveTo):
                self.free([place for gate in step.needs for place in gate.places])

    def why_failed(self) -> str:
        """Return why the present action has taken too long; '' if it has not."""
        seconds = (self.seen.tick - self.duty.began) * TIME_STEP
        return self.why_late(self.duty.order.queue[0], seconds)

    def fails(self, why: str) -> None:
        """Note that the present action has failed.

        The vehicle stands until fleet control cancels the order.
        """
        action = self.duty.order.queue.pop(0)
        self.duty.order.set(action.action_id, "FAILED")
        self.duty.owes = ""
        self.memory.plan = [*self.after_failing(action), Onward()]
        self._halt(Rejected("ACTION_FAILED", why, {"actionId": action.action_id}, "CRITICAL").error)

    def _halt(self, error: Error) -> None:
        """Stand until fleet control cancels the order."""
        self.duty.phase = ""
        self.duty.is_halted = True
        self.duty.order.errors = [*self.duty.order.errors, error]

    def ask_ahead(self) -> None:
        """Shortly before a node, ask for the places that the next edge needs at its beginning."""
        order = self.duty.order
        if self.duty.phase != "edge" or self.wanting or not self._drives_through(order):
            return
        first, second, *_ = order.nodes
        if self.before(order.nodes[1:]):
            return
        steps = self._steps_from(first.node_id, second.node_id)
        drive = steps[0] if steps else None
        if not isinstance(drive, DriveTo) or not drive.needs:
            return
        node = self.graph.nodes[first.node_id]
        is_near = abs(node.x - self.pose.x) + abs(node.y - self.pose.y) < ASK_AHEAD
        places = drive.needs[0].places
        if is_near and not self.has(places):
            self.want(places)

    @staticmethod
    def _drives_through(order: OrderState) -> bool:
        """Whether the vehicle passes the next node without a stop there."""
        if len(order.nodes) < 2:
            return False
        return not order.nodes[0].actions and order.nodes[1].released
