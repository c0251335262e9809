"""Values that a user has set and that have no effect, because another value is missing."""

from collections.abc import Iterator

from orchard.field.problems import Lines, Problem, ScenarioError
from orchard.field.scenario.schema import Scenario, value_at

_NO_BATTERY = "has no effect: a battery is endless unless hours is set"
_NO_FAILURE = "has no effect: robots never fail unless mean_between is set"
# Field -> the field without which it has no effect, and what is said then.
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
}


def with_effect(scenario: Scenario, source: str, lines: Lines | None = None) -> Scenario:
    """Return a scenario in which a user has set no value that needs another one, and lacks it.

    Settings of a study, forks and old snapshots may have such values: there another value was
    taken away. Raises `ScenarioError`.
    """
    problems = []
    for fields, text in _rules_of_effect(scenario):
        problems.append(_in_vain(scenario, source, lines or {}, fields, text))
    if problems:
        raise ScenarioError(problems, scenario)
    return scenario


def _rules_of_effect(scenario: Scenario) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the fields, and what is wrong with them, of each value that has no effect."""
    has_effect = {
        "carrying.battery.hours": scenario.has_batteries,
        "picking.failure.mean_between": scenario.picking.failure.mean_between is not None,
        "carrying.failure.mean_between": scenario.carrying.failure.mean_between is not None,
        "picking.spread.distribution": scenario.picking.spread.distribution != "none",
        "picking.spread_of_pickers.distribution": (
            scenario.picking.spread_of_pickers.distribution != "none"
        ),
    }
    default = Scenario.model_construct()
    for field, (needed, text) in _IN_VAIN.items():
        is_set = value_at(scenario, field) != value_at(default, field)
        if is_set and not has_effect[needed]:
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
    """Return why a piece rate has no effect beside the least that a day is paid; '' if it has."""
    prices = scenario.prices
    least = prices.picker_least_per_day
    if not prices.picker_per_bin or least is None or not scenario.shift.is_set:
        return ""
    picking = scenario.picking
    # The seed may draw a picker or a row that is fast enough.
    if {picking.spread.distribution, picking.spread_of_pickers.distribution} != {"none"}:
        return ""
    hours = scenario.shift.work_seconds / 3600.0
    rate = scenario.chosen["picking_rate"] * max([1.0, *scenario.picker_rates.values()])
    bins = rate * hours
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
    """Return a rule's problem, as those of several fields are."""
    values = []
    line = 0
    for field in fields:
        values.append(str(value_at(scenario, field)))
        line = max(line, lines.get(tuple(field.split(".")), 0))
    return Problem(source, text, ", ".join(fields), ", ".join(values), line)
