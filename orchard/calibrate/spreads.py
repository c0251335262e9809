"""The spreads of picking times that a scenario gets from a log: of pickers, rows and bins of a row.

A spread of a scenario has a distribution and a coefficient of variation (cv). A log tells the cv.
The distribution is that of the user's scenario, or else the usual one.
"""

import math
from typing import Any

from orchard.calibrate.picking import LEAST_ROWS_OF_BINS, PickingFit
from orchard.field.scenario import Scenario
from orchard.field.scenario.sections import LEAST_CV, Spread

# The distribution of what differs, if the scenario does not say one.
USUAL_SPREAD = "lognormal"
# The section `picking.spread` of a scenario in which nothing differs: the schema's defaults, with
# the distribution "none". Its cv is the default too, because a scenario's file refuses any other
# cv, which would have no effect.
ALIKE = Spread().model_dump()
# Key of the section `picking` -> what differs.
WHAT_DIFFERS = {
    "spread": "rows",
    "spread_of_pickers": "pickers",
    "spread_of_bins": "bins of a row",
}


def spread_values(rated: Scenario, picking: PickingFit, notes: list[str]) -> dict[str, Any]:
    """Return the changes of a scenario by what a log tells of differences.

    `rated`: with the picking rate of the log, and the user's distributions. `notes`: get what the
    log does not tell, and what no scenario can have.
    """
    values = {}
    for key, fitted in picking.spreads.items():
        path = f"picking.{key}"
        what = WHAT_DIFFERS[key]
        values[path] = ALIKE
        if fitted is None:
            notes.append(f"how {what} differ is not told: {_why_untold(key, picking)}")
        elif fitted.value < LEAST_CV:
            notes.append(f"{what} do not differ for certain: {path}.distribution is none")
        else:
            values[path] = _section(rated, key, fitted.value)
            if values[path]["cv"] < round(fitted.value, 4):
                notes.append(
                    f"{path}.cv would be {fitted.value:.3g}, which is more than a scenario takes at"
                    " this picking rate; so it is the most that it takes"
                )
    return values


def _why_untold(key: str, picking: PickingFit) -> str:
    """Return why a log does not tell a spread. `key`: of the section `picking`."""
    if key == "spread_of_bins":
        return (
            f"{picking.rows_of_bins} rows of a day have two picking times or more, and it takes"
            f" {LEAST_ROWS_OF_BINS}; so it is part of how rows differ"
        )
    return "the log names one at most"


def _section(rated: Scenario, key: str, cv: float) -> dict[str, Any]:
    """Return a spread with a cv, or with the greatest one that the scenario can have. Where nothing
    can differ, as with pickers at their top speed, that is no spread.

    `rated`: with its picking rate. `key`: of the section `picking`.
    """
    before: Spread = getattr(rated.picking, key)
    distribution: str = before.distribution
    if distribution == "none":
        distribution = USUAL_SPREAD
    widest = math.floor(1e4 * rated.widest_cv(distribution)) / 1e4
    possible = min(round(cv, 4), widest)
    if possible < LEAST_CV:
        return ALIKE
    return {"distribution": distribution, "cv": possible}


def drawn_spreads(
    fitted: Scenario, picking: PickingFit, resample: int, rate: float
) -> dict[str, Any]:
    """Return the changes of a fitted scenario by one resample: of how rows differ, and their bins.

    `rate`: that of the resample, bins/h. A spread that the fitted scenario has not stays away.
    """
    rated = fitted.model_copy(update={"picking_rate": rate})
    changes: dict[str, Any] = {}
    for key in ("spread", "spread_of_bins"):
        of_log = picking.spreads[key]
        before: Spread = getattr(fitted.picking, key)
        if of_log is None or before.distribution == "none":
            continue
        changes[f"picking.{key}"] = _section(rated, key, of_log.of(resample))
    return changes
