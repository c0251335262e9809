"""A robot that does what fleet control orders: an agent with an order of VDA 5050 as its plan.

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
from orchard_vda5050.calls import Calls
from orchard_vda5050.driver import Driver, Duty, Onward
from orchard_vda5050.errors import Rejected
from orchard_vda5050.messages import Message, Status, factsheet_of, state_of, visualization_of
from orchard_vda5050.order import take
from orchard_vda5050.order_state import ActionState, ActionStatus, OrderState, cancel
from orchard_vda5050.received import (
    ActionOrder,
    Edge,
    Header,
    Node,
    Parameter,
    read_instant_actions,
    read_order,
)

# Within so many metres of a node a vehicle stands on it.
ON_A_NODE = 0.05
# Instant actions that a vehicle remembers.
MOST_INSTANT = 50
# The error of an order that comes while the vehicle clears the roads by itself.
NOT_AVAILABLE = "MOBILE_ROBOT_NOT_AVAILABLE"
# Bytes of an order in a vehicle's memory: half of what an agent may keep.
MOST_BYTES = LARGEST_MEMORY // 2
# Instant actions that say that the vehicle is to pause, or to go on.
IS_PAUSED_AFTER = {"startPause": True, "stopPause": False}


def _packed(data: Any) -> bytes:
    """Return data as msgpack, compressed: a memory is sent over the network."""
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
    """Simulated seconds.

    `state`: between two states. `visualization`: between two visualizations; 0 for none.
    `patience`: until a vehicle that is left standing on the roads drives to the queue by itself.
    """

    state: float = 1.0
    visualization: float = 0.0
    patience: float = 300.0


class Vehicle:
    """A robot as a vehicle of VDA 5050.

    Each kind derives a class, which says `holds = True`: it is asked when it has something to do.
    """

    #: The memory of the kind's agent, with the field `duty`, a packed Duty.
    Memory: type[Any]
    #: The steps of the kind, beside those of its route.
    Steps: ClassVar[Sequence[type[Step]]]
    drives_with: ClassVar[type[Driver]]

    def __init__(
        self,
        robot: Carrier | Picker,
        name: str,
        *,
        graph: Graph,
        port: Port,
        calls: Calls,
        timing: Timing,
    ) -> None:
        """`robot`: the Orchard's own agent of this kind."""
        self.Memory = with_steps(type(self).Memory, (Onward, *self.Steps, *robot.route.Steps))
        self.robot = robot
        self.name = name
        self.graph = graph
        self.timing = timing
        self._before_each_drive: Sequence[Step] = ()
        self._port = port
        self._calls = calls
        # Simulated seconds at which a state and a visualization were sent last; -1: not yet.
        self._state_sent_at = -1.0
        self._visualization_sent_at = -1.0
        # What the newest state said of duty, status and bin. None: a new state is due, whatever
        # they are.
        self._news: object = None
        # The charge at the tick before.
        self._charge = 1.0
        # The newest duty: as the memory has it, as it is, and as msgpack.
        self._written = b""
        self._duty = Duty()
        self._plain = b""
        starts = robot.route.layout.starts
        self._bins = frozenset(start.name for start in starts if start.kind == "bin")

    def tick(self, seen: Observation, mail: Mail, memory: Any) -> Action:
        """Take the messages that have come, follow the order, and say how far it is."""
        memory = memory or self.Memory(plan=[Onward()])
        duty = self._duty_in(memory, seen)
        robot = self.drives_with(
            seen,
            mail,
            memory,
            duty=duty,
            robot=self.robot,
            graph=self.graph,
            calls=self._calls,
            before_each_drive=self._before_each_drive,
        )
        self._calls.hear(mail.requests, seen.tick)
        self._calls.promise(self.name, duty.owes)
        for topic, payload in self._port.take():
            self._obey(robot, topic, payload)
        robot.action.answers = [(heard, self.answer(robot, heard)) for heard in mail.requests]
        self._go_on(robot)
        self._close_cancelling(duty)
        action = robot.finish()
        if action.hold:
            # A state is due before the robot's own hold may end.
            state_due = seen.tick + max(1, round(self.timing.state / TIME_STEP))
            action.hold = replace(action.hold, until=min(action.hold.until, state_due))
        self._keep(memory, duty)
        self._report(robot, action)
        return action

    def _go_on(self, robot: Driver) -> None:
        """Go on with the order, unless the battery is empty or the vehicle pauses on its way."""
        duty = robot.duty
        if duty.phase == "action":
            why = robot.why_failed()
            if why:
                robot.fails(why)
        self._mind(robot)
        pauses = duty.is_paused and duty.phase == "edge"
        if robot.seen.charge > 0.0 and not pauses:
            robot.follow()
            robot.ask_ahead()

    def _duty_in(self, memory: Any, seen: Observation) -> Duty:
        """Return the duty in a memory.

        It is read only if it is not the one that this vehicle wrote last.
        """
        written = self._written
        duty = self._duty
        # An error in this tick may leave the duty half changed: then the next tick reads it.
        self._written = b""
        self._duty = Duty()
        if not memory.duty:
            return Duty(OrderState(last_node=self.graph.at(seen.x, seen.y)))
        if memory.duty == written:
            return duty
        return msgspec.msgpack.decode(zlib.decompress(memory.duty), type=Duty)

    def _keep(self, memory: Any, duty: Duty) -> None:
        """Write the duty into the memory if it has changed."""
        plain = msgspec.msgpack.encode(duty)
        if plain != self._plain or not memory.duty:
            self._plain = plain
            memory.duty = _packed(duty)
        self._written = memory.duty
        self._duty = duty

    # -- what a kind of vehicle knows

    def answer(self, robot: Any, heard: Heard) -> Answer:
        """Answer a request of another agent."""
        raise NotImplementedError

    def is_home(self, robot: Any) -> bool:
        """Whether a vehicle that clears the roads by itself has done so."""
        raise NotImplementedError

    def is_held_up(self, robot: Any) -> bool:
        """Whether a vehicle may stand on its way for ever, though fleet control orders it on."""
        return False

    def is_out_of_the_way(self, robot: Any) -> bool:
        """Whether a vehicle that stands holds up no other one."""
        raise NotImplementedError

    def clear_the_roads(self, robot: Any) -> None:
        """Order the vehicle out of the way of others: its order is given up."""
        raise NotImplementedError

    # -- what fleet control wants

    def _obey(self, robot: Driver, topic: str, payload: bytes) -> None:
        """Do what a message says, or keep the error of one that is rejected."""
        try:
            if topic == "order":
                self._take_order(robot, payload)
            else:
                for action in self._instant_actions(payload):
                    self._obey_at_once(robot, action)
        except Rejected as rejected:
            self._tell(robot.duty, rejected)
        except (ValueError, RecursionError) as error:
            why = f"not an instant action: {error}"
            robot.duty.errors = [Rejected("VALIDATION_FAILURE", why, {}).error]
        self._news = None

    def _take_order(self, robot: Driver, payload: bytes) -> None:
        """Take an order or an update. Raises Rejected."""
        duty = robot.duty
        order = read_order(payload)
        self._check_addressee(order)
        names = {"orderId": order.order_id}
        if duty.is_away:
            raise Rejected(NOT_AVAILABLE, "it drives to the queue by itself", names)
        x = robot.pose.x
        y = robot.pose.y
        taken = take(duty.order, order, self.graph, self._bins, x=x, y=y)
        if len(_packed(taken)) > MOST_BYTES:
            raise Rejected("INSUFFICIENT_MEMORY", "the order is too long", names, "URGENT")
        if taken.order_id != duty.order.order_id:
            duty.is_halted = False
        duty.order = taken

    def _check_addressee(self, message: Header) -> None:
        """Raise Rejected for a message to another vehicle."""
        if message.serial_number != self.name:
            why = f"it is for {message.serial_number}, and this is {self.name}"
            raise Rejected("VALIDATION_FAILURE", why, {})

    def _instant_actions(self, payload: bytes) -> list[ActionOrder]:
        """Return the instant actions in a payload.

        Raises ValueError if it is malformed, Rejected if it is for another vehicle.
        """
        message = read_instant_actions(payload)
        self._check_addressee(message)
        return message.actions

    def _tell(self, duty: Duty, rejected: Rejected) -> None:
        """Keep an error until a new order is taken; of each kind the newest."""
        error = rejected.error
        kept = [before for before in duty.order.errors if before.error_type != error.error_type]
        duty.order.errors = [*kept, error]

    def _obey_at_once(self, robot: Driver, action: ActionOrder) -> None:
        """Do an instant action, and note how far it is."""
        duty = robot.duty
        kind = action.action_type
        # The second copy of a message must not cancel again: the first one may have done it.
        if kind == "cancelOrder" and _is_known(duty, action):
            return
        if kind in INSTANT:
            duty.errors = []
        status: ActionStatus = "FINISHED"
        match kind:
            case "startPause" | "stopPause":
                duty.is_paused = IS_PAUSED_AFTER[kind]
            case "cancelOrder":
                status = self._cancel(robot, action)
            case "factsheetRequest":
                self._port.send(
                    "factsheet", factsheet_of(self.graph.kind, robot.machine, self.timing.state)
                )
            case "clearInstantActions":
                duty.instant = [state for state in duty.instant if state.action_status == "RUNNING"]
            case "stateRequest":
                # A state is sent after each message.
                pass
            case _:
                status = "FAILED"
                why = f"no instant action {kind}; there are {', '.join(INSTANT)}"
                names = {"actionId": action.action_id}
                duty.errors = [Rejected("INVALID_INSTANT_ACTION", why, names).error]
        self._note_instant(duty, ActionState(action.action_id, kind, status))

    def _note_instant(self, duty: Duty, state: ActionState) -> None:
        """Note how far an instant action is. The oldest are forgotten beyond some number."""
        kept = [before for before in duty.instant if before.action_id != state.action_id]
        duty.instant = [*kept, state][-MOST_INSTANT:]
        while len(_packed(duty.instant)) > MOST_BYTES // 2:
            del duty.instant[0]

    def _cancel(self, robot: Driver, action: ActionOrder) -> ActionStatus:
        """Give up the order, if it is the one that is named, or none is. Return how far that is."""
        duty = robot.duty
        order_id = action.value("orderId")
        is_other = order_id not in (None, duty.order.order_id)
        if duty.order.is_idle or duty.is_away or is_other:
            names = {"actionId": action.action_id}
            self._tell(duty, Rejected("NO_ORDER_TO_CANCEL", "no such order is active", names))
            return "FAILED"
        self._give_up(robot)
        return "RUNNING"

    def _give_up(self, robot: Driver) -> None:
        """Give up the order at the next node.

        A vehicle that has not left the last node yet stays there.
        """
        duty = robot.duty
        if duty.phase == "edge" and not self._is_on_last_node(robot):
            cancel(duty.order, is_driving=True)
        elif duty.phase == "action":
            cancel(duty.order, is_driving=False)
        else:
            self._stop(robot)
        duty.is_halted = False

    def _is_on_last_node(self, robot: Driver) -> bool:
        node = self.graph.nodes.get(robot.duty.order.last_node)
        if node is None:
            return False
        return abs(node.x - robot.pose.x) + abs(node.y - robot.pose.y) < ON_A_NODE

    def _close_cancelling(self, duty: Duty) -> None:
        """Note that an order is given up, once the vehicle has nothing of it left to do."""
        if duty.phase or not duty.order.is_idle:
            return
        for state in duty.instant:
            if state.action_status == "RUNNING":
                state.action_status = "FINISHED"

    # -- a vehicle that is left alone

    def _mind(self, robot: Driver) -> None:
        """Let a vehicle clear the roads by itself if fleet control leaves it standing on them for
        longer than its patience: it would jam all others.
        """
        duty = robot.duty
        if duty.is_away and self.is_home(robot):
            self._come_back(robot)
        if self._goes_on(robot) or not duty.order.last_node or self.is_out_of_the_way(robot):
            duty.idle_since = -1
            return
        if duty.idle_since < 0:
            duty.idle_since = robot.seen.tick
        if (robot.seen.tick - duty.idle_since) * TIME_STEP >= self.timing.patience:
            self._give_up(robot)
            duty.is_paused = False
            duty.is_away = True
            duty.idle_since = -1
            self.clear_the_roads(robot)

    def _come_back(self, robot: Driver) -> None:
        """Give fleet control the vehicle again, which has cleared the roads by itself."""
        duty = robot.duty
        self._stop(robot)
        duty.is_away = False
        errors = duty.order.errors
        duty.order.errors = [error for error in errors if error.error_type != NOT_AVAILABLE]

    def _goes_on(self, robot: Driver) -> bool:
        """Whether a vehicle has something to do, and may do it."""
        duty = robot.duty
        if duty.is_paused or duty.is_halted:
            return False
        if duty.phase == "edge" and robot.seen.twist == STILL:
            return not (duty.is_away or self.is_held_up(robot))
        return bool(duty.phase or duty.order.queue) or duty.order.may_leave

    def _stop(self, robot: Driver) -> None:
        """Give up the order where the vehicle stands."""
        if robot.duty.phase == "edge":
            robot.leave_edge()
        robot.duty.phase = ""
        robot.memory.plan = [Onward()]
        robot.memory.course = None
        cancel(robot.duty.order, is_driving=False)

    def add(self, order: OrderState, ends: Sequence[str], kind: str = "", load: str = "") -> None:
        """Add the way from the end of the base to the nearest of some nodes, and an action there.

        `kind`: of the action; '' for none. `load`: its bin; '' for none.
        """
        name, sequence = order.decision_point
        for after in self.graph.way(name, ends):
            edge = Edge(edge_id(self.graph.edges[name, after]), sequence + 1, True, [])
            order.edges = [*order.edges, edge]
            sequence += 2
            order.nodes = [*order.nodes, Node(after, sequence, True, [])]
            name = after
        there = order.nodes[-1].actions if order.nodes else order.queue
        if kind and all(action.action_type != kind for action in there):
            parameters = [Parameter("loadId", load)] if load else []
            there.append(ActionOrder(kind, f"{kind} {sequence}", "HARD", parameters))

    # -- what it says

    def _report(self, robot: Driver, action: Action) -> None:
        """Send a state when it is due, and at once when something has happened."""
        duty = robot.duty
        seen = robot.seen
        now = seen.tick * TIME_STEP
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
        # Times are sums of 0.1 s, which are not exact: half a step makes up for it.
        is_state_due = now - self._state_sent_at >= self.timing.state - TIME_STEP / 2
        if news != self._news or is_state_due:
            message = state_of(
                seen,
                status,
                duty.order,
                instant=duty.instant,
                errors=duty.errors,
                waits_for=action.waits_for,
                graph=self.graph,
            )
            self._port.send("state", message)
            self._news = news
            self._state_sent_at = now
        interval = self.timing.visualization
        if interval and now - self._visualization_sent_at >= interval - TIME_STEP / 2:
            self._port.send("visualization", visualization_of(seen, self._port.state_header_id))
            self._visualization_sent_at = now


def _is_known(duty: Duty, action: ActionOrder) -> bool:
    """Whether an instant action has come before."""
    for state in duty.instant:
        if state.action_id == action.action_id and state.action_type == action.action_type:
            return True
    return False
