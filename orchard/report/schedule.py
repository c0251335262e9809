"""The schedule of a harvest without traffic: the discrete-event model with roads that each robot has to itself.

It is an ideal to compare a harvest with, for the policy and the route of the scenario; for a policy of the user's own it is that of
`nearest`, for a route with steps of its own the built-in one with the same queue. It is not a proof: another policy may be faster.
"""

from bisect import bisect_left

from orchard.agents.policies import POLICIES
from orchard.agents.routes import route_of
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.queue import PITCH, queue_of
from orchard.field.scenario import TIME_STEP, Scenario

WORTH = 0.01  # share of the harvest's time by which a number of carriers must shorten it to be worth its cost


def undisturbed(scenario: Scenario, **changes: object) -> Scenario:
    """Return a scenario without its people, animals and tractor, with exact sensors, and with other changes."""
    nothing = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "tractor": False, "sensors": {}}
    return Scenario(**scenario.model_dump() | nothing | changes)


def schedule_seconds(layout: Layout, carriers: int | None = None) -> float:
    """Return the time of the harvest with this number of carriers, s; None: those of the scenario."""
    scenario, route = layout.scenario, route_of(layout)
    own = {
        "agents": {},
        "agents_without_body": {},
        "dispatch": scenario.dispatch if scenario.dispatch in POLICIES else "nearest",
        "route": route.QUEUE if route.Steps else scenario.route,
        "carriers": carriers or scenario.carrier_count,
    }
    ideal = lay_out(undisturbed(scenario, **own))
    stood = {"picker": 0.0, "carrier": 0.0}
    for robot in DiscreteHarvest(ideal, free_roads=True).run().robots.values():
        stood[kind_of(robot.name)] = max(stood[kind_of(robot.name)], robot.stood * TIME_STEP)
    others = min(ideal.scenario.carrier_count, ideal.queue.places) - 1  # before the last carrier, which stops behind them in its line
    return max(stood["picker"], stood["carrier"] - others * PITCH)


def enough_carriers(layout: Layout) -> int:
    """Return the number of carriers beyond which more shorten this harvest by at most 1 % (`WORTH`): at most the number of its bins."""
    scenario, queue = layout.scenario, route_of(layout).QUEUE
    numbers = [number for number in range(1, scenario.rows + 1) if queue_of(queue, scenario.row_length, scenario.bay, number)]
    best = schedule_seconds(layout, numbers[-1])
    return numbers[bisect_left(numbers, True, key=lambda number: schedule_seconds(layout, number) * (1.0 - WORTH) <= best)]
