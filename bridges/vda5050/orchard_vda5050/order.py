"""Orders, and which of them a vehicle takes: what it knows of its order, and how that changes.

No clock, no network, no robot.

Field names are those of VDA 5050. What the standard asks for in each case is in its chapters on
orders, cancelling and errors.
"""

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from math import hypot
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from orchard.roads.actions import ACTIONS, IGNORED, VehicleAction
from orchard.roads.graph import Graph
from orchard.roads.graph import Node as Place
from orchard.roads.lif import MAP

LONGEST_ID = 200  # characters of the name of an order or an action
LONGEST_TOLD = 300  # characters of what an error says or refers to
Count = Annotated[int, Meta(ge=0, lt=2**32)]
Name = Annotated[str, Meta(max_length=LONGEST_ID)]
Status = Literal["WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"]
Level = Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]
LASTING = (
    "ACTION_FAILED",
    "NODE_UNREACHABLE",
)  # errors with which a vehicle stands until its order is cancelled
UNUSABLE = (  # of an edge
    "trajectory",
    "corridor",
    "orientation",
    "direction",
    "reachOrientationBeforeEntering",
    "maximumRotationSpeed",
    "maxRotationSpeed",
)
LARGEST = 1 << 20  # bytes of a message
# M by which a node may be elsewhere than in the vehicle's own map, and a vehicle beside the line of
# an edge.
MATCHES = 0.5
# M by which a vehicle may stand off its first node, whatever the order allows: it drives straight
# on from there.
OFF = 5.0

# -- messages of fleet control


class Part(msgspec.Struct, rename="camel", gc=False):
    """A part of a message.

    There are many, and none refers back to what holds it: they need no garbage collection.
    """


class Parameter(Part):
    key: str
    value: Any = None


class ActionOrder(Part):
    """An action in an order, or an instant action."""

    action_type: Name
    action_id: Name
    blocking_type: Literal["NONE", "SINGLE", "SOFT", "HARD"]
    action_parameters: list[Parameter] = []

    def value(self, key: str) -> Any:
        """Return a parameter; None if it is not there."""
        for parameter in self.action_parameters:
            if parameter.key == key:
                return parameter.value
        return None


class Deviation(Part):
    a: float
    b: float


class NodePosition(Part):
    x: float
    y: float
    map_id: str
    theta: float | None = None
    allowed_deviation: Deviation | float | None = msgspec.field(
        default=None, name="allowedDeviationXY"
    )  # m, in version 2.1
    allowed_deviation_xy: float | None = None  # the same, as the schema of version 2.0 spells it

    @property
    def allowed(self) -> float:
        """How far from the node a vehicle may be, m."""
        deviation = self.allowed_deviation or self.allowed_deviation_xy
        return deviation.b if isinstance(deviation, Deviation) else deviation or 0.0


class Node(Part):
    node_id: str
    sequence_id: Count
    released: bool
    actions: list[ActionOrder]
    node_position: NodePosition | None = None


class Edge(Part):
    edge_id: str
    sequence_id: Count
    released: bool
    actions: list[ActionOrder]
    start_node_id: str | None = None
    end_node_id: str | None = None
    maximum_speed: Annotated[float, Meta(gt=0.0)] | None = None  # m/s
    max_speed: Annotated[float, Meta(gt=0.0)] | None = None  # the same in version 2.1

    @property
    def speed(self) -> float | None:
        """The speed that is allowed, m/s."""
        return self.maximum_speed or self.max_speed


class Header(msgspec.Struct, rename="camel"):
    header_id: Count
    timestamp: str
    version: str
    manufacturer: str
    serial_number: str


class Order(Header):
    order_id: Annotated[Name, Meta(min_length=1)]
    order_update_id: Count
    nodes: list[Node]
    edges: list[Edge]

    @property
    def content(self) -> bytes:
        """A digest of what it orders."""
        return hashlib.blake2b(
            msgspec.msgpack.encode((self.nodes, self.edges)), digest_size=16
        ).digest()


class InstantActions(Header):
    actions: list[ActionOrder]


# -- what a vehicle knows


