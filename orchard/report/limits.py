"""The limit of a question: a mean over seeds, where each seed draws how fast rows are picked.

One run has the rows of its own seed, and its summary the limit of those rows. The page and a study
ask about any such orchard. So they show the mean over seeds, from that of the scenario on.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.report.bounds import Bounds

# The seeds of the first look of a study. With more runs, a study shows the mean over more seeds.
FIRST_SEEDS = 5
SEEDS = 2**63


@dataclass(frozen=True)
class QuestionLimit:
    """What an orchard allows without traffic, by the mean over the first seeds."""

    bins_per_hour: float
    terms: dict[str, float]  #: what each part allows, bins/s
    bottleneck: str  #: the part that allows least on most seeds
    seeds: tuple[int, ...]  #: only one where no seed changes the rows


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario with another seed. After the last seed comes the first one again."""
    return scenario.model_copy(update={"seed": seed % SEEDS})


def common_bottleneck(bottlenecks: Sequence[str]) -> str:
    """Return the part that allows least on most seeds; of several the one on the earliest seed."""
    return Counter(bottlenecks).most_common(1)[0][0]


def limit_of_question(layout: Layout) -> QuestionLimit:
    """Return the limit that a study of this scenario shows after its first look."""
    scenario = layout.scenario
    layouts = [layout]
    if scenario.picking.spread.distribution != "none":
        later = [scenario.seed + number for number in range(1, FIRST_SEEDS)]
        layouts += [lay_out(with_seed(scenario, seed)) for seed in later]
    bounds = [Bounds(with_drawn_rows) for with_drawn_rows in layouts]
    terms = {}
    for name in bounds[0].terms:
        terms[name] = fmean(bound.terms[name] for bound in bounds)
    return QuestionLimit(
        bins_per_hour=fmean(bound.bins_per_hour for bound in bounds),
        terms=terms,
        bottleneck=common_bottleneck([bound.bottleneck for bound in bounds]),
        seeds=tuple(with_drawn_rows.scenario.seed for with_drawn_rows in layouts),
    )
