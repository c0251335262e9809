"""What a vehicle knows of its order, and how that changes while it follows the order."""

from collections.abc import Iterator
from typing import Literal

import msgspec

from orchard_vda5050.errors import Error
from orchard_vda5050.parts import MessagePart
from orchard_vda5050.received import ActionOrder, Edge, Node

ActionStatus = Literal[
    "WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"
]


class ActionState(MessagePart):
    """How far an action is."""

    action_id: str
    action_type: str
    action_status: ActionStatus = "WAITING"


class OrderState(msgspec.Struct):
    """The order of a vehicle.

    `last_node`: to which the vehicle came last, and `last_sequence`, its sequenceId. `nodes` and
    `edges` lie ahead; the base comes before the horizon. `actions`: how far each action of the
    order is. `queue`: the actions of the last node that are not done; the first one runs.
    `content`: a digest of the newest update.
    """

    order_id: str = ""
    update_id: int = 0
    content: bytes = b""
    last_node: str = ""
    last_sequence: int = 0
    nodes: list[Node] = []
    edges: list[Edge] = []
    actions: list[ActionState] = []
    queue: list[ActionOrder] = []
    errors: list[Error] = []
    is_cancelled: bool = False

    @property
    def is_idle(self) -> bool:
        """Whether nothing of it is left to do."""
        return not self.nodes and not self.queue

    @property
    def may_leave(self) -> bool:
        """Whether it leads on from the last node, and fleet control has released that."""
        return bool(self.nodes) and self.nodes[0].released

    @property
    def decision_point(self) -> tuple[str, int]:
        """The last node of the base: its name, and its sequenceId."""
        base = [node for node in self.nodes if node.released]
        if not base:
            return self.last_node, self.last_sequence
        return base[-1].node_id, base[-1].sequence_id

    def loads(self) -> Iterator[str]:
        """Yield the bins that the order names."""
        for actions in (self.queue, *(node.actions for node in self.nodes)):
            for action in actions:
                if action.load:
                    yield action.load

    def set(self, action_id: str, status: ActionStatus) -> None:
        """Note how far an action is."""
        for state in self.actions:
            if state.action_id == action_id:
                state.action_status = status

    def status_of(self, action: ActionOrder) -> ActionStatus:
        """Return how far an action is."""
        for state in self.actions:
            if state.action_id == action.action_id:
                return state.action_status
        return "WAITING"


def arrive(state: OrderState) -> None:
    """Note that the vehicle is at the next node, where its actions are to be done."""
    node = state.nodes.pop(0)
    del state.edges[0]
    state.last_node = node.node_id
    state.last_sequence = node.sequence_id
    state.queue = list(node.actions)


def cancel(state: OrderState, is_driving: bool) -> None:
    """Give up all that has not begun.

    A vehicle that drives goes on to the next node; an action that runs is finished.
    """
    # Of the nodes ahead, the one to which it drives is kept, without its actions.
    kept_count = 1 if is_driving else 0
    state.nodes = [msgspec.structs.replace(node, actions=[]) for node in state.nodes[:kept_count]]
    state.edges = state.edges[:kept_count]
    state.queue = [action for action in state.queue if state.status_of(action) == "RUNNING"]
    state.is_cancelled = True
    for action in state.actions:
        if action.action_status == "WAITING":
            action.action_status = "FAILED"
