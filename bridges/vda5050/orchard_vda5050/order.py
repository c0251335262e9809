"""Which orders a vehicle takes, and what it knows with them: `take`, which `vehicle.py` calls.

All functions here are of data: no clock, no network, no robot. What the standard asks for in each
case is in its chapters on orders, cancelling and errors.
"""

from collections.abc import Collection, Iterable, Mapping
from itertools import pairwise
from math import hypot

import msgspec

from orchard.roads.actions import ACTIONS, IGNORED, VehicleAction
from orchard.roads.graph import Graph
from orchard.roads.graph import Node as RoadNode
from orchard.roads.lif import MAP
from orchard_vda5050.errors import LASTING, Rejected, unsupported
from orchard_vda5050.order_state import ActionState, OrderState
from orchard_vda5050.received import ActionOrder, Edge, Node, Order

# So many metres a node may be off its place in the vehicle's own map, and a vehicle beside the line
# of an edge.
MATCHES = 0.5
# So many metres, beside MATCHES, a vehicle may stand off its first node, whatever the order allows:
# it drives straight on from there.
OFF = 5.0
# Where an action is done, by its scope.
WHERE = {"NODE": "at", "EDGE": "on the edge to"}


def take(
    state: OrderState, order: Order, graph: Graph, bins: Collection[str], *, x: float, y: float
) -> OrderState:
    """Return what a vehicle at (x, y), m, knows with a new order or an update.

    `state`: what it knows without it; that is not changed. `bins`: the names of all bins. An order
    that the vehicle has already changes nothing. Raises Rejected.
    """
    if order.order_id != state.order_id:
        _check_new(state, order)
        _check_route(order, graph)
        _check_actions(order, ACTIONS[graph.kind], bins)
        _check_start(state, order, graph, x, y)
        return _begun(order)
    if order.order_update_id == state.update_id:
        if order.content != state.content:
            why = "has an order of this number that says something else"
            raise Rejected("SAME_ORDER_UPDATE_ID", why, order.names)
        return state
    _check_update(state, order)
    _check_route(order, graph)
    _check_decision_point(state, order)
    _check_names(state, order)
    _check_actions(order, ACTIONS[graph.kind], bins)
    return _continued(state, order)


def _check_new(state: OrderState, order: Order) -> None:
    """Raise Rejected if a new order cannot begin now."""
    if not state.is_idle:
        why = f"busy with order {state.order_id}"
        raise Rejected("OTHER_ORDER_ACTIVE", why, {"orderId": order.order_id})
    if order.order_update_id != 0:
        why = "the orderUpdateId of a new order must be 0: an order before it is lost"
        raise Rejected("VALIDATION_FAILURE", why, order.names)


def _check_update(state: OrderState, order: Order) -> None:
    """Raise Rejected if an update does not go on from what the vehicle has."""
    if order.order_update_id < state.update_id:
        why = f"has update {state.update_id} of this order"
        raise Rejected("OUTDATED_ORDER_UPDATE", why, order.names)
    if state.is_cancelled:
        raise Rejected("ORDER_UPDATE_FOLLOWING_CANCEL", "this order is cancelled", order.names)
    first = order.nodes[0]
    if (first.node_id, first.sequence_id) != state.decision_point:
        name, sequence = state.decision_point
        why = (
            f"the update must begin with the last node of the base, {name} with sequenceId"
            f" {sequence}"
        )
        raise Rejected("VALIDATION_FAILURE", why, order.names)


def _check_start(state: OrderState, order: Order, graph: Graph, x: float, y: float) -> None:
    """Raise Rejected unless the vehicle stands on the first node.

    If that is the node to which it came last, it may stand anywhere: behind others in the queue,
    or where it has left a bin.
    """
    first = order.nodes[0]
    if first.node_id == state.last_node:
        return
    node = graph.nodes[first.node_id]
    room = MATCHES
    if first.node_position is not None and _is_beside(node, order, graph, x, y):
        room += min(first.node_position.allowed, OFF)
    distance = hypot(node.x - x, node.y - y)
    if distance > room:
        why = f"{first.node_id} is {distance:.1f} m away"
        names = {"orderId": order.order_id, "nodeId": first.node_id}
        raise Rejected("START_NODE_OUT_OF_RANGE", why, names)


