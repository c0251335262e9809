"""The limit of a question: what an orchard allows without traffic, whatever the seed.

A scenario may let the seed draw how fast each row is picked (`picking.spread`). Then one run has
the rows of its seed, and its summary has the limit of those rows. The page, `orchard bound` and
`orchard study` ask about the orchard, whatever the seed. So they show one limit: that of rows which
are all picked in their mean time. It depends neither on the seed nor on the number of runs.

A run whose rows are fast by chance may exceed this limit, though not the limit of its own rows. So
`orchard study` converts the rate of each run to rows of the mean speed. The long run computes its
rate so from the beginning (`orchard.report.long_run`). The rate of one harvest is divided by the
limit of its own rows, and multiplied by this limit (`rate_in_mean_rows`).

The limit counts full bins, but the last bin of each picker in a harvest may be part full. So where
the rate of a harvest stands beside the limit, it counts the full bins that its fruit would fill:
`full_bins` of a whole harvest, `delivered_full_bins` of a run up to now.
"""

from functools import lru_cache

from orchard.field.layout import KEPT_LAYOUTS, Layout, lay_out
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import Scenario
from orchard.report.bounds import Bounds

# Seeds of scenarios are 0 to SEEDS - 1.
SEEDS = 2**63
# The seed with which the limit is computed, whatever the scenario's is. Any other gives the same
# limit, unless a class of the user's own draws by the seed.
LIMIT_SEED = 1


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario with another seed. After the last seed comes the first one again."""
    return scenario.model_copy(update={"seed": seed % SEEDS})


def limit_of_question(scenario: Scenario) -> Bounds:
    """Return the limit of a scenario without traffic, in rows that are picked in their mean time.

    Raises ScenarioError if it names own classes that cannot be used.
    """
    return _bounds(lay_out(in_mean_rows(scenario)))


def in_mean_rows(scenario: Scenario) -> Scenario:
    """Return the scenario with pickers and rows that take their mean times, whatever its seed."""
    picking = scenario.picking.in_mean_times
    return with_seed(scenario, LIMIT_SEED).model_copy(update={"picking": picking})


@lru_cache(maxsize=KEPT_LAYOUTS)
def _bounds(layout: Layout) -> Bounds:
    return Bounds(layout)


def rate_in_mean_rows(rate: float, own_limit: float, limit: Bounds) -> float:
    """Return the rate that a run would have in rows of the mean speed, bins/h.

    It is the same share of the limit there as the run's rate is of the limit of its own rows.
    `rate`: of the run, bins/h. `own_limit`: of the run's rows, bins/h. `limit`: of rows of the mean
    speed.
    """
    return rate * (limit.bins_per_hour / own_limit)


def full_bins(layout: Layout) -> float:
    """Return how many full bins the fruit of a harvest fills. Where each row fills one bin, that is
    the number of rows.
    """
    if layout.scenario.bin_metres is None:
        return layout.bins
    return sum(lane.length for lane in layout.lanes) / layout.scenario.bin_metres


def delivered_full_bins(layout: Layout, bins: int, metres: float) -> float:
    """Return how many full bins the fruit of delivered bins fills.

    `bins`: how many bins were delivered. `metres`: how many metres of row were picked into them.
    """
    metres_of_full = layout.scenario.bin_metres
    if metres_of_full is None or metres >= bins * (metres_of_full - FULL_WITHIN):
        return bins
    return metres / metres_of_full
