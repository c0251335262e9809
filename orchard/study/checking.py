"""What is wrong with a study before it begins: with its settings, its options and the classes of
the user that its scenario names ("own classes").
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from orchard.behaviour.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.plans.routes import route_of
from orchard.study.options import StudyOptions
from orchard.study.result import Models
from orchard.study.settings import (
    Setting,
    have_prices,
    is_of_several_values,
    numbered,
    settings_of,
)

_NO_PRICES = "needs a price: picker_per_hour, carrier_per_hour, overhead_per_hour or per_bin"
_FREE = (
    "{key} vary and cost nothing, so the most of them would be the cheapest; set {price}, 0 if they"
    " do cost nothing, or leave all prices out"
)
# Key of the number of robots -> the prices that such robots can have, in words.
_PRICES = {
    "pickers": "prices.picker_per_hour or picker_per_bin",
    "carriers": "prices.carrier_per_hour or carrier_per_day",
}
_NO_END = "a long run has no end; choose --horizon harvest, or another goal"
_NO_LONG_RUN = "only the fast model can tell the long run; choose --horizon harvest"
_ABSENCES = "a long run has no first hour; choose --horizon harvest"
_SENSORS = "only the full model knows errors of sensors; choose --model full"


def checked_settings(
    scenario: Scenario, varied: Mapping[str, Sequence[Any]], options: StudyOptions
) -> tuple[list[Setting], list[Problem]]:
    """Return the settings of a study, and all that is wrong with them, with the options, and with
    own classes.
    """
    settings, problems = settings_of(scenario, numbered(scenario, varied))
    # If no setting can be a scenario, options and classes are checked with the scenario as it is.
    asked = settings or [Setting({}, scenario)]
    problems += _option_problems(asked, options)
    problems += _price_problems(asked, options)
    problems += _plugin_problems(asked, options.model)
    return settings, problems


def refused_and_left_out(
    settings: Sequence[Setting], problems: Sequence[Problem]
) -> tuple[list[Problem], list[Problem]]:
    """Return for which problems a study is refused, and for which it leaves out single settings.

    A setting is left out if values are wrong together, as a truck that holds more bins than there
    are, and if other settings are possible. `settings`, `problems`: as of `checked_settings`.
    """
    refused = []
    left_out = []
    for problem in problems:
        if settings and is_of_several_values(problem):
            left_out.append(problem)
        else:
            refused.append(problem)
    return refused, left_out


def _option_problems(settings: Sequence[Setting], options: StudyOptions) -> list[Problem]:
    """Return what is wrong with the options of a study of these settings."""
    problems = []
    is_long = options.horizon == "long"
    if options.goal == "cost_per_bin" and not have_prices(settings):
        problems.append(Problem("--goal cost_per_bin", _NO_PRICES, "prices"))
    if options.goal == "harvest_seconds" and is_long:
        problems.append(Problem("--goal harvest_seconds", _NO_END))
    if is_long and any(setting.scenario.picker_absences for setting in settings):
        problems.append(Problem("--horizon long", _ABSENCES, "picker_absences"))
    if options.model == "full":
        if is_long:
            problems.append(Problem("--model full", _NO_LONG_RUN))
        return problems
    model = f"--model {options.model}"
    own_agents = set[str]()
    for setting in settings:
        own_agents.update(setting.scenario.agents, setting.scenario.agents_without_body)
    if own_agents:
        names = ", ".join(sorted(own_agents))
        text = f"only the full model knows agents of your own ({names}); choose --model full"
        problems.append(Problem(model, text, "agents"))
    if not all(setting.scenario.sensors.are_exact for setting in settings):
        problems.append(Problem(model, _SENSORS, "sensors"))
    return problems


def _price_problems(settings: Sequence[Setting], options: StudyOptions) -> list[Problem]:
    """Return a problem if pickers vary and have no price, but the study asks for the least cost.

    Carriers may vary without a price: the table is of use. Only a study with a deadline refuses
    that, in `orchard.study.finishing`.
    """
    numbers = {setting.scenario.pickers for setting in settings}
    is_of_costs = options.goal in (None, "cost_per_bin") and have_prices(settings)
    if not is_of_costs or len(numbers) == 1:
        return []
    return free_robots(settings, "pickers")


def free_robots(settings: Sequence[Setting], key: str) -> list[Problem]:
    """Return a problem if robots of a kind cost nothing, while something else has a price.

    `key`: pickers or carriers; the caller knows that this number varies.
    """
    for setting in settings:
        prices = setting.scenario.prices
        is_paid = prices.are_of_carriers
        if key == "pickers":
            is_paid = prices.are_of_pickers
        if prices.are_set and not is_paid:
            text = _FREE.format(key=key, price=_PRICES[key])
            return [Problem(f"--vary {key}", text, "prices")]
    return []


def _plugin_problems(settings: Sequence[Setting], model: Models) -> list[Problem]:
    """Return what is wrong with own classes. Settings with the same classes are checked once."""
    # The key and the path of each own class -> a setting with these classes.
    with_own: dict[tuple[tuple[str, str], ...], Setting] = {}
    for setting in settings:
        classes = setting.scenario.own_classes
        if classes:
            with_own[tuple(classes.items())] = setting
    problems = []
    for setting in with_own.values():
        problems += _plugin_problems_of(setting, model)
    return problems


def _plugin_problems_of(setting: Setting, model: Models) -> list[Problem]:
    """Return what is wrong with the own classes of a setting."""
    try:
        layout = lay_out(setting.scenario)
        check_plugins(layout)
        own_steps = [step.__name__ for step in route_of(layout).Steps]
    except ScenarioError as error:
        # Values that vary stand in no file, so the setting is named in its place.
        return [replace(problem, file=setting.words or problem.file) for problem in error.problems]
    if model == "full" or not own_steps:
        return []
    names = ", ".join(own_steps)
    text = f"only the full model knows steps of your own ({names}); choose --model full"
    return [Problem(f"--model {model}", text, "route", setting.scenario.route)]