def _is_beside(node: RoadNode, order: Order, graph: Graph, x: float, y: float) -> bool:
    """Whether a vehicle at (x, y) stands on the line of the order's first edge.

    That edge leads along x, or along y. A node may follow itself, without an edge.
    """
    further = [later.node_id for later in order.nodes if later.node_id != node.name]
    if not further:
        return False
    after = graph.nodes[further[0]]
    leads_along_x = abs(after.x - node.x) > abs(after.y - node.y)
    off_line = node.y - y if leads_along_x else node.x - x
    return abs(off_line) <= MATCHES


def _check_route(order: Order, graph: Graph) -> None:
    """Raise Rejected unless all nodes are in the vehicle's map, and are joined there."""
    for node in order.nodes:
        _check_node(node, order, graph)
    for start, end in pairwise(order.nodes):
        if start.node_id != end.node_id and (start.node_id, end.node_id) not in graph.edges:
            why = f"no edge from {start.node_id} to {end.node_id}"
            raise _no_route(order, end, why)


def _check_node(node: Node, order: Order, graph: Graph) -> None:
    """Raise Rejected unless a node is where the vehicle's map has it."""
    at = node.node_position
    if at is not None and at.map_id != MAP:
        names = {"orderId": order.order_id, "mapId": at.map_id}
        raise Rejected("UNKNOWN_MAP_ID", f"the only map is {MAP}", names)
    if at is not None and at.theta is not None:
        raise unsupported("cannot use theta: an edge says where it faces", "theta")
    in_map = graph.nodes.get(node.node_id)
    if in_map is None:
        raise _no_route(order, node, f"no node {node.node_id} there")
    if at is not None and hypot(in_map.x - at.x, in_map.y - at.y) > MATCHES:
        raise _no_route(order, node, f"no node {node.node_id} there")


def _no_route(order: Order, node: Node, why: str) -> Rejected:
    names = {"orderId": order.order_id, "nodeId": node.node_id}
    return Rejected("NO_ROUTE_TO_TARGET", why, names)


def _check_decision_point(state: OrderState, order: Order) -> None:
    """Raise Rejected if an update has new actions at its first node.

    The vehicle knows the actions of this node already, and an update may leave them out. The
    standard asks fleet control to send new actions at a further node of the same name.
    """
    # The node lies ahead, or the vehicle has come there and has begun its actions.
    base = [node for node in state.nodes if node.released]
    if base:
        not_done = {action.action_id: action for action in base[-1].actions}
        known_ids = set(not_done)
    else:
        not_done = {action.action_id: action for action in state.queue}
        known_ids = _ids_of_base(state)
    first = order.nodes[0]
    for action in first.actions:
        if action.action_id not in known_ids:
            change = "a new action"
        elif action != not_done.get(action.action_id, action):
            change = "another action of a known actionId"
        else:
            continue
        why = (
            f"the update has {change} at the last node of the base, {first.node_id}: "
            f"{action.action_type} {action.action_id}; expected it at a further node "
            f"{first.node_id} with sequenceId {first.sequence_id + 2}"
        )
        names = order.names | {"actionId": action.action_id}
        raise Rejected("INVALID_ORDER_ACTION", why, names)


def _check_names(state: OrderState, order: Order) -> None:
    """Raise Rejected if an update adds an action that the vehicle has already.

    What the update replaces, the horizon, does not count.
    """
    kept = _ids_of_base(state)
    for action in _states([*order.nodes[1:], *order.edges]):
        if action.action_id in kept:
            why = "the order has an action with this actionId already"
            raise Rejected("VALIDATION_FAILURE", why, {"actionId": action.action_id})


def _ids_of_base(state: OrderState) -> set[str]:
    """Return the ids of the actions that the vehicle knows, without those of the horizon."""
    return {action.action_id for action in state.actions} - _ids_of_horizon(state)


