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
from orchard_vda5050 import order as orders
from orchard_vda5050.calls import Calls
from orchard_vda5050.order import ActionOrder, ActionState, Edge, Error, Node, OrderState, Rejected

ACTION_SECONDS = 300.0  # after which an action that is not done has failed
ASK_AHEAD = (
    3.0  # m before a node at which it asks for the places of the next edge: so it need not stop
)


class Duty(msgspec.Struct):
    """What a vehicle has to do, and how far it is.

    `phase`: 'edge' or 'action' while it is under way, '' between two.
    """

    order: OrderState = msgspec.field(default_factory=OrderState)
    phase: str = ""
    began: int = 0  # tick at which the newest action began
    instant: list[ActionState] = []
    errors: list[Error] = []  # beside those of orders
    is_paused: bool = False
    is_halted: bool = False  # by an action that has failed
    is_laden: bool = False  # the bin on its bar is a full one
    fill: float = 0.0  # m of row in a picker's bin when it was weighed
    # The full bin that a carrier has promised to take along: it has left its empty bin for it.
    owes: str = ""
    is_away: bool = False  # it clears the roads by itself
    # Tick since which nothing is released on the roads; -1: it has something to do, or is out of
    # the way.
    idle_since: int = -1


class Onward(Step, frozen=True):
    """The end of the plan: what the order has next."""

    keeps_course: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    def act(self, robot: PlanExecutor) -> bool:
        return cast(Driver, robot).goes_on()


