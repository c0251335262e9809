"""docs/validation.md and its pictures: published figures beside those of the simulator.

`python -m docs.validation` measures all anew, `--harvests` those of `docs/published.py` alone.

`docs/crews.py` has the published curves of strawberries.
"""

import argparse
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import chain, product
from multiprocessing import Pool
from multiprocessing.pool import Pool as Workers
from pathlib import Path
from statistics import fmean
from textwrap import fill
from typing import Any

from matplotlib.figure import Figure
from rich.progress import track

from docs.crews import (
    COUNTS,
    CREW,
    FINDINGS,
    PERSON_SPEED,
    PICKERS,
    QUANTITIES,
    ROBOT_SPEED,
    Curve,
    Finding,
    Point,
    crew,
    efficiency,
    non_productive,
)
from docs.published import FIGURES, FITTED, SOURCES, Published, gain_of_a_third
from docs.published_harvests import HARVESTS, bins_per_hour
from docs.svg import svg_of
from orchard.field.scenario import NEAREST

MEASURED = Path(__file__).with_name("validation.json")
SEEDS = (1, 2)  # of the harvests of docs/published.py
NEAR = 5.0  # points: a share that is nearer than this agrees
NEAR_SHARE = 0.1  # another figure agrees if it differs by less than this of the published one
WORDS = {NEAREST: "reactive", "predictive": "predictive"}


def measure(harvests_only: bool = False) -> None:
    """Measure all curves and harvests, or the harvests alone, and keep them."""
    kept = _kept()
    with Pool() as workers:
        if not harvests_only:
            kept["curves"] = _measured_curves(workers)
            kept["as_fast"] = round(efficiency(crew(CREW[0], 10, robot_speed=PERSON_SPEED)), 4)
        kept["harvests"] = _measured_harvests(workers)
    MEASURED.write_text(json.dumps(kept, indent=1) + "\n")
    _kept.cache_clear()
    _measured.cache_clear()


def _measured_curves(workers: Workers) -> list[dict[str, Any]]:
    """Return the efficiency of each curve at each number of carriers."""
    asked = [(curve, carriers) for curve in _curves() for carriers in COUNTS]
    scenarios = [crew(curve, carriers) for curve, carriers in asked]
    runs = workers.imap(efficiency, scenarios)
    shares = track(runs, "crews", len(scenarios))
    curves = []
    for ((alone, policy), carriers), share in zip(asked, shares, strict=True):
        curve = {"alone": alone, "policy": policy, "carriers": carriers}
        curves.append(curve | {"efficiency": round(share, 4)})
    return curves


def _measured_harvests(workers: Workers) -> dict[str, float]:
    """Return the rate of each harvest, bins an hour, the mean of its seeds."""
    asked = list(product(HARVESTS, SEEDS))
    runs = workers.imap(_harvested, asked)
    rate_of = dict(zip(asked, track(runs, "harvests", len(asked)), strict=True))
    rates = {}
    for name in HARVESTS:
        rates[name] = round(fmean(rate_of[name, seed] for seed in SEEDS), 4)
    return rates


def _harvested(asked: tuple[str, int]) -> float:
    """Return the rate of a harvest with a seed. It takes both as one, as `imap` gives them."""
    name, seed = asked
    return bins_per_hour(name, seed)


def _curves() -> list[Curve]:
    """Return all curves, each once."""
    return list(dict.fromkeys(chain.from_iterable(finding.curves for finding in FINDINGS)))


@cache
def _kept() -> dict[str, Any]:
    """Return what was measured last, as it stands in docs/validation.json."""
    kept: dict[str, Any] = json.loads(MEASURED.read_text())
    return kept


@cache
def _measured() -> dict[tuple[float, str, int], float]:
    """Return the efficiencies by curve, its two parts, and carriers."""
    shares = {}
    for curve in _kept()["curves"]:
        shares[curve["alone"], curve["policy"], curve["carriers"]] = curve["efficiency"]
    return shares


def value(curve: Curve, carriers: int, quantity: str) -> float:
    """Return what the simulator says of a quantity, %."""
    here: float = QUANTITIES[quantity][0](_measured()[*curve, carriers], curve[0])
    return here


# -- the page


@dataclass(frozen=True)
class Line:
    """A line of the table: a published figure, and ours."""

    group: str
    quantity: str
    published: str
    here: str
    agrees: bool
    why: str
    uncounted: str = ""  # why it does not count


