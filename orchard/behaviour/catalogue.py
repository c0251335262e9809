"""Which class drives which agent, and which agents are trusted.

The class is a built-in one, or the one that the scenario names. A trusted agent is one of ours
without a user's policy or route: its guard (orchard/contract/guard.py) need not check it.
"""

import logging
from collections.abc import Collection
from typing import Any

from orchard.behaviour.bin import Bin
from orchard.behaviour.carrier import Carrier
from orchard.behaviour.dispatcher import Dispatcher
from orchard.behaviour.picker import Picker
from orchard.behaviour.tractor import Tractor
from orchard.behaviour.traffic import Traffic
from orchard.behaviour.walker import Animal, Person
from orchard.behaviour.weed import Weed
from orchard.contract.agent import Agent
from orchard.contract.guard import Guard
from orchard.contract.messages import pack, unpack
from orchard.dispatch.policies import POLICIES, dispatch_of
from orchard.field.kinds import DISPATCH, TRAFFIC, kind_of, select_agents
from orchard.field.layout import Layout
from orchard.field.plugins import MISTAKES, load_plugin, made_of, place_of_class, unusable
from orchard.field.problems import ScenarioError
from orchard.field.queue import TOP_ROAD
from orchard.plans.robot import Step
from orchard.plans.routes import ROUTES, route_of
from orchard.plans.steps import DriveToBay, Haul, Plan, of_known_steps, with_steps

log = logging.getLogger("orchard")

AGENTS: dict[str, type[Any]] = {
    "picker": Picker,
    "carrier": Carrier,
    "bin": Bin,
    "tractor": Tractor,
    "worker": Person,
    "visitor": Person,
    "dog": Animal,
    "cat": Animal,
    "weed": Weed,
    TRAFFIC: Traffic,
    DISPATCH: Dispatcher,
}


def make_agents(layout: Layout, names: Collection[str] | None = None) -> dict[str, Guard]:
    """Make these agents of an orchard, or all. Return them by name, sorted."""
    # Agent -> the path of the user's class.
    own = agent_classes(layout)
    wanted = sorted(name for name in layout.agents if names is None or name in names)
    return {name: _made(own.get(name), layout, name) for name in wanted}


def agent_classes(layout: Layout) -> dict[str, str]:
    """Return the paths of the classes that the scenario names, by agent.

    A name overrides a kind. Raises ValueError for a word that is neither.
    """
    classes = layout.scenario.agents
    paths: dict[str, str] = dict(layout.scenario.agents_without_body)
    # Kinds first, so that names override them.
    for word in sorted(classes, key=lambda word: word in layout.agents):
        try:
            paths |= dict.fromkeys(select_agents(layout.agents, [word], []), classes[word])
        except ValueError as error:
            raise ValueError(f"agents.{error}") from None
    return paths


def check_plugins(layout: Layout) -> None:
    """Check a scenario's plug-ins.

    Raises ScenarioError or ValueError if a rule or route cannot be used, or an agent is unknown.
    """
    agent_classes(layout)
    for block in layout.blocks.values():
        layout.passes(block)
    _check_route(layout)
    dispatch_of(layout)


def _check_route(layout: Layout) -> None:
    """Make each plan of the route once.

    Raises ScenarioError where that fails, or a plan has a step that is not in `Steps`.
    """
    route = route_of(layout)
    path = layout.scenario.route
    if path in ROUTES:
        return
    try:
        # Memories with its steps must survive being sent.
        unpack(pack(with_steps(Plan, route.Steps)()), with_steps(Plan, route.Steps))
        for block in layout.blocks.values():
            of_known_steps(route.harvest(block), route.Steps)
            for pass_ in layout.passes(block):
                side = route.sides[pass_.end]
                # Which carrier, picker and bin it is changes nothing of what is checked.
                job = route.fetch(1, pass_.row, side, "picker_01", "bin_01")
                of_known_steps(job, route.Steps)
                _demand_haul(layout, job)
                _demand_bays(layout, job)
        route.roads()
        route.holds()
        route.distance(layout.queue.head, TOP_ROAD, 1, route.east)
    except MISTAKES as error:
        raise unusable("route", path, error, place=place_of_class(type(route))) from error


def _demand_haul(layout: Layout, job: Collection[Step]) -> None:
    """Raise ValueError if carriers go to a load-out, and a job of theirs does not."""
    if not layout.scenario.load_out.is_of_carriers:
        return
    if not any(isinstance(step, Haul) for step in job):
        raise ValueError(
            "load_out has no effect: fetch returns no step Haul; put *self.haul() before Home"
        )


def _demand_bays(layout: Layout, job: Collection[Step]) -> None:
    """Raise ValueError if several carriers unload at a time, and a job knows one place for it."""
    if layout.scenario.bays == 1:
        return
    if not any(isinstance(step, DriveToBay) for step in job):
        raise ValueError(
            "bays has no effect: fetch returns no step DriveToBay; end go_to_bay with self.to_bay()"
        )


def guarded(layout: Layout, name: str, agent: Agent) -> Guard:
    """Return an agent with its guard: trusted if it is built in, with its policy and route.

    Raises TypeError for a wrong `Memory`.
    """
    if isinstance(agent, Guard):
        return agent
    for class_ in AGENTS.values():
        if isinstance(agent, class_) and not (
            isinstance(agent.Memory, type) and issubclass(agent.Memory, class_.Memory)
        ):
            extend = f"its Memory must extend that of {class_.__name__}"
            example = f"`class Memory({class_.Memory.__name__})`, with a default for each field"
            raise TypeError(f"{extend}: {example}")
    are_ours = layout.scenario.dispatch in POLICIES and layout.scenario.route in ROUTES
    return Guard(name, agent, layout.agents, trusted=are_ours and type(agent) in AGENTS.values())


def _made(path: str | None, layout: Layout, name: str) -> Guard:
    """Make a built-in agent, or one of a user's class.

    If that fails, log the error and return an agent that stands.
    """
    if path is None:
        return guarded(layout, name, AGENTS[kind_of(name)](layout, name))
    key = f"agents.{name}"
    place = ""
    try:
        class_ = load_plugin(key, path)
        place = place_of_class(class_)
        agent = made_of(class_, layout, name)
        if not callable(getattr(agent, "tick", None)):
            raise TypeError("it has no method tick(observation, mail, memory)")
        return guarded(layout, name, agent)
    except MISTAKES as error:
        fault: BaseException = error
        if not isinstance(error, ScenarioError):
            fault = unusable(key, path, error, place=place)
        log.error("%s stands: %s", name, fault)
        return Guard(name, None, layout.agents)