class ActionState(Part):
    action_id: str
    action_type: str
    action_status: Status = "WAITING"


class Reference(Part):
    reference_key: str
    reference_value: str


class Error(Part):
    error_type: str
    error_level: Level
    error_references: list[Reference]
    error_description: str


class OrderState(msgspec.Struct):
    """The order of a vehicle. `nodes` and `edges` lie ahead; the base comes before the horizon."""

    order_id: str = ""
    update_id: int = 0
    content: bytes = b""
    last_node: str = ""
    last_sequence: int = 0
    nodes: list[Node] = []
    edges: list[Edge] = []
    actions: list[ActionState] = []
    queue: list[ActionOrder] = []  # of the last node, not done; the first one runs
    errors: list[Error] = []
    is_cancelled: bool = False

    @property
    def is_idle(self) -> bool:
        return not self.nodes and not self.queue

    @property
    def decision_point(self) -> tuple[str, int]:
        """The last node of the base."""
        base = [(node.node_id, node.sequence_id) for node in self.nodes if node.released]
        return base[-1] if base else (self.last_node, self.last_sequence)

    def loads(self) -> Iterator[str]:
        """Yield the bins that the order names."""
        actions = [*self.queue, *(action for node in self.nodes for action in node.actions)]
        yield from (str(load) for action in actions if (load := action.value("loadId")))

    def set(self, action_id: str, status: Status) -> None:
        """Note how far an action is."""
        for state in self.actions:
            if state.action_id == action_id:
                state.action_status = status


class Rejected(Exception):
    """Raised for an order that the vehicle does not take: the error that it reports."""

    def __init__(
        self, error_type: str, why: str, references: Mapping[str, object], level: Level = "WARNING"
    ) -> None:
        super().__init__(why)
        named = [Reference(key, str(value)[:LONGEST_TOLD]) for key, value in references.items()]
        self.error = Error(error_type, level, named, why[:LONGEST_TOLD])


def _data_in(payload: bytes) -> Any:
    """Return what a message says as JSON.

    Raises ValueError or RecursionError for one that cannot be read.
    """
    if len(payload) > LARGEST:
        raise ValueError(f"{len(payload)} bytes are more than {LARGEST}")
    return _without_nulls(msgspec.json.decode(payload))


def _without_nulls(data: Any) -> Any:
    """Return what is there: fleet control may write `null` for an optional field that it leaves
    out.
    """
    if isinstance(data, dict):
        return {key: _without_nulls(value) for key, value in data.items() if value is not None}
    if isinstance(data, list):
        return [_without_nulls(item) for item in data]
    return data


def read_instant_actions(payload: bytes) -> InstantActions:
    """Return the instant actions in a payload.

    Raises ValueError or RecursionError if it is malformed.
    """
    data = _data_in(payload)
    if isinstance(data, dict) and "instantActions" in data:
        # Some software for version 2.0 still names them as version 1.1 does.
        data.setdefault("actions", data["instantActions"])
    return msgspec.convert(data, InstantActions)


def read(payload: bytes) -> Order:
    """Return the order in a payload. Raises Rejected for one that is malformed."""
    known: dict[str, object] = {}
    try:
        data = _data_in(payload)
        known = {
            key: data[key]
            for key in ("orderId", "orderUpdateId")
            if isinstance(data, dict) and key in data
        }
        order = msgspec.convert(data, Order)
        _check_sequence(order)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise Rejected("VALIDATION_FAILURE", f"not an order: {error}", known) from None
    for edge, raw in zip(order.edges, data["edges"], strict=True):
        if unusable := [name for name in UNUSABLE if name in raw]:
            raise Rejected(
                "UNSUPPORTED_PARAMETER",
                f"edge {edge.edge_id}: cannot use {', '.join(unusable)}",
                {"parameter": unusable[0]},
                "CRITICAL",
            )
    return order