def document() -> str:
    """Return docs/validation.md."""
    lines = [*_lines_of_harvests(), *_lines_of_curves()]
    counted = [line for line in lines if not line.uncounted]
    agree = [line for line in counted if line.agrees]
    return TEXT.format(
        near=NEAR,
        near_share=100.0 * NEAR_SHARE,
        agree=len(agree),
        counted=len(counted),
        uncounted=len(lines) - len(counted),
        third=gain_of_a_third(_kept()["harvests"]),
        table="\n".join(_rows(lines)),
        sources="\n".join(_sources()),
        plateau=_first_near_the_best(CREW[1]),
        reactive=_first_near_the_best(CREW[0]),
        speed=ROBOT_SPEED,
        as_fast=non_productive(_kept()["as_fast"], CREW[0][0]),
        pictures="\n\n".join(_section(finding) for finding in FINDINGS),
    )


def _rows(lines: Iterable[Line]) -> Iterator[str]:
    """Yield the rows of the table, with one for the name of each group."""
    group = ""
    for line in lines:
        if line.group != group:
            group = line.group
            yield f"| **{group}** | | | |"
        mark = _mark(line)
        yield f"| {line.quantity} | {line.published} | {line.here} | {mark}{line.why} |"


def _mark(line: Line) -> str:
    """Return the first words of the last column: whether a figure agrees, or does not count."""
    if line.uncounted:
        return f"{line.uncounted}, does not count: "
    if not line.agrees:
        return ""
    return "agrees; " if line.why else "agrees"


def _sources() -> Iterator[str]:
    """Yield the sources, with the numbers by which the table cites them."""
    for number, text in enumerate(SOURCES.values(), start=1):
        yield fill(f"{number}. {text}", 140, subsequent_indent="   ", break_on_hyphens=False)


def _lines_of_harvests() -> Iterator[Line]:
    """Yield the lines of the figures of docs/published.py."""
    numbers = {source: number for number, source in enumerate(SOURCES, start=1)}
    rates = _kept()["harvests"]
    for figure in FIGURES:
        here = figure.answer(rates)
        yield Line(
            group=figure.group,
            quantity=f"{figure.quantity} [{numbers[figure.source]}]",
            published=_range(figure),
            here=_number(here, figure),
            agrees=agrees(here, figure),
            why=figure.explained(rates),
            uncounted=figure.uncounted,
        )


def _range(figure: Published) -> str:
    """Return a published figure, or its range, as text."""
    if figure.low == figure.high:
        return _number(figure.low, figure)
    return f"{_number(figure.low, figure)} to {_number(figure.high, figure)}"


def _number(amount: float, figure: Published) -> str:
    """Return an amount in the way in which this figure is written."""
    if figure.is_share:
        return f"{amount:.1f} %"
    if figure.high >= 1000.0:
        return f"{round(amount, -2):,.0f}"
    digits = 0 if figure.is_count else 1
    return f"{amount:.{digits}f}"


def agrees(here: float, figure: Published) -> bool:
    """Whether ours lies in the published range, or near enough to it."""
    # How far it lies outside the range; 0 within it.
    beyond = max(figure.low - here, here - figure.high, 0.0)
    if figure.is_share:
        return beyond < NEAR
    nearer = figure.low if here < figure.low else figure.high
    return beyond <= NEAR_SHARE * nearer


def _lines_of_curves() -> Iterator[Line]:
    """Yield the lines of the strawberries."""
    for finding in FINDINGS:
        for point in finding.points:
            yield _line(point)


def _line(point: Point) -> Line:
    """Return the line of a figure of the strawberries."""
    here = value(point.curve, point.carriers, point.quantity)
    agrees = abs(here - point.published) < NEAR
    sign = "" if point.quantity == "efficiency" else "+"
    why = ""
    if point.is_fitted or not agrees:
        why = point.why.format(
            speed=ROBOT_SPEED,
            six=value(point.curve, 6, point.quantity),
            eight=value(point.curve, 8, point.quantity),
        )
    return Line(
        group="Strawberries, 25 pickers and robots that carry",
        quantity=f"{point.quantity}, {WORDS[point.curve[1]]}, {point.carriers} carriers,"
        f" {100 * point.curve[0]:g} % without",
        published=f"{point.published:{sign}.1f} %",
        here=f"{here:{sign}.1f} %",
        agrees=agrees,
        why=why,
        uncounted=FITTED if point.is_fitted else "",
    )


