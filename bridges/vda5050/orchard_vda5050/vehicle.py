"""A robot that does what fleet control orders: an agent of the Orchard whose plan is an order of
VDA 5050.

At each tick it takes the messages that have come, follows its order, and says how far it is. It
drives with the steps of the Orchard's own robots, so it takes turns on the roads with them and
stops for obstacles. Its memory holds its order: another process can go on with it.
"""

import zlib
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import msgspec
from msgspec.structs import replace

from orchard import Action, Carrier, Heard, Mail, Observation, Picker, Step, with_steps
from orchard.contract.agent import LARGEST_MEMORY
from orchard.contract.messages import Answer
from orchard.field.geometry import STILL
from orchard.field.scenario import TIME_STEP
from orchard.roads.actions import INSTANT
from orchard.roads.graph import Graph
from orchard.roads.lif import edge_id
from orchard_vda5050 import order as orders
from orchard_vda5050.calls import Calls
from orchard_vda5050.driver import Driver, Duty, Onward
from orchard_vda5050.messages import Message, Status, factsheet_of, state_of, visualization_of
from orchard_vda5050.order import (
    ActionOrder,
    ActionState,
    Edge,
    Node,
    OrderState,
    Parameter,
    Rejected,
)

ON_A_NODE = 0.05  # m
MOST_INSTANT = 50  # instant actions that it remembers
# The error of an order that comes while it clears the roads by itself.
NOT_AVAILABLE = "MOBILE_ROBOT_NOT_AVAILABLE"
MOST_BYTES = LARGEST_MEMORY // 2  # of an order in its memory


def _packed(data: Any) -> bytes:
    return zlib.compress(msgspec.msgpack.encode(data), level=1)


class Port(Protocol):
    """The vehicle's side of the line to fleet control."""

    def take(self) -> list[tuple[str, bytes]]:
        """Return the messages that have come since the last tick: topic and payload."""

    def send(self, topic: str, message: Message) -> None:
        """Send a message."""

    @property
    def state_header_id(self) -> int:
        """The headerId of the newest state."""


class Timing(msgspec.Struct, frozen=True):
    """In seconds of simulated time: between two states; between two visualizations, 0 for none;
    until a vehicle that is left standing on the roads drives to the queue by itself.
    """

    state: float = 1.0
    visualization: float = 0.0
    patience: float = 300.0


