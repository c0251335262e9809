"""The limit of a question: what an orchard allows without traffic, whatever the seed.

A seed may draw how fast each row is picked. Then one run has the rows of its own seed, and its
summary has the limit of those rows. The page, `orchard bound` and a study ask about any such
orchard. So they show one limit: that of rows which are all picked in their mean time. It depends on
no seed, and on no number of runs.

Robots that pick fast rows by chance may exceed this limit, though not that of their own rows. So a
study shows what its runs tell of rows of the mean speed. A long run is asked for shares of its own
plan, and has the rate that follows from them and this limit (`orchard.report.long_run`). One
harvest has its own share of the limit of its own rows, times this limit (`rate_in_mean_rows`).

The limit counts full bins. The last bin of each picker in one harvest may be part full. So the rate
of a harvest, beside the limit, counts the full bins that its fruit would fill: `full_bins` of a
whole harvest, `delivered_full_bins` of a run up to now.
"""

from functools import lru_cache

from orchard.field.layout import KEPT_LAYOUTS, Layout, lay_out
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import Scenario, Spread
from orchard.report.bounds import Bounds

SEEDS = 2**63
# A seed that the limit uses whatever the scenario's is. With built-in classes any other gives the
# same limit.
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
    picking = scenario.picking.model_copy(
        update={"spread": Spread(), "spread_of_pickers": Spread()}
    )
    return with_seed(scenario, LIMIT_SEED).model_copy(update={"picking": picking})


@lru_cache(maxsize=KEPT_LAYOUTS)
def _bounds(layout: Layout) -> Bounds:
    return Bounds(layout)


def rate_in_mean_rows(rate: float, own_limit: float, limit: Bounds) -> float:
    """Return the rate that a run would have in rows of the mean speed, bins/h.

    It is as far below the limit as the run was below that of its own rows. `rate`: of the run,
    `own_limit`: of its rows, both in bins/h; `limit`: that of rows of the mean speed.
    """
    return rate * (limit.bins_per_hour / own_limit)


def full_bins(layout: Layout) -> float:
    """Return how many full bins the fruit of a harvest fills; all of them if a row fills one."""
    if layout.scenario.bin_metres is None:
        return layout.bins
    return sum(lane.length for lane in layout.lanes) / layout.scenario.bin_metres


def delivered_full_bins(layout: Layout, bins: int, metres: float) -> float:
    """Return how many full bins the fruit of the bins that were delivered fills.

    `metres`: of row that are in them.
    """
    metres_of_full = layout.scenario.bin_metres
    if metres_of_full is None or metres >= bins * (metres_of_full - FULL_WITHIN):
        return bins
    return metres / metres_of_full