def _check_sequence(order: Order) -> None:
    if len(order.edges) != len(order.nodes) - 1:
        raise ValueError(
            f"{len(order.nodes)} nodes and {len(order.edges)} edges: there must be one edge less"
            " than nodes"
        )
    parts = [
        part
        for pair in zip(order.nodes, [*order.edges, None], strict=True)
        for part in pair
        if part is not None
    ]
    if [part.sequence_id for part in parts] != list(
        range(parts[0].sequence_id, parts[0].sequence_id + len(parts))
    ):
        raise ValueError("sequenceId must grow by 1, from a node to its edge to the next node")
    released = [part.released for part in parts]
    if (
        not released[0]
        or sorted(released, reverse=True) != released
        or (len(parts) > 1 and sum(released) % 2 == 0)
    ):
        raise ValueError("the base must come first, and begin and end with a node")
    for start, edge, end in zip(order.nodes, order.edges, order.nodes[1:], strict=False):
        if (edge.start_node_id or start.node_id, edge.end_node_id or end.node_id) != (
            start.node_id,
            end.node_id,
        ):
            raise ValueError(
                f"edge {edge.edge_id} is not from {start.node_id} to {end.node_id}, between which"
                " it stands"
            )
    ids = [action.action_id for part in parts for action in part.actions]
    if len(set(ids)) < len(ids):
        raise ValueError("two actions have the same actionId")


def take(
    state: OrderState, order: Order, graph: Graph, bins: Collection[str], x: float, y: float
) -> OrderState:
    """Return what a vehicle at (x, y) knows with a new order or an update.

    `bins`: the names of all bins. Raises Rejected.

    An order that it has already changes nothing.
    """
    named = {"orderId": order.order_id, "orderUpdateId": order.order_update_id}
    is_new = order.order_id != state.order_id
    if is_new and not state.is_idle:
        raise Rejected(
            "OTHER_ORDER_ACTIVE", f"busy with order {state.order_id}", {"orderId": order.order_id}
        )
    if not is_new and order.order_update_id < state.update_id:
        raise Rejected(
            "OUTDATED_ORDER_UPDATE", f"has update {state.update_id} of this order", named
        )
    if not is_new and order.order_update_id == state.update_id:
        if order.content != state.content:
            raise Rejected(
                "SAME_ORDER_UPDATE_ID",
                "has an order of this number that says something else",
                named,
            )
        return state
    if not is_new and state.is_cancelled:
        raise Rejected("ORDER_UPDATE_FOLLOWING_CANCEL", "this order is cancelled", named)
    first = order.nodes[0]
    if is_new and order.order_update_id != 0:
        raise Rejected(
            "VALIDATION_FAILURE",
            "the orderUpdateId of a new order must be 0: an order before it is lost",
            named,
        )
    if not is_new and (first.node_id, first.sequence_id) != state.decision_point:
        name, sequence = state.decision_point
        raise Rejected(
            "VALIDATION_FAILURE",
            f"the update must begin with the last node of the base, {name} with sequenceId"
            f" {sequence}",
            named,
        )
    _check_ways(order, graph)
    if not is_new:
        _check_decision_point(state, order)
        _check_names(state, order)
    _check_actions(order, ACTIONS[graph.kind], bins)
    if is_new:
        _check_start(state, order, graph, x, y)
        return _begun(state, order)
    return _continued(state, order)


def _check_start(state: OrderState, order: Order, graph: Graph, x: float, y: float) -> None:
    """The vehicle must stand on the first node.

    It may stand off its last one: behind others in the queue, or where it has left a bin.
    """
    first = order.nodes[0]
    if first.node_id == state.last_node:
        return
    node, room = graph.nodes[first.node_id], MATCHES
    if first.node_position is not None and _is_beside(node, order, graph, x, y):
        room += min(first.node_position.allowed, OFF)
    if hypot(node.x - x, node.y - y) > room:
        far = f"{first.node_id} is {hypot(node.x - x, node.y - y):.1f} m away"
        raise Rejected(
            "START_NODE_OUT_OF_RANGE", far, {"orderId": order.order_id, "nodeId": first.node_id}
        )


