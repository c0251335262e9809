"""What agents remember when a run goes on with something changed."""

from collections.abc import Collection, Mapping
from typing import Any

from orchard.behaviour.carrier import Carrier, CarrierMemory
from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import Agent
from orchard.contract.guard import Guard
from orchard.contract.messages import pack, unpack
from orchard.field.kinds import DISPATCH
from orchard.field.layout import Layout
from orchard.plans.robot import Step


def memories_after(
    before: Layout,
    after: Layout,
    memories: Mapping[str, bytes | None],
    elsewhere: Collection[str],
    places: Mapping[str, int],
) -> dict[str, bytes | None]:
    """Return the memories with which agents go on: agent -> memory.

    `memories`: those until now. `elsewhere`: agents that clients elsewhere replaced. `places`:
    carrier -> its place in the queue, from 1. An agent of another class, or one in place of a
    client elsewhere, begins anew if the memory is not its own. So does the dispatcher if the policy
    or the carriers are others: it hears of all bins within 2 s. Raises ValueError for a memory
    that should fit.
    """
    old_agents = make_agents(before)
    new_agents = make_agents(after)
    staying = {name: memory for name, memory in memories.items() if name in new_agents}
    if _dispatches_otherwise(before, after):
        staying.pop(DISPATCH, None)
    has_other_classes = before.scenario.own_classes != after.scenario.own_classes
    may_begin_anew = elsewhere
    if has_other_classes:
        may_begin_anew = new_agents
    # Carriers that begin now; what the others remember takes the place of it below.
    going_on: dict[str, bytes | None] = _begun_carriers(new_agents, places)
    for name, remembered in _fitting(staying, new_agents, may_begin_anew).items():
        if name in places and isinstance(remembered, CarrierMemory):
            remembered.queue_place = places[name]
        is_replanned = staying[name] is not None and _replan(
            remembered, old_agents[name].agent, new_agents[name].agent
        )
        # A memory that stays the same stays so to the byte.
        going_on[name] = staying[name]
        if is_replanned:
            going_on[name] = pack(remembered)
    return going_on


def _begun_carriers(
    agents: Mapping[str, Guard], places: Mapping[str, int]
) -> dict[str, bytes | None]:
    """Return the memories of carriers that begin at their places in the queue.

    A carrier of another class than `Carrier` begins without a memory, and is left out.
    """
    begun = dict[str, bytes | None]()
    for name, place in places.items():
        carrier = agents[name].agent
        if isinstance(carrier, Carrier):
            begun[name] = pack(carrier.begin(place))
    return begun


def _fitting(
    memories: Mapping[str, bytes | None],
    agents: Mapping[str, Guard],
    may_begin_anew: Collection[str],
) -> dict[str, Any]:
    """Return the memories that fit their agents, unpacked: agent -> memory, None if it has none.

    `may_begin_anew`: agents whose memory is left out if it does not fit. Raises ValueError for
    another one that does not.
    """
    fitting = dict[str, Any]()
    for name, memory in memories.items():
        if memory is None:
            fitting[name] = None
            continue
        try:
            fitting[name] = unpack(memory, agents[name].Memory)
        except ValueError:
            if name not in may_begin_anew:
                raise
    return fitting


def _replan(memory: Any, before: Agent, after: Agent) -> bool:
    """Let the plan in a memory follow the course that its agent has now.

    A course is all steps of which a plan is a part, see `Carrier.course`. Return whether both
    agents, the one before and the one after, have a course.
    """
    old_course = getattr(before, "course", None)
    new_course = getattr(after, "course", None)
    if not old_course or not new_course:
        return False
    memory.plan = _plan_on(memory.plan, old_course(memory), new_course(memory))
    return True


def _plan_on(plan: list[Step], before: list[Step], after: list[Step]) -> list[Step]:
    """Return a plan that was a part of one course as the same part of another one.

    `before`, `after`: both courses, of equally many steps. A plan that was done ends where the
    course ends now.
    """
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    if not plan and changed and before[-1] != after[-1]:
        return after[-1:]
    return [_step_now(step, changed) for step in plan]


def _step_now(step: Step, changed: list[tuple[Step, Step]]) -> Step:
    """Return what has taken the place of a step; the step itself if it has not changed.

    `changed`: pairs of steps, before and now.
    """
    for old, new in changed:
        if old == step:
            return new
    return step


def _dispatches_otherwise(before: Layout, after: Layout) -> bool:
    """Whether the dispatcher begins anew: with another policy, or other carriers."""
    has_other_policy = before.scenario.dispatch != after.scenario.dispatch
    has_other_carriers = before.scenario.carrier_count != after.scenario.carrier_count
    return has_other_policy or has_other_carriers