class Driver(PlanExecutor):
    """A vehicle at one tick: it turns its order into steps."""

    def __init__(
        self,
        seen: Observation,
        mail: Mail,
        memory: Any,
        duty: Duty,
        robot: Any,
        graph: Graph,
        calls: Calls,
        before: Sequence[Step],
    ) -> None:
        """`robot`: the Orchard's own agent of this kind; `before`: the steps before each drive."""
        super().__init__(seen, mail, memory, robot.bystanders)
        self.route: OneWay = robot.route
        self.duty, self.graph, self.calls, self._before = duty, graph, calls, before

    # -- what a kind of vehicle knows

    def steps_of(self, action: ActionOrder) -> Sequence[Step]:
        """Return the steps of an action at the last node.

        Raises KeyError for one that this kind does not know.
        """
        raise NotImplementedError

    def why_not(self, action: ActionOrder) -> str:
        """Why the vehicle cannot begin an action; '' if it can."""
        return ""

    def before(self, nodes: Sequence[Node]) -> Sequence[Step]:
        """Return the steps before the edge to the first of the nodes that lie ahead."""
        return ()

    def why_not_drive(self) -> str:
        """Why the vehicle cannot leave the last node; '' if it can."""
        return ""

    def finished(self, action: ActionOrder) -> None:
        """Note what a finished action has changed."""

    def is_late(self, action: ActionOrder, seconds: float) -> str:
        """Why an action that has run for so long has failed; '' if it has not."""
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
        duty, order = self.duty, self.duty.order
        if duty.phase == "edge":
            for action in order.edges[0].actions:
                order.set(action.action_id, "FINISHED")
            before = order.last_node
            orders.arrive(order)
            self.arrived(before)
        elif duty.phase == "action":
            action = order.queue.pop(0)
            order.set(action.action_id, "FINISHED")
            self.finished(action)
        duty.phase = ""
        if order.queue and not duty.is_halted:
            return self._begin(order.queue[0])
        if order.nodes and order.nodes[0].released and not (duty.is_paused or duty.is_halted):
            return self._leave(order.nodes[0], order.edges[0])
        self.hold()
        self.idles()
        self.memory.doing, self.memory.state = "waiting for an order", "waiting"
        return False

    def _leave(self, node: Node, edge: Edge) -> bool:
        if why := self.why_not_drive():
            self._halt(
                Rejected("NODE_UNREACHABLE", why, {"nodeId": node.node_id}, "CRITICAL").error
            )
            return False
        self.duty.phase = "edge"
        for action in edge.actions:
            self.duty.order.set(action.action_id, "RUNNING")
        self.next([*self.before(self.duty.order.nodes), *self._steps_to(node, edge), Onward()])
        return True

    def _steps_to(self, node: Node, edge: Edge) -> Iterator[Step]:
        """The steps of an edge. A node may follow itself."""
        self.memory.doing, self.memory.state = (
            f"driving to {node.node_id}",
            "hauling" if self.duty.is_laden else "driving",
        )
        known = self.graph.edges.get((self.duty.order.last_node, node.node_id))
        for step in known.steps if known else ():
            if isinstance(step, DriveTo) and not step.queueing:
                yield from self._before
            slower = (
                edge.speed is not None and isinstance(step, DriveTo) and edge.speed < step.speed
            )
            yield replace(step, speed=edge.speed) if slower else step

    def _begin(self, action: ActionOrder) -> bool:
        kind, load = action.action_type, str(action.value("loadId") or "")
        self.duty.phase, self.duty.began = "action", self.seen.tick
        self.memory.doing, self.memory.state = f"{kind} {load}".strip(), "handling a bin"
        self.duty.order.set(action.action_id, "RUNNING")
        if why := self.why_not(action) or self._why_not_this_bin(load, action.action_type):
            self.fails(why)
            return False
        self.next([*self.steps_of(action), Onward()])
        return True

    def _why_not_this_bin(self, load: str, kind: str) -> str:
        """Why an action with the bin on the bar cannot be done; '' if it can."""
        hitch = self.seen.hitch
        if hitch is None or kind not in WITH_THE_BIN or load in ("", hitch.name):
            return ""
        return f"its bin is {hitch.name}, not {load}"

    def leave_edge(self) -> None:
        """Give back the places that the present edge needs at its beginning, which the vehicle has
        not left.
        """
        order = self.duty.order
        edge = self.graph.edges.get((order.last_node, order.nodes[0].node_id))
        for step in edge.steps if edge else ():
            if isinstance(step, Need):
                self.free(step.places)
            elif isinstance(step, DriveTo):
                self.free([place for gate in step.needs for place in gate.places])

    def why_failed(self) -> str:
        """Why the present action has taken too long; '' if it has not."""
        return self.is_late(
            self.duty.order.queue[0], (self.seen.tick - self.duty.began) * TIME_STEP
        )

    def fails(self, why: str) -> None:
        """The present action has failed.

        The vehicle stands until fleet control cancels the order.
        """
        action = self.duty.order.queue.pop(0)
        self.duty.order.set(action.action_id, "FAILED")
        self.duty.owes, self.memory.plan = "", [*self.after_failing(action), Onward()]
        self._halt(Rejected("ACTION_FAILED", why, {"actionId": action.action_id}, "CRITICAL").error)

    def _halt(self, error: Error) -> None:
        self.duty.phase, self.duty.is_halted = "", True
        self.duty.order.errors = [*self.duty.order.errors, error]

    def ask_ahead(self) -> None:
        """Shortly before a node, ask for the places that the next edge needs at its beginning."""
        order = self.duty.order
        if (
            self.duty.phase != "edge"
            or self.wanting
            or len(order.nodes) < 2
            or order.nodes[0].actions
            or not order.nodes[1].released
        ):
            return
        if self.before(order.nodes[1:]):
            return
        node = self.graph.nodes[order.nodes[0].node_id]
        after = self.graph.edges.get((order.nodes[0].node_id, order.nodes[1].node_id))
        drive = after.steps[0] if after else None
        if (
            isinstance(drive, DriveTo)
            and drive.needs
            and abs(node.x - self.pose.x) + abs(node.y - self.pose.y) < ASK_AHEAD
        ):
            places = drive.needs[0].places
            if not self.has(places):
                self.want(places)