def _is_beside(node: Place, order: Order, graph: Graph, x: float, y: float) -> bool:
    """Whether a vehicle at (x, y) stands on the line of the order's first edge: that one leads
    along x, or along y.
    """
    others = [later.node_id for later in order.nodes if later.node_id != node.name]
    if not others:
        return False
    after = graph.nodes[others[0]]
    leads_along_x = abs(after.x - node.x) > abs(after.y - node.y)
    return abs(node.y - y if leads_along_x else node.x - x) <= MATCHES


def _check_ways(order: Order, graph: Graph) -> None:
    """All nodes must be in the vehicle's map, and be joined there."""
    for node in order.nodes:
        at = node.node_position
        if at is not None and at.map_id != MAP:
            raise Rejected(
                "UNKNOWN_MAP_ID",
                f"the only map is {MAP}",
                {"orderId": order.order_id, "mapId": at.map_id},
            )
        if at is not None and at.theta is not None:
            raise Rejected(
                "UNSUPPORTED_PARAMETER",
                "cannot use theta: an edge says where it faces",
                {"parameter": "theta"},
                "CRITICAL",
            )
        known = graph.nodes.get(node.node_id)
        if known is None or (at is not None and hypot(known.x - at.x, known.y - at.y) > MATCHES):
            raise Rejected(
                "NO_ROUTE_TO_TARGET",
                f"no node {node.node_id} there",
                {"orderId": order.order_id, "nodeId": node.node_id},
            )
    for start, end in zip(order.nodes, order.nodes[1:], strict=False):
        if start.node_id != end.node_id and (start.node_id, end.node_id) not in graph.edges:
            why = f"no edge from {start.node_id} to {end.node_id}"
            raise Rejected(
                "NO_ROUTE_TO_TARGET", why, {"orderId": order.order_id, "nodeId": end.node_id}
            )


def _check_decision_point(state: OrderState, order: Order) -> None:
    """The actions at the first node of an update are those that the vehicle knows there, or left
    out.

    The standard asks fleet control to send new actions at a further node of the same name.
    """
    is_ahead = any(node.released for node in state.nodes)
    open_there = (
        [node for node in state.nodes if node.released][-1].actions if is_ahead else state.queue
    )
    not_done = {action.action_id: action for action in open_there}
    known = set(not_done) if is_ahead else _names_of_base(state)
    first = order.nodes[0]
    for action in first.actions:
        if action.action_id not in known:
            change = "a new action"
        elif action != not_done.get(action.action_id, action):
            change = "another action of a known actionId"
        else:
            continue
        raise Rejected(
            "INVALID_ORDER_ACTION",
            f"the update has {change} at the last node of the base, {first.node_id}: "
            f"{action.action_type} {action.action_id}; expected it at a further node "
            f"{first.node_id} with sequenceId {first.sequence_id + 2}",
            {
                "orderId": order.order_id,
                "orderUpdateId": order.order_update_id,
                "actionId": action.action_id,
            },
        )


def _check_names(state: OrderState, order: Order) -> None:
    """The actions that an update adds must be new ones, also where it takes the place of the
    horizon.
    """
    kept = _names_of_base(state)
    added = [action.action_id for action in _states([*order.nodes[1:], *order.edges])]
    if again := [name for name in added if name in kept]:
        raise Rejected(
            "VALIDATION_FAILURE",
            "the order has an action with this actionId already",
            {"actionId": again[0]},
        )


def _names_of_base(state: OrderState) -> set[str]:
    """Return the ids of the actions that the vehicle knows, without those of the horizon."""
    return {action.action_id for action in state.actions} - _horizon(state)


def _horizon(state: OrderState) -> set[str]:
    """Return the actions of the horizon."""
    names = set[str]()
    parts: list[Node | Edge] = [*state.nodes, *state.edges]
    for part in parts:
        if not part.released:
            names.update(action.action_id for action in part.actions)
    return names


