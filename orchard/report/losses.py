"""What a harvest lost, and to what: its length against that at the best long-run rate, split into parts that add up."""

from orchard.agents.dispatch import POLICIES
from orchard.agents.routes import ROUTES
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.report.bounds import Bounds
from orchard.report.schedule import Schedule

REFERENCE = "predictive"  # the default policy, which is best on the whole: docs/bounds.md


def lost_seconds(layout: Layout, seconds: float) -> dict[str, float]:
    """Split the length of a whole harvest, s, into parts that add up to it; {} if it has agents, a policy or a route of the user's own.

    `long_run`: its bins at the long-run rate without traffic. `structure`: what is lost to its begin and its end. `traffic`: what robots
    lose to each other. These three are of the policy `REFERENCE`. `dispatch`: what the scenario's own policy loses against it, negative if
    it is better. `people_and_animals`: the rest.
    """
    scenario = layout.scenario
    if scenario.agents or scenario.agents_without_body or scenario.dispatch not in POLICIES or scenario.route not in ROUTES:
        return {}
    alone = undisturbed(scenario)
    reference = lay_out(Scenario(**alone.model_dump() | {"dispatch": REFERENCE}))
    long_run = scenario.rows / min(Bounds(reference).terms_at(0.0).values())
    schedule = Schedule(reference).seconds(scenario.carrier_count)
    best = DiscreteHarvest(reference).run().seconds
    own = seconds if alone == scenario else min(seconds, DiscreteHarvest(lay_out(alone)).run().seconds)
    parts = {"long_run": long_run, "structure": schedule - long_run, "traffic": best - schedule, "dispatch": own - best}
    return {name: round(part, 1) for name, part in (parts | {"people_and_animals": seconds - own}).items()}


def undisturbed(scenario: Scenario) -> Scenario:
    """Return a scenario without its people, animals and tractor, with exact sensors."""
    nothing = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "tractor": False, "sensors": {}}
    return Scenario(**scenario.model_dump() | nothing)
