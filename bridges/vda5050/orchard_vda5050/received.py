"""What fleet control sends, orders and instant actions, and how a vehicle reads it.

Fields have the names of VDA 5050, in the words of all its versions.
"""

import hashlib
from itertools import pairwise
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from orchard_vda5050.errors import Rejected, unsupported
from orchard_vda5050.parts import Count, MessagePart, Name

# Bytes of a message.
LARGEST = 1 << 20
# Fields of an edge that a vehicle cannot use.
UNUSABLE = (
    "trajectory",
    "corridor",
    "orientation",
    "direction",
    "reachOrientationBeforeEntering",
    "maximumRotationSpeed",
    "maxRotationSpeed",
)


class Parameter(MessagePart):
    """A parameter of an action."""

    key: str
    value: Any = None


class ActionOrder(MessagePart):
    """An action in an order, or an instant action."""

    action_type: Name
    action_id: Name
    blocking_type: Literal["NONE", "SINGLE", "SOFT", "HARD"]
    action_parameters: list[Parameter] = msgspec.field(default_factory=list)

    def value(self, key: str) -> Any:
        """Return a parameter; None if it is not there."""
        for parameter in self.action_parameters:
            if parameter.key == key:
                return parameter.value
        return None

    @property
    def load(self) -> str:
        """The bin that the action is about; '' if it names none."""
        return str(self.value("loadId") or "")


class Deviation(MessagePart):
    """An ellipse around a node: its half axes, m, of which `b` is the smaller one."""

    a: float
    b: float


class NodePosition(MessagePart):
    """Where a node is, in m.

    How far a vehicle may be from it is an ellipse in version 3.0, and a number in 2.1. The schema
    of version 2.0 has the number too, under another spelling of the name.
    """

    x: float
    y: float
    map_id: str
    theta: float | None = None
    allowed_deviation: Deviation | float | None = msgspec.field(
        default=None, name="allowedDeviationXY"
    )
    allowed_deviation_xy: float | None = None

    @property
    def allowed(self) -> float:
        """How far from the node a vehicle may be, m."""
        deviation = self.allowed_deviation or self.allowed_deviation_xy
        if isinstance(deviation, Deviation):
            return deviation.b
        return deviation or 0.0


class Node(MessagePart):
    """A node of an order. `released`: whether it is of the base, and not of the horizon."""

    node_id: str
    sequence_id: Count
    released: bool
    actions: list[ActionOrder]
    node_position: NodePosition | None = None


class Edge(MessagePart):
    """An edge of an order, between two of its nodes.

    The speed that is allowed, m/s, has another name in version 2.1.
    """

    edge_id: str
    sequence_id: Count
    released: bool
    actions: list[ActionOrder]
    start_node_id: str | None = None
    end_node_id: str | None = None
    maximum_speed: Annotated[float, Meta(gt=0.0)] | None = None
    max_speed: Annotated[float, Meta(gt=0.0)] | None = None

    @property
    def speed(self) -> float | None:
        """The speed that is allowed, m/s; None: any."""
        return self.maximum_speed or self.max_speed


class Header(msgspec.Struct, rename="camel"):
    """What each message begins with."""

    header_id: Count
    timestamp: str
    version: str
    manufacturer: str
    serial_number: str


class Order(Header):
    """An order, or an update of one."""

    order_id: Annotated[Name, Meta(min_length=1)]
    order_update_id: Count
    nodes: list[Node]
    edges: list[Edge]

    @property
    def content(self) -> bytes:
        """A digest of what it orders."""
        orders = msgspec.msgpack.encode((self.nodes, self.edges))
        return hashlib.blake2b(orders, digest_size=16).digest()

    @property
    def names(self) -> dict[str, object]:
        """What an error refers to."""
        return {"orderId": self.order_id, "orderUpdateId": self.order_update_id}


class InstantActions(Header):
    """Actions that are done at once, beside any order."""

    actions: list[ActionOrder]