def _check_actions(order: Order, known: Mapping[str, VehicleAction], bins: Collection[str]) -> None:
    named = {"orderId": order.order_id, "orderUpdateId": order.order_update_id}
    parts = [("NODE", node.node_id, node.actions) for node in order.nodes]
    parts += [
        ("EDGE", node.node_id, edge.actions)
        for edge, node in zip(order.edges, order.nodes[1:], strict=True)
    ]
    for scope, node_id, actions in parts:
        for action in actions:
            if why := _why_not(action, known, scope, node_id, bins):
                raise Rejected("INVALID_ORDER_ACTION", why, named | {"actionId": action.action_id})
            names = {parameter.key for parameter in action.action_parameters}
            if unknown := sorted(names.difference(("loadId", *IGNORED))):
                why = f"{action.action_type}: cannot use {', '.join(unknown)}"
                raise Rejected(
                    "UNSUPPORTED_PARAMETER",
                    why,
                    {"parameter": unknown[0], "actionId": action.action_id},
                    "CRITICAL",
                )


def _why_not(
    action: ActionOrder,
    known: Mapping[str, VehicleAction],
    scope: str,
    node: str,
    bins: Collection[str],
) -> str:
    kind = known.get(action.action_type)
    if kind is None:
        return f"no action {action.action_type}; there are {', '.join(known)}"
    if kind.scope != scope or not kind.is_done_at(node):
        where = {"NODE": "at", "EDGE": "on the edge to"}
        return (
            f"{action.action_type} is not possible {where[scope]} {node}, only {where[kind.scope]}"
            f" {kind.nodes}"
        )
    if scope == "EDGE" and action.blocking_type not in kind.blocking:
        return (
            f"{action.action_type} is done while driving: its blockingType must be"
            f" {' or '.join(kind.blocking)}"
        )
    load = action.value("loadId")
    if (kind.needs_load or load is not None) and str(load) not in bins:
        return (
            f"{action.action_type} needs the parameter loadId, the name of a bin"
            if load is None
            else f"loadId: no bin {load}"
        )
    return ""


def _states(parts: Iterable[Node | Edge]) -> list[ActionState]:
    """Return the states of the actions of some nodes and edges, none of which has begun."""
    states = []
    for part in parts:
        for action in part.actions:
            states.append(ActionState(action.action_id, action.action_type))
    return states


def _begun(state: OrderState, order: Order) -> OrderState:
    first = order.nodes[0]
    own = order.order_id, order.order_update_id, order.content, first.node_id, first.sequence_id
    return OrderState(
        *own,
        order.nodes[1:],
        order.edges,
        _states([*order.nodes, *order.edges]),
        list(first.actions),
    )


def _continued(state: OrderState, order: Order) -> OrderState:
    """The update takes the place of the horizon.

    Its first node is known, and so are the actions there.
    """
    horizon = _horizon(state)
    return msgspec.structs.replace(
        state,
        update_id=order.order_update_id,
        content=order.content,
        nodes=[*(node for node in state.nodes if node.released), *order.nodes[1:]],
        edges=[*(edge for edge in state.edges if edge.released), *order.edges],
        actions=[
            *(action for action in state.actions if action.action_id not in horizon),
            *_states([*order.nodes[1:], *order.edges]),
        ],
        errors=[error for error in state.errors if error.error_type in LASTING],
    )


def arrive(state: OrderState) -> None:
    """The vehicle is at the next node: its actions are to be done there."""
    node = state.nodes.pop(0)
    del state.edges[0]
    state.last_node, state.last_sequence, state.queue = (
        node.node_id,
        node.sequence_id,
        list(node.actions),
    )


def cancel(state: OrderState, is_driving: bool) -> None:
    """Give up all that has not begun.

    A vehicle that drives goes on to the next node; an action that runs is finished.
    """
    going = 1 if is_driving else 0
    state.nodes = [msgspec.structs.replace(node, actions=[]) for node in state.nodes[:going]]
    state.edges = state.edges[:going]
    state.queue = [action for action in state.queue if _status(state, action) == "RUNNING"]
    state.is_cancelled = True
    for action in state.actions:
        if action.action_status == "WAITING":
            action.action_status = "FAILED"


def _status(state: OrderState, action: ActionOrder) -> str:
    for known in state.actions:
        if known.action_id == action.action_id:
            return known.action_status
    return "WAITING"