class Vehicle:
    """A robot as a vehicle of VDA 5050.

    Each kind derives a class, which says `holds = True`: it is asked when it has something to do.
    """

    Memory: type[Any]  #: that of the kind's agent, with the field `duty`, a packed Duty
    Steps: ClassVar[Sequence[type[Step]]]  #: of the kind, beside those of its route
    drives_with: ClassVar[type[Driver]]

    def __init__(
        self,
        robot: Carrier | Picker,
        name: str,
        graph: Graph,
        port: Port,
        calls: Calls,
        timing: Timing,
    ) -> None:
        """`robot`: the Orchard's own agent of this kind."""
        self.Memory = with_steps(type(self).Memory, (Onward, *self.Steps, *robot.route.Steps))
        self.robot, self.name, self.graph, self.timing = robot, name, graph, timing
        self._before: Sequence[Step] = ()
        self._port, self._calls = port, calls
        self._sent, self._shown = -1.0, -1.0  # s at which a state and a visualization were sent
        self._news: object = None  # what was new in the newest state
        self._charge = 1.0  # at the tick before
        self._known = b"", Duty()  # the newest duty, as the memory has it, and as it is
        self._plain = b""  # the same as msgpack
        self._bins = frozenset(
            start.name for start in robot.route.layout.starts if start.kind == "bin"
        )

    def tick(self, seen: Observation, mail: Mail, memory: Any) -> Action:
        memory = memory or self.Memory(plan=[Onward()])
        duty = self._duty_in(memory, seen)
        robot = self.drives_with(
            seen, mail, memory, duty, self.robot, self.graph, self._calls, self._before
        )
        self._calls.hear(mail.requests, seen.tick)
        self._calls.promise(self.name, duty.owes)
        for topic, payload in self._port.take():
            self._obey(robot, topic, payload)
        robot.action.answers = [(heard, self.answer(robot, heard)) for heard in mail.requests]
        if duty.phase == "action" and (why := robot.why_failed()):
            robot.fails(why)
        self._mind(robot)
        if seen.charge > 0.0 and not (duty.is_paused and duty.phase == "edge"):
            robot.follow()
            robot.ask_ahead()
        self._close_cancelling(duty)
        action = robot.finish()
        until = seen.tick + max(1, round(self.timing.state / TIME_STEP))
        action.hold = action.hold and replace(action.hold, until=min(action.hold.until, until))
        self._keep(memory, duty)
        self._report(robot, action)
        return action

    def _duty_in(self, memory: Any, seen: Observation) -> Duty:
        """Return the duty in a memory, which is read only if it is not the one that this vehicle
        wrote last.
        """
        (written, duty), self._known = (
            self._known,
            (b"", Duty()),
        )  # an error in this tick may leave it half changed
        if memory.duty and memory.duty != written:
            return msgspec.msgpack.decode(zlib.decompress(memory.duty), type=Duty)
        return duty if memory.duty else Duty(OrderState(last_node=self.graph.at(seen.x, seen.y)))

    def _keep(self, memory: Any, duty: Duty) -> None:
        """Write the duty into the memory if it has changed."""
        if (plain := msgspec.msgpack.encode(duty)) != self._plain or not memory.duty:
            self._plain, memory.duty = plain, _packed(duty)
        self._known = memory.duty, duty

    # -- what a kind of vehicle knows

    def answer(self, robot: Any, heard: Heard) -> Answer:
        """Answer a request of another agent."""
        raise NotImplementedError

    def is_home(self, robot: Any) -> bool:
        """Whether a vehicle that clears the roads by itself has done so."""
        raise NotImplementedError

    def is_held_up(self, robot: Any) -> bool:
        """Whether a vehicle that stands on its way may do so for ever, though fleet control orders
        it on.
        """
        return False

    def is_out_of_the_way(self, robot: Any) -> bool:
        """Whether a vehicle that stands holds up no other one."""
        raise NotImplementedError

    def clear_the_roads(self, robot: Any) -> None:
        """Order the vehicle out of the way of others: its order is given up."""
        raise NotImplementedError

    # -- what fleet control wants

    def _obey(self, robot: Driver, topic: str, payload: bytes) -> None:
        duty = robot.duty
        try:
            if topic == "order":
                order = orders.read(payload)
                self._check_addressee(order)
                if duty.is_away:
                    raise Rejected(
                        NOT_AVAILABLE,
                        "it drives to the queue by itself",
                        {"orderId": order.order_id},
                    )
                taken = orders.take(
                    duty.order, order, self.graph, self._bins, robot.pose.x, robot.pose.y
                )
                if len(_packed(taken)) > MOST_BYTES:
                    raise Rejected(
                        "INSUFFICIENT_MEMORY",
                        "the order is too long",
                        {"orderId": order.order_id},
                        "URGENT",
                    )
                duty.is_halted = duty.is_halted and taken.order_id == duty.order.order_id
                duty.order = taken
            else:
                for action in self._instant(payload):
                    self._obey_at_once(robot, action)
        except Rejected as rejected:
            self._tell(duty, rejected)
        except (ValueError, RecursionError) as error:
            duty.errors = [
                Rejected("VALIDATION_FAILURE", f"not an instant action: {error}", {}).error
            ]
        self._news = None

    def _check_addressee(self, message: orders.Header) -> None:
        if message.serial_number != self.name:
            raise Rejected(
                "VALIDATION_FAILURE",
                f"it is for {message.serial_number}, and this is {self.name}",
                {},
            )

    def _instant(self, payload: bytes) -> list[ActionOrder]:
        """Return the instant actions in a payload.

        Raises ValueError if it is malformed, Rejected if it is for another one.
        """
        message = orders.read_instant_actions(payload)
        self._check_addressee(message)
        return message.actions

    def _tell(self, duty: Duty, rejected: Rejected) -> None:
        """Keep an error until a new order is taken; of each kind the newest."""
        duty.order.errors = [
            *(e for e in duty.order.errors if e.error_type != rejected.error.error_type),
            rejected.error,
        ]

    def _obey_at_once(self, robot: Driver, action: ActionOrder) -> None:
        duty = robot.duty
        state = ActionState(action.action_id, action.action_type, "FINISHED")
        is_known = any(
            (one.action_id, one.action_type) == (action.action_id, action.action_type)
            for one in duty.instant
        )
        # The second copy of a message must not cancel again: the first one may have done it.
        if is_known and action.action_type == "cancelOrder":
            return
        if action.action_type in INSTANT:
            duty.errors = []
        match action.action_type:
            case "startPause" | "stopPause":
                duty.is_paused = action.action_type == "startPause"
            case "cancelOrder":
                state.action_status = self._cancel(robot, action)
            case "factsheetRequest":
                self._port.send("factsheet", factsheet_of(self.graph.kind, self.timing.state))
            case "clearInstantActions":
                duty.instant = [one for one in duty.instant if one.action_status == "RUNNING"]
            case "stateRequest":
                pass  # a state is sent after each message
            case _:
                state.action_status = "FAILED"
                why = f"no instant action {action.action_type}; there are {', '.join(INSTANT)}"
                duty.errors = [
                    Rejected("INVALID_INSTANT_ACTION", why, {"actionId": action.action_id}).error
                ]
        others = [one for one in duty.instant if one.action_id != action.action_id]
        duty.instant = [*others, state][-MOST_INSTANT:]
        while len(_packed(duty.instant)) > MOST_BYTES // 2:
            del duty.instant[0]

    def _cancel(self, robot: Driver, action: ActionOrder) -> orders.Status:
        duty, wanted = robot.duty, action.value("orderId")
        if duty.order.is_idle or duty.is_away or wanted not in (None, duty.order.order_id):
            self._tell(
                duty,
                Rejected(
                    "NO_ORDER_TO_CANCEL", "no such order is active", {"actionId": action.action_id}
                ),
            )
            return "FAILED"
        self._give_up(robot)
        return "RUNNING"

    def _give_up(self, robot: Driver) -> None:
        """Give up the order at the next node; a vehicle that has not left the last one yet stays
        there.
        """
        duty, last = robot.duty, self.graph.nodes.get(robot.duty.order.last_node)
        is_there = (
            last is not None and abs(last.x - robot.pose.x) + abs(last.y - robot.pose.y) < ON_A_NODE
        )
        if duty.phase == "edge" and not is_there:
            orders.cancel(duty.order, is_driving=True)
        elif duty.phase == "action":
            orders.cancel(duty.order, is_driving=False)
        else:
            self._stop(robot)
        duty.is_halted = False

    def _close_cancelling(self, duty: Duty) -> None:
        for state in duty.instant:
            if state.action_status == "RUNNING" and duty.order.is_idle and not duty.phase:
                state.action_status = "FINISHED"

    # -- a vehicle that is left alone

    def _mind(self, robot: Driver) -> None:
        """A vehicle that is left standing on the roads would jam all others: it clears them by
        itself.
        """
        duty, order = robot.duty, robot.duty.order
        if duty.is_away and self.is_home(robot):
            self._stop(robot)
            duty.is_away = False
            order.errors = [error for error in order.errors if error.error_type != NOT_AVAILABLE]
        is_stuck = (
            duty.phase == "edge"
            and robot.seen.twist == STILL
            and (duty.is_away or self.is_held_up(robot))
        )
        may_go = not is_stuck and bool(
            duty.phase or order.queue or (order.nodes and order.nodes[0].released)
        )
        if (
            (may_go and not duty.is_paused and not duty.is_halted)
            or not order.last_node
            or self.is_out_of_the_way(robot)
        ):
            duty.idle_since = -1
            return
        duty.idle_since = robot.seen.tick if duty.idle_since < 0 else duty.idle_since
        if (robot.seen.tick - duty.idle_since) * TIME_STEP >= self.timing.patience:
            self._give_up(robot)
            duty.is_paused, duty.is_away, duty.idle_since = False, True, -1
            self.clear_the_roads(robot)

    def _stop(self, robot: Driver) -> None:
        """Give up the order where the vehicle stands."""
        if robot.duty.phase == "edge":
            robot.leave_edge()
        robot.duty.phase, robot.memory.plan, robot.memory.course = "", [Onward()], None
        orders.cancel(robot.duty.order, is_driving=False)

    def add(self, order: OrderState, ends: Sequence[str], kind: str = "", load: str = "") -> None:
        """Add the way from the end of the base to the nearest of some nodes, and an action
        there.
        """
        name, sequence = order.decision_point
        for after in self.graph.way(name, ends):
            order.edges = [
                *order.edges,
                Edge(edge_id(self.graph.edges[name, after]), sequence + 1, True, []),
            ]
            order.nodes = [*order.nodes, Node(after, sequence + 2, True, [])]
            name, sequence = after, sequence + 2
        there = order.nodes[-1].actions if order.nodes else order.queue
        if kind and all(action.action_type != kind for action in there):
            there.append(
                ActionOrder(
                    kind, f"{kind} {sequence}", "HARD", [Parameter("loadId", load)] if load else []
                )
            )

    # -- what it says

    def _report(self, robot: Driver, action: Action) -> None:
        """Send a state when it is due, and at once when something has happened."""
        duty, seen, now = robot.duty, robot.seen, robot.seen.tick * TIME_STEP
        status = Status(
            is_driving=action.twist != STILL,
            is_paused=duty.is_paused,
            is_laden=duty.is_laden,
            is_charging=seen.charge > self._charge,
            is_blocked=action.state == "stopped",
            is_away=duty.is_away,
        )
        self._charge = seen.charge
        news = robot.memory.duty, status, seen.hitch and seen.hitch.name
        if news != self._news or now - self._sent >= self.timing.state - TIME_STEP / 2:
            self._port.send(
                "state",
                state_of(
                    seen,
                    status,
                    duty.order,
                    duty.instant,
                    duty.errors,
                    action.waits_for,
                    self.graph,
                ),
            )
            self._news, self._sent = news, now
        if (
            self.timing.visualization
            and now - self._shown >= self.timing.visualization - TIME_STEP / 2
        ):
            self._port.send("visualization", visualization_of(seen, self._port.state_header_id))
            self._shown = now
