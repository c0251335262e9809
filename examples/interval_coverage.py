"""Do the intervals of a study hold the truth as often as they say? Many small studies by the fast
model, as docs/study.md tells of them.

The truth of each setting is its mean over many other seeds.

    python examples/interval_coverage.py [--truth SEEDS] [STUDIES]
"""

import argparse
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
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
CONFIDENCE, WITHIN = 0.95, 0.03
TRUTH = 10**6  # the first of the other seeds
FIXED = "one setting, 5 replications"
LEADS = "a study, the leads of the best mean together"
STANDINGS = "a study, what it says of all settings together"


@cache
def rate(carriers: int, seed: int) -> float:
    """Return the bins per hour of a harvest."""
    harvest = DiscreteHarvest(
        lay_out(ORCHARD.model_copy(update={"carriers": carriers, "seed": seed}))
    ).run()
    return 3600.0 * harvest.delivered / harvest.seconds


def compared(study: int) -> Comparison:
    """Return what a study knows when nothing is undecided, or at its last look."""
    for look in LOOKS:
        seen = {
            i: [rate(carriers, 1000 * study + n) for n in range(look)]
            for i, carriers in enumerate(CARRIERS)
        }
        found = compare(seen, dict(enumerate(CARRIERS)), True, CONFIDENCE, WITHIN)
        if not found.undecided:
            break
    return found


def holds(one: Interval, truth: float) -> bool:
    return one.low <= truth <= one.high


def outcomes(study: int, truth: Mapping[int, float]) -> Iterator[tuple[str, bool]]:
    """Yield what of a study held the truth."""
    for carriers in CARRIERS:
        yield (
            FIXED,
            holds(
                interval([rate(carriers, 1000 * study + n) for n in range(LOOKS[0])], CONFIDENCE),
                truth[carriers],
            ),
        )
    found, rates = compared(study), [truth[carriers] for carriers in CARRIERS]
    top = min(found.ahead, key=lambda i: abs(found.ahead[i]))
    known = {i: lead for i, lead in found.leads.items() if lead is not None}
    yield LEADS, all(holds(lead, (rates[top] - rates[i]) / rates[i]) for i, lead in known.items())
    is_worse = [max(rates) / rate - 1.0 >= WITHIN for rate in rates]
    yield (
        STANDINGS,
        all(
            is_worse[i] == (found.standing(i) == "worse")
            for i in known
            if found.standing(i) != "unknown"
        ),
    )


def told(study: int, truth: Mapping[int, float]) -> list[tuple[str, bool]]:
    return list(outcomes(study, truth))


def main() -> None:
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
        seeds = range(TRUTH, TRUTH + arguments.truth)
        truth = {
            carriers: fmean(pool.map(rate, [carriers] * len(seeds), seeds, chunksize=50))
            for carriers in CARRIERS
        }
        studies = pool.map(told, range(1, arguments.studies + 1), [truth] * arguments.studies)
        found = [one for study in studies for one in study]
    for kind in (FIXED, LEADS, STANDINGS):
        held = [is_held for name, is_held in found if name == kind]
        low, high = stats.binomtest(sum(held), len(held)).proportion_ci(0.95)
        print(
            f"{kind}: {100 * fmean(held):.1f} % of {len(held)} (95 %: {100 * low:.1f} to"
            f" {100 * high:.1f})"
        )


if __name__ == "__main__":
    main()
