"""What a whole harvest lost its time to: parts that add up to its length (`lost_seconds`).

What batteries, waits in the bay and absences of pickers cost is the difference of two harvests of
the event model: one with them, and one of the same layout without them. An error of the model is in
both, so it counts as none of these costs.

A layout is "alone" here if no people, animals or tractor are in it, and its sensors are exact.
"""

from dataclasses import replace
from math import inf

from orchard.dispatch.policies import POLICIES
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.field.scenario.sections import Trailers, Truck
from orchard.plans.routes import ROUTES
from orchard.report.bounds import (
    harvested,
    ideal_of,
    proven_seconds_if_present,
    seconds_on_free_roads,
    undisturbed,
    with_nobody_away,
)


def lost_seconds(layout: Layout, seconds: float) -> dict[str, float]:
    """Split the length of a whole harvest, s, into parts that add up to it; {} if it has agents, a
    policy or a route of the user's own.

    Each part is what comes on top of the parts before it:

    - `optimum`: the time that is proven to be needed in any harvest without traffic and absences;
    - `dispatch`: what the policy, and robots that fail, lose without traffic;
    - `absences`: what pickers that are away cost;
    - `traffic`: what robots lose to each other;
    - `load_out`: what waits for trailers, the truck and empty bins cost;
    - `charging`: what batteries cost;
    - `people_and_animals`: the rest, which includes the tractor and errors of sensors.

    Without a proof the first two are one part, `schedule`.
    """
    scenario = layout.scenario
    if not _is_built_in(scenario):
        return {}
    alone = lay_out(undisturbed(scenario))
    has_batteries = scenario.has_batteries
    waits = scenario.load_out.has_trailers or scenario.load_out.has_truck
    costs = {}
    is_disturbed = alone.scenario != scenario
    # The length in the model of the harvest from which the next cost is taken away.
    modelled = seconds
    if has_batteries or waits or is_disturbed:
        modelled = _length_alone(alone, seconds)
    # The length without people and animals: without them it is that of the run itself.
    undisturbed_seconds = seconds
    if is_disturbed:
        undisturbed_seconds = modelled
    if has_batteries:
        alone = with_endless_batteries(alone)
        without_batteries = _length_alone(alone, modelled)
        costs["charging"] = modelled - without_batteries
        modelled -= costs["charging"]
    if waits:
        costs["load_out"] = modelled - _length_alone(with_nothing_to_wait_for(alone), modelled)
    parts = _parts_without_traffic(layout)
    parts["traffic"] = undisturbed_seconds - sum(costs.values()) - sum(parts.values())
    parts |= costs
    parts["people_and_animals"] = seconds - undisturbed_seconds
    # A small negative part is rounded to -0.0, and adding 0.0 makes that 0.0.
    return {name: round(part, 1) + 0.0 for name, part in parts.items()}


def _is_built_in(scenario: Scenario) -> bool:
    """Whether a scenario has no agents, no policy and no route of the user's own."""
    has_own_agents = bool(scenario.agents or scenario.agents_without_body)
    return not has_own_agents and scenario.dispatch in POLICIES and scenario.route in ROUTES


def _parts_without_traffic(layout: Layout) -> dict[str, float]:
    """Return the parts of a harvest's length, s, that it has on free roads, with batteries that
    last and a bay that takes each bin at once.
    """
    proven = proven_seconds_if_present(layout)
    # On free roads robots pass through each other: a carrier may stop at a lane while its picker
    # still stands there. So such a harvest can be shorter than what is proven, which then counts.
    present = with_nobody_away(without_waits(layout))
    schedule = max(seconds_on_free_roads(present), proven or 0.0)
    parts = {"schedule": schedule}
    if proven is not None:
        parts = {"optimum": proven, "dispatch": schedule - proven}
    if layout.scenario.picker_absences:
        parts["absences"] = seconds_without_waits(layout) - schedule
    return parts


def seconds_without_waits(layout: Layout) -> float:
    """Return the length of a harvest on free roads, with batteries that last and a bay that takes
    each bin at once, s.
    """
    return seconds_on_free_roads(without_waits(layout))


def without_waits(layout: Layout) -> Layout:
    """Return the layout without people, animals, tractor and errors of sensors, with batteries that
    last and a bay that takes each bin at once.
    """
    return with_nothing_to_wait_for(with_endless_batteries(ideal_of(layout)))


def _length_alone(layout: Layout, seconds: float) -> float:
    """Return the length of a harvest in the event model, s, at most `seconds`.

    A harvest that jams in the model has no length. Then it is `seconds`: nothing counts as lost.
    """
    harvest = harvested(layout)
    if not harvest.is_over:
        return seconds
    return min(seconds, harvest.seconds)


def with_endless_batteries(layout: Layout) -> Layout:
    """Return the same layout, its charging lines too, for carriers that never need to charge."""
    scenario = layout.scenario
    if not scenario.has_batteries:
        return layout
    battery = scenario.carrying.battery.model_copy(update={"hours": inf})
    carrying = scenario.carrying.model_copy(update={"battery": battery})
    return replace(layout, scenario=scenario.model_copy(update={"carrying": carrying}))


def with_nothing_to_wait_for(layout: Layout) -> Layout:
    """Return the same layout with a bay that takes each bin at once: without trailers and truck,
    and with endless empty bins. Carriers that drive to the load-out themselves still do.
    """
    scenario = layout.scenario
    load_out = scenario.load_out
    if not (load_out.has_trailers or load_out.has_truck):
        return layout
    nothing = {
        "metres": None,
        "speed": None,
        "seconds": 0.0,
        "seconds_away": None,
        "trailers": Trailers(),
        "truck": Truck(),
        "empty_bins": None,
    }
    free = load_out.model_copy(update=nothing)
    return replace(layout, scenario=scenario.model_copy(update={"load_out": free}))
