"""Do the intervals of a study hold the truth as often as they say? Many small studies by the fast
model, as docs/study.md tells of them.

Each orchard has a pool of harvests: each number of carriers on the same seeds. A study draws its
seeds from the pool, so the truth of a setting is its mean over the whole pool.

    python examples/interval_coverage.py [--seeds SEEDS] [STUDIES]
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import chain, repeat
from statistics import fmean

import numpy as np
from scipy import stats

from orchard import Scenario
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.study.comparing import LOOKS, Comparison, compare, interval
from orchard.study.result import Interval

QUIET = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "picking_speed": 0.3,
}
SMALL = QUIET | {"rows": 4, "pickers": 2, "row_length": 30.0}
GAMMA = {"distribution": "gamma"}
# A robot works for an hour until it fails, which is six harvests; or for 20,000 s.
OFTEN = {"failure": {"mean_between": 3600.0, "mean_repair": 600.0}}
RARELY = {"failure": {"mean_between": 20_000.0, "mean_repair": 900.0}}
# Name -> an orchard, and the most carriers that are tried.
ORCHARDS = {
    "rows differ (gamma)": (Scenario(**SMALL, picking={"spread": GAMMA}), 3),
    "rows differ (lognormal)": (
        Scenario(
            **QUIET,
            rows=6,
            pickers=3,
            row_length=40.0,
            picking={"spread": {"distribution": "lognormal", "cv": 0.28}},
        ),
        5,
    ),
    "rows differ (uniform)": (
        Scenario(
            **SMALL | {"pickers": 4}, picking={"spread": {"distribution": "uniform", "cv": 0.2}}
        ),
        4,
    ),
    "robots fail often": (Scenario(**SMALL, picking={"spread": GAMMA} | OFTEN, carrying=OFTEN), 3),
    "carriers fail rarely": (Scenario(**SMALL, carrying=RARELY), 3),
}
CONFIDENCE = 0.95
# A setting is as good as the best if it is at most this share behind.
WITHIN = 0.03
FIRST_SEED = 1000
# Replications after which the interval of a setting's own rate is looked at.
COUNTS = (5, 10, 20, 40)
# What is asked of a study: whether each of these held the truth.
ALONE = {count: f"one setting, {count} replications" for count in COUNTS}
AT_END = "one setting, when the study ends"
LEADS = "a study, the leads of the best mean together"
STANDINGS = "a study, what it says of all settings together"


def rate(scenario: Scenario, seed: int) -> float:
    """Return the bins per hour of a harvest."""
    harvest = DiscreteHarvest(lay_out(scenario.model_copy(update={"seed": seed}))).run()
    return 3600.0 * harvest.delivered / harvest.seconds


def pool_of(name: str, seeds: int, executor: ProcessPoolExecutor) -> np.ndarray:
    """Return the rates of an orchard, (seeds, settings): its harvests with 1, 2, ... carriers."""
    scenario, most = ORCHARDS[name]
    rates = []
    for carriers in range(1, most + 1):
        setting = scenario.model_copy(update={"carriers": carriers})
        numbers = range(FIRST_SEED, FIRST_SEED + seeds)
        rates.append(list(executor.map(rate, repeat(setting), numbers, chunksize=50)))
    return np.transpose(rates)


def compared(rates: np.ndarray) -> Comparison:
    """Return what a study knows when nothing is undecided, or at its last look.

    `rates`: of all its replications, (replications, settings). A setting has a number: its column.
    """
    robots = dict(enumerate(range(rates.shape[1])))
    for replications in LOOKS:
        samples = dict(enumerate(rates[:replications].T.tolist()))
        comparison = compare(samples, robots, True, CONFIDENCE, WITHIN)
        if not comparison.undecided:
            break
    return comparison


def has_width(known: Interval) -> bool:
    """Whether a study shows an interval: not if all its runs agree, by luck."""
    return known.high > known.low


def holds(known: Interval, truth: float) -> bool:
    """Whether an interval holds the truth."""
    return known.low <= truth <= known.high


def outcomes(comparison: Comparison, truth: Sequence[float]) -> Iterator[tuple[str, bool]]:
    """Yield what is asked of a study, and whether it held the truth: the rate of each setting."""
    best = truth[comparison.top]
    leads_hold = True
    standings_hold = True
    for number, true_rate in enumerate(truth):
        lead = comparison.interval_shown(number)
        if lead is not None:
            leads_hold &= holds(lead, (best - true_rate) / true_rate)
        is_worse = max(truth) / true_rate - 1.0 >= WITHIN
        standing = comparison.standing(number)
        if standing != "unknown":
            standings_hold &= is_worse == (standing == "worse")
    yield LEADS, leads_hold
    yield STANDINGS, standings_hold


def studied(pool: np.ndarray, study: int) -> tuple[int, list[tuple[str, bool]]]:
    """Return how many replications a study makes, and its outcomes."""
    truth = pool.mean(axis=0).tolist()
    rows = np.random.default_rng(study).integers(0, len(pool), LOOKS[-1])
    rates = pool[rows]
    comparison = compared(rates)
    results = list(outcomes(comparison, truth))
    for count, kind in (*ALONE.items(), (comparison.count, AT_END)):
        for values, true_rate in zip(rates[:count].T, truth, strict=True):
            known = interval(values.tolist(), CONFIDENCE)
            if has_width(known):
                results.append((kind, holds(known, true_rate)))
    return comparison.count, results


def tell(name: str, pool: np.ndarray, studies: int) -> None:
    """Do all studies of an orchard, and print how often each held the truth."""
    counts, results = zip(*(studied(pool, study) for study in range(studies)), strict=True)
    print(f"{name}, {pool.shape[1]} settings, {fmean(counts):.1f} replications of each on average")
    for kind in (*ALONE.values(), AT_END, LEADS, STANDINGS):
        held = [is_held for asked, is_held in chain.from_iterable(results) if asked == kind]
        if not held:
            print(f"  {kind}: no interval, because all runs agree")
            continue
        low, high = stats.binomtest(sum(held), len(held)).proportion_ci(0.95)
        print(
            f"  {kind}: {100 * fmean(held):.1f} % of {len(held)} (95 %: {100 * low:.1f} to"
            f" {100 * high:.1f})"
        )


def main() -> None:
    """Do the studies of all orchards."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seeds", type=int, default=800, metavar="SEEDS", help="how many are in a pool"
    )
    parser.add_argument("studies", type=int, nargs="?", default=200, metavar="STUDIES")
    arguments = parser.parse_args()
    with ProcessPoolExecutor() as executor:
        for name in ORCHARDS:
            tell(name, pool_of(name, arguments.seeds, executor), arguments.studies)


if __name__ == "__main__":
    main()