def _ids_of_horizon(state: OrderState) -> set[str]:
    """Return the ids of the actions of the horizon."""
    ids = set[str]()
    parts: list[Node | Edge] = [*state.nodes, *state.edges]
    for part in parts:
        if not part.released:
            ids.update(action.action_id for action in part.actions)
    return ids


def _check_actions(order: Order, known: Mapping[str, VehicleAction], bins: Collection[str]) -> None:
    """Raise Rejected for an action that the vehicle cannot do.

    `known`: the actions of its kind, by their types.
    """
    for node in order.nodes:
        for action in node.actions:
            why = _why_not(action, known, "NODE", node.node_id, bins)
            _check_action(action, why, order)
    for edge, node in zip(order.edges, order.nodes[1:], strict=True):
        for action in edge.actions:
            why = _why_not(action, known, "EDGE", node.node_id, bins)
            _check_action(action, why, order)


def _check_action(action: ActionOrder, why_not: str, order: Order) -> None:
    """Raise Rejected if an action is not possible, or has parameters that have no effect."""
    if why_not:
        names = order.names | {"actionId": action.action_id}
        raise Rejected("INVALID_ORDER_ACTION", why_not, names)
    keys = {parameter.key for parameter in action.action_parameters}
    unknown = sorted(keys.difference(("loadId", *IGNORED)))
    if unknown:
        why = f"{action.action_type}: cannot use {', '.join(unknown)}"
        raise unsupported(why, unknown[0], {"actionId": action.action_id})


def _why_not(
    action: ActionOrder,
    known: Mapping[str, VehicleAction],
    scope: str,
    node: str,
    bins: Collection[str],
) -> str:
    """Return why an action is not possible; '' if it is.

    `scope`: whether it stands at a node or at an edge. `node`: the node, or the end of the edge.
    """
    name = action.action_type
    kind = known.get(name)
    if kind is None:
        return f"no action {name}; there are {', '.join(known)}"
    if kind.scope != scope or not kind.is_done_at(node):
        return (
            f"{name} is not possible {WHERE[scope]} {node}, only {WHERE[kind.scope]} {kind.nodes}"
        )
    if scope == "EDGE" and action.blocking_type not in kind.blocking:
        blocking = " or ".join(kind.blocking)
        return f"{name} is done while driving: its blockingType must be {blocking}"
    load = action.value("loadId")
    if load is None:
        return f"{name} needs the parameter loadId, the name of a bin" if kind.needs_load else ""
    return "" if str(load) in bins else f"loadId: no bin {load}"


def _states(parts: Iterable[Node | Edge]) -> list[ActionState]:
    """Return the states of the actions of some nodes and edges, none of which has begun."""
    states = []
    for part in parts:
        for action in part.actions:
            states.append(ActionState(action.action_id, action.action_type))
    return states


def _begun(order: Order) -> OrderState:
    """Return what a vehicle knows with a new order."""
    first = order.nodes[0]
    return OrderState(
        order_id=order.order_id,
        update_id=order.order_update_id,
        content=order.content,
        last_node=first.node_id,
        last_sequence=first.sequence_id,
        nodes=order.nodes[1:],
        edges=order.edges,
        actions=_states([*order.nodes, *order.edges]),
        queue=list(first.actions),
    )


def _continued(state: OrderState, order: Order) -> OrderState:
    """Return what a vehicle knows with an update, which takes the place of the horizon.

    Its first node is known, and so are the actions there.
    """
    horizon = _ids_of_horizon(state)
    base_nodes = [node for node in state.nodes if node.released]
    base_edges = [edge for edge in state.edges if edge.released]
    base_actions = [action for action in state.actions if action.action_id not in horizon]
    return msgspec.structs.replace(
        state,
        update_id=order.order_update_id,
        content=order.content,
        nodes=[*base_nodes, *order.nodes[1:]],
        edges=[*base_edges, *order.edges],
        actions=[*base_actions, *_states([*order.nodes[1:], *order.edges])],
        errors=[error for error in state.errors if error.error_type in LASTING],
    )
