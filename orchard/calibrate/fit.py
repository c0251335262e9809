"""Fits a scenario to the bins of a log.

A log has no picking times: a bin's time also has the ways of the picker, and a drive also has
waits. How much that is, the event model tells. It does a harvest with the values fitted so far, and
its bins are measured as those of the log are. There the picking rate is known. So the rest is known
too, and it is taken off the times of the log. With the new values the model does another harvest.
After `ROUNDS` rounds the values hardly change.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import BaseModel

from orchard.calibrate.bins import LoggedBin, LoggedBins
from orchard.calibrate.driving import BinDrives, DrivingFit, drives_of, fit_driving
from orchard.calibrate.model_bins import metres_to_bay, model_bins
from orchard.calibrate.picking import (
    BinInterval,
    PickingFit,
    PickingTimes,
    fit_picking,
    intervals_of,
    without_long_ones,
)
from orchard.calibrate.spreads import ALIKE, spread_values
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import NEAREST, Scenario, with_changes
from orchard.field.scenario.sections import SPREADS, Carrying, Handling

ROUNDS = 2
# Harvests of the model in a round for the drives of carriers: they depend on the seed.
SEEDS = 3


@dataclass(frozen=True)
class Fit:
    """What a log tells, and the scenario with it.

    `driving`: None if the log does not tell it. `left_out`: times that were not used, a sentence
    each. `notes`: what the log does not tell, a sentence each.
    """

    scenario: Scenario
    picking: PickingFit
    driving: DrivingFit | None
    left_out: list[str]
    notes: list[str]


def fit(
    logged: LoggedBins,
    base: Scenario,
    has_rows: bool,
    file: str,
    confidence: float = 0.95,
    *,
    is_assumed: bool = False,
) -> Fit:
    """Return the scenario that fits the bins of a log.

    `base`: all that the log does not tell. `has_rows`: whether rows of the log are those of `base`.
    `is_assumed`: the user has named no scenario. Raises ScenarioError if the log has too few bins,
    or if no scenario can have what the log says; and what `model_bins` raises.
    """
    intervals, left_out = without_long_ones(intervals_of(logged.bins, logged.silences), file)
    base = base.model_copy(update={"picker_rates": {}})
    advice = ""
    if is_assumed:
        advice = "; name your scenario: --on SCENARIO.yaml"
    picking = _fit_picking(intervals, _plain(base), file, confidence, advice)
    notes: list[str] = []
    scenario = with_changes(base, **_picking_values(base, picking, notes))
    if not has_rows:
        notes.append(
            "the drives of carriers are not told: they need rows in the log, numbered as those of"
            " the scenario that --on names"
        )
        return Fit(scenario, picking, None, left_out, notes)
    metres = metres_to_bay(lay_out(scenario))
    drives, long_ones = drives_of(logged.bins, metres, logged.silences, file)
    driving = _fit_driving(drives, scenario, confidence)
    if driving is None:
        notes.append(f"the drives of carriers are not told: {len(drives.metres)} are too few")
    else:
        scenario = with_changes(scenario, **driving_values(driving, notes=notes))
    return Fit(scenario, picking, driving, [*left_out, *long_ones], notes)


def _plain(base: Scenario) -> Scenario:
    """Return a scenario in which nothing differs and nothing fails, with the policy `nearest`.

    That policy is compiled, so the model is fast. Which carrier comes changes neither the ways of
    pickers nor their picking.
    """
    changes = {
        **{f"picking.{key}": ALIKE for key in SPREADS},
        "picking.failure.mean_between": None,
        "carrying.failure.mean_between": None,
        "dispatch": NEAREST,
    }
    return with_changes(base, **changes)


def _fit_picking(
    intervals: Sequence[BinInterval],
    plain: Scenario,
    file: str,
    confidence: float,
    advice: str,
) -> PickingFit:
    """Return how fast pickers pick. `plain`: as `_plain` returns it. Raises ScenarioError.

    `advice`: the end of the messages about a scenario that cannot be that of the log.
    """
    if not intervals:
        text = (
            "has no two bins of one picker and day, of which the first was fetched: no picking time"
            " follows from it"
        )
        raise ScenarioError([Problem(file, text)])
    times = PickingTimes(intervals)
    for _ in range(ROUNDS):
        rate = _rate_of(times)
        with _as_of_the_log(file, rate, advice):
            model = with_changes(plain, **_rate_values(rate))
        of_model = intervals_of(_named_as_in(intervals, model_bins(model)))
        if not of_model:
            text = (
                "has several bins of a picker, or of a row, one after another, and this scenario"
                f" has none{advice}"
            )
            raise ScenarioError([Problem(file, text)])
        # What a picker of the model does beside picking, s a bin.
        beside = float(PickingTimes(of_model).means.mean()) - 3600.0 / rate
        times = PickingTimes(intervals, beside)
        if float(times.times.min()) <= 0.0:
            text = (
                f"has bins that are full within {beside:.0f} s of the fetched one before them; in"
                f" this scenario the ways of a picker alone take so long{advice}"
            )
            raise ScenarioError([Problem(file, text)])
    rate = _rate_of(times)
    with _as_of_the_log(file, rate, advice):
        # This only checks that a scenario can have the rate of the last round.
        with_changes(plain, **_rate_values(rate))
    try:
        return fit_picking(times, PickingTimes(of_model, beside), confidence)
    except ValueError as error:
        raise ScenarioError([Problem(file, str(error))]) from None


def _rate_of(times: PickingTimes) -> float:
    """Return the rate that follows from picking times, bins/h."""
    return 3600.0 / float(times.means.mean())


def _named_as_in(intervals: Sequence[BinInterval], bins: Sequence[LoggedBin]) -> list[LoggedBin]:
    """Return the bins of a model without pickers, if a log names none, so that both are alike."""
    if any(interval.picker for interval in intervals):
        return list(bins)
    return [replace(of_model, picker="") for of_model in bins]


@contextmanager
def _as_of_the_log(file: str, rate: float, advice: str) -> Iterator[None]:
    """In this context, report a rate that no scenario can have as an error of the log."""
    try:
        yield
    except ScenarioError as error:
        text = (
            f"its pickers fill {rate:.3g} bins an hour while they pick, which this scenario cannot"
            f" have: {error.problems[0].text}{advice}"
        )
        raise ScenarioError([Problem(file, text)]) from None


def _rate_values(rate: float) -> dict[str, Any]:
    """Return the changes of a scenario for a picking rate."""
    return {"picking_speed": None, "picking_rate": rate}


def _picking_values(base: Scenario, picking: PickingFit, notes: list[str]) -> dict[str, Any]:
    """Return the changes of a scenario by what the log tells of picking.

    What the log does not tell is added to `notes`.
    """
    values = _rate_values(round(picking.rate.value, 4))
    # Not checked yet: the spreads of `base` may not do with this rate, and are replaced.
    rated = base.model_copy(update=values)
    return values | spread_values(rated, picking, notes)


def _fit_driving(drives: BinDrives, scenario: Scenario, confidence: float) -> DrivingFit | None:
    """Return what the log tells of carriers; None: it has too few drives.

    `scenario`: with what the log tells of picking.
    """
    driving = None
    for _ in range(ROUNDS):
        model = _drives_of_model(scenario)
        speed = scenario.carrying.speed
        unloading = scenario.handling.unloading
        driving = fit_driving(drives, model, speed, unloading, confidence)
        if driving is None:
            return None
        scenario = with_changes(scenario, **driving_values(driving))
    return driving


def _drives_of_model(scenario: Scenario) -> BinDrives:
    """Return the drives of some harvests of the model."""
    metres = metres_to_bay(lay_out(scenario))
    bins = []
    for seed in range(SEEDS):
        changes = {"seed": seed + 1, "dispatch": NEAREST}
        bins += model_bins(with_changes(scenario, **changes))
    return drives_of(bins, metres)[0]


def driving_values(
    driving: DrivingFit, resample: int | None = None, notes: list[str] | None = None
) -> dict[str, Any]:
    """Return the changes of a scenario by what the log tells of carriers.

    `resample`: the number of the resample of the fit that is used; None: the estimate itself.
    `notes`: get what is beyond the limits of a scenario.
    """
    if notes is None:
        notes = []
    values = {}
    if driving.speed is None:
        notes.append(f"the speed of carriers is not told: {driving.why}")
    else:
        speed = driving.speed.of(resample)
        values["carrying.speed"] = _within(Carrying, "speed", speed, "carrying.speed", notes)
    seconds = driving.unloading.of(resample)
    key = "handling.unloading"
    values[key] = round(_within(Handling, "unloading", seconds, key, notes), 1)
    return values


def _within(section: type[BaseModel], name: str, value: float, key: str, notes: list[str]) -> float:
    """Return the value that a scenario can have and that is nearest to `value`.

    If it is another one, `notes` say so. `section`, `name`: the field that has the limits.
    `key`: the field's path in a scenario.
    """
    # The limits of the field by their kind: "Ge" is the least value, "Le" the most.
    limits = {type(limit).__name__: limit for limit in section.model_fields[name].metadata}
    least = float(limits["Ge"].ge)
    most = float(limits["Le"].le)
    possible = round(float(np.clip(value, least, most)), 4)
    if not least <= value <= most:
        notes.append(
            f"{key} would be {value:.3g}; a scenario takes {least:g} to {most:g}, so it is"
            f" {possible:g}"
        )
    return possible
