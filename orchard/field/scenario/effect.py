"""Refuses values that a user has set and that have no effect, because another value is missing.

`orchard/field/scenario/files.py` asks `with_effect` for each scenario that is read from a file.
"""

from collections.abc import Iterator

from orchard.field.problems import Lines, Problem, ScenarioError
from orchard.field.scenario.rules import Scenario
from orchard.field.scenario.ways import value_at

_NO_BATTERY = "has no effect: a battery is endless unless hours is set"
_NO_FAILURE = "has no effect: robots never fail unless mean_between is set"
# Field -> the field without which it has no effect, and the text of the problem.
_IN_VAIN = {
    "carrying.battery.standing": ("carrying.battery.hours", _NO_BATTERY),
    "carrying.battery.hours_to_charge": ("carrying.battery.hours", _NO_BATTERY),
    "carrying.battery.reserve": ("carrying.battery.hours", _NO_BATTERY),
    "picking.failure.mean_repair": ("picking.failure.mean_between", _NO_FAILURE),
    "carrying.failure.mean_repair": ("carrying.failure.mean_between", _NO_FAILURE),
    "picking.spread_of_pickers.cv": (
        "picking.spread_of_pickers.distribution",
        "has no effect: all pickers are alike while the distribution is none",
    ),
    "picking.spread.cv": (
        "picking.spread.distribution",
        "has no effect: all rows are picked alike while the distribution is none",
    ),
    "picking.spread_of_bins.cv": (
        "picking.spread_of_bins.distribution",
        "has no effect: all bins of a row fill alike while the distribution is none",
    ),
}


def with_effect(scenario: Scenario, source: str, lines: Lines | None = None) -> Scenario:
    """Return the scenario itself. Raises `ScenarioError` if a value of it has no effect.

    Only files of users are checked so. Settings of a study, forks and old snapshots may have such
    values: a study, for example, compares with a battery and without. `source` and `lines` are
    those of `check`.
    """
    problems = []
    for fields, text in _rules_of_effect(scenario):
        problems.append(_in_vain(scenario, source, lines or {}, fields, text))
    if problems:
        raise ScenarioError(problems, scenario)
    return scenario


def _rules_of_effect(scenario: Scenario) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield for each value without effect the fields of the problem, and what is wrong."""
    # Field that others need -> whether it is set.
    is_there = {
        "carrying.battery.hours": scenario.has_batteries,
        "picking.failure.mean_between": scenario.picking.failure.mean_between is not None,
        "carrying.failure.mean_between": scenario.carrying.failure.mean_between is not None,
    }
    for key, spread in scenario.picking.spreads.items():
        is_there[f"picking.{key}.distribution"] = spread.distribution != "none"
    default = Scenario.model_construct()
    for field, (needed, text) in _IN_VAIN.items():
        is_set = value_at(scenario, field) != value_at(default, field)
        if is_set and not is_there[needed]:
            yield (field, needed), text
    if scenario.chargers > default.chargers and not scenario.has_batteries:
        text = "has no effect: carriers charge only if hours is set"
        yield ("chargers", "carrying.battery.hours"), text
    if scenario.order_in_row != default.order_in_row and scenario.bin_metres is None:
        text = (
            "has no effect where each row fills one bin: metres_per_bin, bins_per_row and crop say"
            " how many"
        )
        yield ("order_in_row",), text
    text = _piece_rate_in_vain(scenario)
    if text:
        yield ("prices.picker_per_bin", "prices.picker_least_per_day"), text


def _piece_rate_in_vain(scenario: Scenario) -> str:
    """Return why a piece rate has no effect beside the least pay of a day; '' if it has one.

    It has none if the fastest picker earns less than the least pay on a whole day.
    """
    prices = scenario.prices
    least = prices.picker_least_per_day
    if not prices.picker_per_bin or least is None or not scenario.shift.is_set:
        return ""
    # Else the seed may draw a picker, a row or a bin that is fast enough.
    if scenario.picking.is_drawn:
        return ""
    hours = scenario.shift.work_seconds / 3600.0
    rate = scenario.chosen["picking_rate"] * max([1.0, *scenario.picker_rates.values()])
    bins = rate * hours
    # What a picker earns on a day by hours and bins, at most.
    most = hours * (prices.picker_per_hour or 0.0) + bins * prices.picker_per_bin
    if most > least:
        return ""
    return (
        f"has no effect: at {rate:.3g} bins an hour a day of"
        f" {hours:.3g} h earns at most {most:.6g}, and {least:.6g} is paid anyway"
    )


def _in_vain(
    scenario: Scenario, source: str, lines: Lines, fields: tuple[str, ...], text: str
) -> Problem:
    """Return a problem about several fields, like the problem of a rule (`problems_of`)."""
    values = []
    line = 0
    for field in fields:
        values.append(str(value_at(scenario, field)))
        line = max(line, lines.get(tuple(field.split(".")), 0))
    return Problem(source, text, ", ".join(fields), ", ".join(values), line)