def _first_near_the_best(curve: Curve) -> int:
    """Return the fewest carriers that are within 2 % of the best efficiency."""
    rates = {carriers: _measured()[*curve, carriers] for carriers in COUNTS}
    return min(carriers for carriers, rate in rates.items() if rate >= 0.98 * max(rates.values()))


def _section(finding: Finding) -> str:
    """Return the paragraph and the picture of a publication."""
    return (
        f"{fill(finding.text, 140)}\n\n![{QUANTITIES[finding.quantity][1]}, by the number of"
        f" carriers](validation-{finding.name}.svg)"
    )


def pictures() -> dict[str, str]:
    """Return each picture as SVG, by its path."""
    return {f"docs/validation-{finding.name}.svg": _picture(finding) for finding in FINDINGS}


def _picture(finding: Finding) -> str:
    """Return the picture of a publication as SVG: our curves, and its figures as circles."""
    drawing = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawing.subplots()
    for curve, colour in zip(finding.curves, ("#2f66a8", "#3f8f4a"), strict=False):
        label = f"{WORDS[curve[1]]}, {100 * curve[0]:g} % without"
        axes.plot(
            COUNTS,
            [value(curve, carriers, finding.quantity) for carriers in COUNTS],
            color=colour,
            marker=".",
            label=label,
        )
        shown = [
            point
            for point in finding.points
            if (point.curve, point.quantity) == (curve, finding.quantity)
        ]
        axes.plot(
            [point.carriers for point in shown],
            [point.published for point in shown],
            "o",
            color=colour,
            fillstyle="none",
            markersize=10,
            label="published",
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
figures the simulator has too, and why others differ.

What goes into a harvest comes from the source, or from another one that is named. What no source
tells is that of the default orchard: two-way roads, speeds of 1 m/s, and times to fill a bin that
vary by 28 %. Rates are those of the long run by the fast model, in rows that take their mean times:
the mean of two seeds, and of one for strawberries.

A share agrees if it is within {near:g} points, another figure if it is within {near_share:g} % of
the published one, or of the nearer end of a published range. **{agree} of {counted} agree.**

Only a figure that could fail counts. {uncounted} others stand in the table with a mark:

- A fitted one: a value of the harvest was chosen so that this figure comes out.
- Tractors of two gangs, which could hardly fail. Two stand with the gangs. A third one that drives
  brings at most {third:.1f} % more here, so hardly another number could come out. The bins an hour
  beside it say more. They are fewer than people would pick without a break, because ways to the
  next row and exchanges take time.
- Advice without a number.

Bins a day and costs follow from a published rate of picking. What can fail there is what the
simulator adds: waits, ways and exchanges.

| figure | published | here | why |
|---|---|---|---|
{table}

`python -m docs.validation --harvests` measures all but the strawberries again.

## Sources

{sources}

## Strawberries

The publications are about people who pick strawberries into trays, and robots that carry them.
Without a robot a picker walks with its tray itself. Two values are fitted:

- the time to fill a tray, so that a picker that drives a carrier's round with each tray, at 1 m/s,
  has the published efficiency without robots, which is no figure of the table;
- the speed of the robots, {speed:g} m/s, by what ten of them bring when they are reactive. The
  abstracts do not tell it. A program of one of the authors has 1 m/s, and people who walk 0.8 to
  1.5 m/s (github.com/caseypen/FRAIL-Bot_rl_env). So the speed may stand for more, such as what a
  person does at the collection station.

Efficiency is the share of its time for which a picker picks; all other time is non-productive. Gain
and non-productive time of one policy are of the same runs. There are 25 rows of 100 m. With robots
of 1 m/s, as fast as people, ten reactive ones change the non-productive time by {as_fast:.1f} %.

From {reactive} robots on (reactive) and {plateau} on (predictive) more gain less than 2 % here; in
the publication it is from ten on.

{pictures}
"""


def main() -> None:
    """Measure what the command asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--harvests", action="store_true", help="only those of docs/published.py")
    measure(parser.parse_args().harvests)


if __name__ == "__main__":
    main()
