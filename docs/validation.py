"""docs/validation.md and its pictures: published curves beside those of the simulator.

`python -m docs.validation` measures anew.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from multiprocessing import Pool
from pathlib import Path
from statistics import fmean
from textwrap import fill

from matplotlib.figure import Figure
from rich.progress import track

from docs.svg import svg_of
from orchard.field.layout import lay_out
from orchard.field.scenario import NEAREST, Animals, People, Scenario
from orchard.report.bounds import Bounds
from orchard.report.long_run import long_run

MEASURED = Path(__file__).with_name("validation.json")
PICKERS, ROWS, ROW_LENGTH = (
    25,
    25,
    100.0,
)  # the crew of the publications; rows of 100 m as in a slide of theirs (ASABE 2019, Boston)
COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25)  # carriers
SEEDS = range(1, 5)
CV = 0.28  # of the time to fill a tray, see config/hand_picking.yaml
NEAR = 5.0  # points: a figure that is nearer than this agrees
WORDS = {NEAREST: "reactive", "predictive": "predictive"}

# The efficiency of pickers who carry their bins themselves, and the dispatch policy of the
# carriers.
Curve = tuple[float, str]


@dataclass(frozen=True)
class Point:
    """A published figure: of a quantity, at a number of carriers for the crew of 25."""

    curve: Curve
    carriers: int
    quantity: str  # a key of QUANTITIES
    published: float  # %
    why: str = ""  # it differs


@dataclass(frozen=True)
class Finding:
    """A publication, what it found, and the picture of the quantity that it is about."""

    name: str
    text: str
    quantity: str
    curves: tuple[Curve, ...]
    points: tuple[Point, ...]


def _gain(efficiency: float, alone: float) -> float:
    return 100.0 * (efficiency / alone - 1.0)


def _non_productive(efficiency: float, alone: float) -> float:
    return 100.0 * ((1.0 / efficiency - 1.0) / (1.0 / alone - 1.0) - 1.0)


QUANTITIES = {
    "non-productive time": (_non_productive, "non-productive time of a bin, change in %"),
    "gain": (_gain, "efficiency, change in %"),
    "efficiency": (lambda efficiency, alone: 100.0 * efficiency, "efficiency, %"),
}
SLOW = "their robots are faster than a person who carries: 6 of ours have {six:.1f} %"
HALF = (
    "a carrier comes half a round after the call, and their robots drive faster than a person who"
    " carries, ours as fast"
)
SURE = "their robots guess from a tray's weight when it is full; a bin here knows"
ONE = "a cart takes many boxes to the road, a carrier here takes one bin"
MOST = "-91.4 % at most here: the exchange takes 13 s"
CREW = (0.80, NEAREST), (0.80, "predictive")
MORNING, AFTERNOON, FIELD = (0.818, NEAREST), (0.782, NEAREST), (0.857, "predictive")
FINDINGS = (
    Finding(
        "crew",
        "C. Peng and S. Vougioukas, Deterministic predictive dynamic scheduling for crop-transport"
        " co-robots acting as harvesting aids, Computers and Electronics in Agriculture, 2020. For"
        " 25 pickers, four robots are no better than none, ten are enough, and more gain nothing."
        " Both gains together follow from an efficiency of 80 % without robots.",
        "non-productive time",
        CREW,
        (
            Point(CREW[0], 10, "non-productive time", -64.6, HALF),
            Point(CREW[1], 10, "non-productive time", -93.7, MOST),
            Point(CREW[0], 10, "gain", 15.0),
            Point(CREW[1], 10, "gain", 24.0),
        ),
    ),
    Finding(
        "five",
        "H. Seyyedhasani, C. Peng, W. Jang and S. Vougioukas, Collaboration of human pickers and"
        " crop-transporting robots during harvesting, part II, Computers and Electronics in"
        " Agriculture, 2020: five robots for 25 pickers, by a simulator that field data confirm."
        " With more, nothing is gained.",
        "efficiency",
        (MORNING, AFTERNOON),
        (
            Point(MORNING, 5, "efficiency", 92.0, SLOW),
            Point(AFTERNOON, 5, "efficiency", 86.5, SLOW),
        ),
    ),
    Finding(
        "field",
        "C. Peng and others, A strawberry harvest-aiding system with crop-transport co-robots,"
        " arXiv 2107.13063: measured in the field with one robot for three pickers. Both figures"
        " follow from an efficiency of 85.7 % without robots.",
        "non-productive time",
        (FIELD,),
        (Point(FIELD, 8, "non-productive time", -60.0, SURE), Point(FIELD, 8, "gain", 10.0)),
    ),
    Finding(
        "carts",
        "burro.ai on table grapes: one cart for six to eight people, who then pick 20 to 30 %"
        " more.",
        "gain",
        CREW[1:],
        (Point(CREW[1], 4, "gain", 25.0, ONE),),
    ),
)


def crew(curve: Curve, carriers: int, seed: int = 1) -> Scenario:
    """Return an orchard whose pickers, if they carried their bins themselves, would pick for that
    share of their time.

    Such a picker drives a carrier's round with each bin, so the time to fill one follows from the
    length of that round.
    """
    alone, policy = curve
    plain = Scenario(
        rows=ROWS,
        pickers=PICKERS,
        row_length=ROW_LENGTH,
        carriers=carriers,
        route="two-way",
        dispatch=policy,
        seed=seed,
        people=People(workers=0, visitors=0),
        animals=Animals(dogs=0, cats=0),
        weeds=0,
        tractor=False,
    )
    bounds = Bounds(lay_out(plain.model_copy(update={"carriers": 1})))
    filling = (bounds.crossing_seconds + bounds.cycle_seconds) * alone / (1.0 - alone)
    spread = {"spread": {"distribution": "lognormal", "cv": CV}}
    return Scenario(**plain.model_dump() | {"picking_rate": 3600.0 / filling, "picking": spread})


def efficiency(scenario: Scenario) -> float:
    """Return the share of its time for which a picker picks, in the long run: the rest is its wait,
    and its way to the next row.
    """
    hours_a_bin = 1.0 / scenario.chosen["picking_rate"]
    return hours_a_bin * long_run(lay_out(scenario)).bins_per_hour / scenario.pickers


def measure() -> None:
    """Measure all curves, and keep them."""
    asked = [(curve, carriers) for curve in _curves() for carriers in COUNTS]
    with Pool() as workers:
        runs = workers.imap(efficiency, [crew(*one, seed) for one in asked for seed in SEEDS])
        found = list(track(runs, "harvests", len(asked) * len(SEEDS)))
    kept = [
        {
            "alone": alone,
            "policy": policy,
            "carriers": carriers,
            "efficiency": round(fmean(found[i * len(SEEDS) : (i + 1) * len(SEEDS)]), 4),
        }
        for i, ((alone, policy), carriers) in enumerate(asked)
    ]
    MEASURED.write_text("[\n" + ",\n".join(map(json.dumps, kept)) + "\n]\n")
    _measured.cache_clear()


def _curves() -> list[Curve]:
    return list(dict.fromkeys(curve for finding in FINDINGS for curve in finding.curves))


@cache
def _measured() -> dict[tuple[float, str, int], float]:
    return {
        (one["alone"], one["policy"], one["carriers"]): one["efficiency"]
        for one in json.loads(MEASURED.read_text())
    }


def value(curve: Curve, carriers: int, quantity: str) -> float:
    """Return what the simulator says of a quantity, %."""
    here: float = QUANTITIES[quantity][0](_measured()[*curve, carriers], curve[0])
    return here


# -- the page


def document() -> str:
    """Return docs/validation.md."""
    return TEXT.format(
        near=NEAR,
        table="\n".join(
            f"| {' | '.join(_line(point))} |" for finding in FINDINGS for point in finding.points
        ),
        plateau=_first_near_the_best(CREW[1]),
        reactive=_first_near_the_best(CREW[0]),
        none=max(carriers for carriers in COUNTS if value(CREW[1], carriers, "gain") <= 0.0),
        pictures="\n\n".join(_section(finding) for finding in FINDINGS),
    )


def _line(point: Point) -> Iterable[str]:
    here = value(point.curve, point.carriers, point.quantity)
    agrees = abs(here - point.published) < NEAR
    sign = "" if point.quantity == "efficiency" else "+"
    yield (
        f"{point.quantity}, {WORDS[point.curve[1]]}, {point.carriers} carriers,"
        f" {100 * point.curve[0]:g} % without"
    )
    yield f"{point.published:{sign}.1f} %"
    yield f"{here:{sign}.1f} %"
    yield "agrees" if agrees else point.why.format(six=value(point.curve, 6, point.quantity))


def _first_near_the_best(curve: Curve) -> int:
    """The fewest carriers that are within 2 % of the best efficiency."""
    rates = {carriers: _measured()[*curve, carriers] for carriers in COUNTS}
    return min(carriers for carriers, rate in rates.items() if rate >= 0.98 * max(rates.values()))


def _section(finding: Finding) -> str:
    return (
        f"{fill(finding.text, 140)}\n\n![{QUANTITIES[finding.quantity][1]}, by the number of"
        f" carriers](validation-{finding.name}.svg)"
    )


def pictures() -> dict[str, str]:
    """Return each picture as SVG, by its path."""
    return {f"docs/validation-{finding.name}.svg": _picture(finding) for finding in FINDINGS}


def _picture(finding: Finding) -> str:
    drawing = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawing.subplots()
    counts = [carriers for carriers in COUNTS if carriers > 2]
    for curve, colour in zip(finding.curves, ("#2f66a8", "#3f8f4a"), strict=False):
        label = f"{WORDS[curve[1]]}, {100 * curve[0]:g} % without"
        axes.plot(
            counts,
            [value(curve, carriers, finding.quantity) for carriers in counts],
            color=colour,
            marker=".",
            label=label,
        )
        shown = [
            point
            for point in finding.points
            if (point.curve, point.quantity) == (curve, finding.quantity)
        ]
        at, published = [point.carriers for point in shown], [point.published for point in shown]
        axes.plot(
            at, published, "o", color=colour, fillstyle="none", markersize=10, label="published"
        )
    axes.set_xlabel(f"carriers for {PICKERS} pickers")
    axes.set_ylabel(QUANTITIES[finding.quantity][1], fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    return svg_of(drawing)


TEXT = """\
<!-- Made by docs/validation.py: `make docs`. `make validate` measures again. -->
# Held against published figures

For people who ask whether the answers can be trusted. After this page you know which published
curves the simulator has too.

The publications are about people who pick strawberries into trays, and robots that carry them.
Without a robot a picker walks with its tray itself. One figure of the orchard is chosen so: a
picker that drives a carrier's round with each of its bins has the published efficiency. Efficiency
is the share of its time for which a picker picks; all other time is non-productive. The rest is as
it is: 25 rows of 100 m, two-way roads, times to fill a bin that vary by 28 %, and speeds of 1 m/s.
Each figure is the mean over four seeds, in the long run, by the fast model.

| figure | published | here | |
|---|---|---|---|
{table}

A figure agrees if it is within {near:g} points. The shape is the published one: up to {none}
carriers for 25 pickers are no better than none. From {reactive} carriers on (reactive) and
{plateau} (predictive), one for about three pickers, more gain less than 2 %.

{pictures}
"""


if __name__ == "__main__":
    measure()