def read_instant_actions(payload: bytes) -> InstantActions:
    """Return the instant actions in a payload.

    Raises ValueError or RecursionError if it is malformed.
    """
    data = _data_in(payload)
    if isinstance(data, dict) and "instantActions" in data:
        # Some software for version 2.0 still names them as version 1.1 does.
        data.setdefault("actions", data["instantActions"])
    return msgspec.convert(data, InstantActions)


def read_order(payload: bytes) -> Order:
    """Return the order in a payload. Raises Rejected for one that is malformed."""
    names: dict[str, object] = {}
    try:
        data = _data_in(payload)
        if isinstance(data, dict):
            names = {key: data[key] for key in ("orderId", "orderUpdateId") if key in data}
        order = msgspec.convert(data, Order)
        _check_sequence(order)
    except (ValueError, RecursionError) as error:
        raise Rejected("VALIDATION_FAILURE", f"not an order: {error}", names) from None
    for edge, as_sent in zip(order.edges, data["edges"], strict=True):
        unusable = [name for name in UNUSABLE if name in as_sent]
        if unusable:
            why = f"edge {edge.edge_id}: cannot use {', '.join(unusable)}"
            raise unsupported(why, unusable[0])
    return order


def _data_in(payload: bytes) -> Any:
    """Return what a message says as JSON.

    Raises ValueError or RecursionError for one that cannot be read.
    """
    if len(payload) > LARGEST:
        raise ValueError(f"{len(payload)} bytes are more than {LARGEST}")
    return _without_nulls(msgspec.json.decode(payload))


def _without_nulls(data: Any) -> Any:
    """Return what is there. Fleet control may write `null` for an optional field that it omits."""
    if isinstance(data, dict):
        return {key: _without_nulls(value) for key, value in data.items() if value is not None}
    if isinstance(data, list):
        return [_without_nulls(item) for item in data]
    return data


def _check_sequence(order: Order) -> None:
    """Raise ValueError unless nodes and edges follow each other as the standard asks."""
    if len(order.edges) != len(order.nodes) - 1:
        raise ValueError(
            f"{len(order.nodes)} nodes and {len(order.edges)} edges: there must be one edge less"
            " than nodes"
        )
    parts: list[Node | Edge] = [order.nodes[0]]
    for edge, node in zip(order.edges, order.nodes[1:], strict=True):
        parts += [edge, node]
    _check_numbers(parts)
    _check_base(parts)
    _check_ends(order)
    ids = [action.action_id for part in parts for action in part.actions]
    if len(set(ids)) < len(ids):
        raise ValueError("two actions have the same actionId")


def _check_numbers(parts: list[Node | Edge]) -> None:
    """Raise ValueError unless the sequenceId of each part follows that of the part before it."""
    for before, after in pairwise(parts):
        if after.sequence_id != before.sequence_id + 1:
            raise ValueError("sequenceId must grow by 1, from a node to its edge to the next node")


def _check_base(parts: list[Node | Edge]) -> None:
    """Raise ValueError unless the parts that are released come first, and end with a node."""
    released = [part.released for part in parts]
    count = sum(released)
    # Nodes have the even places, so a base that ends with a node has an odd number of parts.
    if not all(released[:count]) or count % 2 == 0:
        raise ValueError("the base must come first, and begin and end with a node")


def _check_ends(order: Order) -> None:
    """Raise ValueError unless each edge leads from the node before it to the one after it.

    An edge may leave out the names of its nodes.
    """
    for edge, (start, end) in zip(order.edges, pairwise(order.nodes), strict=True):
        starts_elsewhere = edge.start_node_id and edge.start_node_id != start.node_id
        ends_elsewhere = edge.end_node_id and edge.end_node_id != end.node_id
        if starts_elsewhere or ends_elsewhere:
            raise ValueError(
                f"edge {edge.edge_id} is not from {start.node_id} to {end.node_id}, between which"
                " it stands"
            )
