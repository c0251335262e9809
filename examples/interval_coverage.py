"""Do the intervals of a study hold the truth as often as they say? Many small studies by the fast
model, as docs/study.md tells of them.

Each study compares the same settings, 1, 2 and 3 carriers, on seeds of its own. The truth of a
setting is its mean over many other seeds.

    python examples/interval_coverage.py [--truth SEEDS] [STUDIES]
"""

import argparse
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import chain
from statistics import fmean

from scipy import stats

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.study.comparing import LOOKS, Comparison, compare, interval
from orchard.study.result import Interval

NOBODY = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
}
ORCHARD = Scenario(
    rows=4,
    pickers=2,
    row_length=30.0,
    picking_speed=0.3,
    picking={"spread": {"distribution": "gamma"}},
    **NOBODY,
)
CARRIERS = (1, 2, 3)
CONFIDENCE = 0.95
# A setting is as good as the best if it is at most this share behind.
WITHIN = 0.03
# The first of the seeds of a study is its number times this; far beyond begin those of the truth.
SEEDS_OF_A_STUDY = 1000
FIRST_SEED_OF_TRUTH = 10**6
# What is asked of a study: whether each of these held the truth.
FIXED = "one setting, 5 replications"
LEADS = "a study, the leads of the best mean together"
STANDINGS = "a study, what it says of all settings together"


@cache
def rate(carriers: int, seed: int) -> float:
    """Return the bins per hour of a harvest."""
    scenario = ORCHARD.model_copy(update={"carriers": carriers, "seed": seed})
    harvest = DiscreteHarvest(lay_out(scenario)).run()
    return 3600.0 * harvest.delivered / harvest.seconds


def compared(study: int) -> Comparison:
    """Return what a study knows when nothing is undecided, or at its last look.

    A setting has a number: its place in CARRIERS.
    """
    for replications in LOOKS:
        rates = {}
        for number, carriers in enumerate(CARRIERS):
            rates[number] = rates_of(carriers, study, replications)
        comparison = compare(rates, dict(enumerate(CARRIERS)), True, CONFIDENCE, WITHIN)
        if not comparison.undecided:
            break
    return comparison


def rates_of(carriers: int, study: int, replications: int) -> list[float]:
    """Return the rates of the first replications of a setting in a study."""
    first = SEEDS_OF_A_STUDY * study
    return [rate(carriers, seed) for seed in range(first, first + replications)]


def holds(known: Interval, truth: float) -> bool:
    """Whether an interval holds the truth."""
    return known.low <= truth <= known.high


def outcomes(study: int, truth: Mapping[int, float]) -> Iterator[tuple[str, bool]]:
    """Yield what is asked of a study, and whether it held the truth.

    `truth`: carriers -> the true rate.
    """
    for carriers in CARRIERS:
        known = interval(rates_of(carriers, study, LOOKS[0]), CONFIDENCE)
        yield FIXED, holds(known, truth[carriers])
    comparison = compared(study)
    rates = [truth[carriers] for carriers in CARRIERS]
    # The best mean is ahead of itself by nothing.
    best = min(comparison.ahead, key=lambda number: abs(comparison.ahead[number]))
    leads_hold = True
    standings_hold = True
    for number, lead in comparison.leads.items():
        if lead is None:
            continue
        true_lead = (rates[best] - rates[number]) / rates[number]
        leads_hold &= holds(lead, true_lead)
        is_worse = max(rates) / rates[number] - 1.0 >= WITHIN
        standing = comparison.standing(number)
        if standing != "unknown":
            standings_hold &= is_worse == (standing == "worse")
    yield LEADS, leads_hold
    yield STANDINGS, standings_hold


def outcomes_of(study: int, truth: Mapping[int, float]) -> list[tuple[str, bool]]:
    """Return the outcomes of a study. Another process can send a list back, and no generator."""
    return list(outcomes(study, truth))


def main() -> None:
    """Do all studies, and print how often each held the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--truth",
        type=int,
        default=500,
        metavar="SEEDS",
        help="how many other seeds tell the truth",
    )
    parser.add_argument("studies", type=int, nargs="?", default=200, metavar="STUDIES")
    arguments = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        seeds = range(FIRST_SEED_OF_TRUTH, FIRST_SEED_OF_TRUTH + arguments.truth)
        truth = {}
        for carriers in CARRIERS:
            truth[carriers] = fmean(pool.map(rate, [carriers] * len(seeds), seeds, chunksize=50))
        numbers = range(1, arguments.studies + 1)
        studies = pool.map(outcomes_of, numbers, [truth] * arguments.studies)
        results = list(chain.from_iterable(studies))
    for kind in (FIXED, LEADS, STANDINGS):
        held = [is_held for name, is_held in results if name == kind]
        low, high = stats.binomtest(sum(held), len(held)).proportion_ci(0.95)
        print(
            f"{kind}: {100 * fmean(held):.1f} % of {len(held)} (95 %: {100 * low:.1f} to"
            f" {100 * high:.1f})"
        )


if __name__ == "__main__":
    main()
