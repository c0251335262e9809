"""Harvests in which a bag drives robots: what must be installed, and what is refused.

A bag is a recording of ROS 2. The velocities in it drive some robots in place of their agents.
"""

from pathlib import Path

from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import Agent
from orchard.field.layout import lay_out
from orchard.field.problems import printable
from orchard.field.scenario import Scenario
from orchard.launch.options import HarvestOptions
from orchard.launch.scenarios import changed, scenario_of
from orchard.server.options import last_tick
from orchard.terminal.exits import needs_extra

with needs_extra("A bag", "ros2-export"):
    from orchard.bags.replay import check_robots, read_commands, replayed
    from orchard.bags.velocities import BagVelocities


def scenario_and_velocities(chosen: HarvestOptions, bag: Path) -> tuple[Scenario, BagVelocities]:
    """Return the scenario of a run, and which velocities of the bag drive at which tick.

    The scenario is that of the bag, unless the bag has none or a file is given. Raises
    ScenarioError, OSError or ValueError.
    """
    commands = read_commands(bag, chosen.from_first_stamp)
    if commands.scenario is None or chosen.scenario:
        scenario = scenario_of(chosen.scenario, chosen.changes)
    else:
        scenario = changed(commands.scenario, chosen.changes)
        if not chosen.own_code:
            _refuse_code(chosen, bag, scenario)
    check_robots(bag, commands, lay_out(scenario).index)
    velocities = BagVelocities(bag, commands.ticks)
    velocities.check(last_tick(chosen.duration))
    return scenario, velocities


def _refuse_code(chosen: HarvestOptions, bag: Path, scenario: Scenario) -> None:
    """Raise ValueError if the scenario of a bag names code: a bag may come from others.

    Code that the user has typed as an option is fine.
    """
    code = []
    for key, path in scenario.own_classes.items():
        if chosen.changes.get(key) != path:
            code.append(f"{key}: {path}")
    if code:
        raise ValueError(
            f"{bag}: its scenario names code, which can do whatever you can: "
            f"{printable(', '.join(code), 500)}; "
            "--own-code imports it, a SCENARIO.yaml replaces it"
        )


def replayed_agents(scenario: Scenario, bag: Path, from_first_stamp: bool) -> dict[str, Agent]:
    """Return the agents of a scenario, some of which the velocities of a bag replace."""
    commands = read_commands(bag, from_first_stamp)
    return replayed(make_agents(lay_out(scenario)), commands)
