"""What a harvest lost, and to what: its length against that at the rate that its parts allow, split into parts that add up."""

from orchard.agents.policies import POLICIES
from orchard.agents.routes import ROUTES
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import Layout, lay_out
from orchard.report.bounds import Bounds
from orchard.report.schedule import schedule_seconds, undisturbed

REFERENCE = "predictive"  # the default policy, which is best on the whole: docs/bounds.md


def lost_seconds(layout: Layout, seconds: float) -> dict[str, float]:
    """Split the length of a whole harvest, s, into parts that add up to it; {} if it has agents, a policy or a route of the user's own.

    `limit`: its bins at the rate that its parts allow in the long run without traffic. `structure`: what is lost to its begin and its end.
    `traffic`: what robots lose to each other. These three are of the policy `REFERENCE`. `dispatch`: what the scenario's own policy loses
    against it, negative if it is better. `people_and_animals`: the rest.
    """
    scenario = layout.scenario
    if scenario.agents or scenario.agents_without_body or scenario.dispatch not in POLICIES or scenario.route not in ROUTES:
        return {}
    alone = undisturbed(scenario)
    reference = lay_out(undisturbed(scenario, dispatch=REFERENCE))
    limit = 3600.0 * scenario.rows / Bounds(reference).bins_per_hour
    schedule = schedule_seconds(reference)
    best = DiscreteHarvest(reference).run().seconds
    own = seconds if alone == scenario else min(seconds, DiscreteHarvest(lay_out(alone)).run().seconds)
    parts = {"limit": limit, "structure": schedule - limit, "traffic": best - schedule, "dispatch": own - best}
    return {name: round(part, 1) for name, part in (parts | {"people_and_animals": seconds - own}).items()}
