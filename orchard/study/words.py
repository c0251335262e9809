"""How a study is said: a setting, a figure and its interval; and the answer in one sentence."""

import re
from collections.abc import Collection, Mapping, Sequence
from math import floor, log10, prod
from typing import Any

from pydantic import BaseModel

from orchard.field.scenario import Scenario
from orchard.study.result import Goal, Interval, Row, StudyResult

GOALS = {"bins_per_hour": "most bins an hour", "cost_per_bin": "least cost of a bin", "harvest_seconds": "shortest harvest"}
COUNTED = ("rows", "pickers", "carriers", "people.workers", "people.visitors", "animals.dogs", "animals.cats", "weeds")  # numbers of things
SAID = {"dispatch": "with {}", "rows_to_pickers": "with {} rows", "route": "on {}"}  # keys whose value says enough
SAME = 1e-9  # of the mean: an interval narrower than that is rounding
TWO_DIGITS = 2.0  # a spread that begins with a 1 keeps two digits, all others one


def setting_words(setting: Mapping[str, Any]) -> str:
    """Return a setting in words: '9 carriers with predictive on two-way, picking speed 0.03'."""
    counts = ", ".join(counted(key, setting[key]) for key in COUNTED if key in setting)
    choices = [words.format(setting[key]) for key, words in SAID.items() if key in setting]
    named = [f"{key_words(key)} {value_words(value)}" for key, value in setting.items() if key not in (*COUNTED, *SAID)]
    first = " ".join(filter(None, [counts, *choices])).removeprefix("with ").removeprefix("on ")
    return ", ".join(filter(None, [first, *named])) or "this scenario"


def orchard_words(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Return the orchard of a study without the keys that vary: '20 rows of 49 m, 10 pickers, one-way, predictive dispatch'."""
    rows = "rows" if "rows" in varied else f"{scenario.rows} rows"
    length = ", as surveyed" if scenario.survey else "" if "row_length" in varied else f" of {scenario.row_length:g} m"
    each = scenario.metres_per_bin
    bins = f", a bin every {each:g} m" if each and "metres_per_bin" not in varied else ""
    words = {
        "pickers": counted("pickers", scenario.pickers),
        "carriers": counted("carriers", scenario.carrier_count),
        "route": scenario.route,
        "dispatch": f"{scenario.dispatch} dispatch",
    }
    return ", ".join([rows + length + bins, *(said for key, said in words.items() if key not in varied)])


def counted(key: str, number: object) -> str:
    """Return a number of things: '9 carriers', '1 worker'."""
    things = key.rpartition(".")[2]
    return f"{value_words(number)} {things.removesuffix('s') if number == 1 else things}"


def key_words(key: str) -> str:
    """Return the words for a key of the scenario: 'picking speed', 'people workers'."""
    return key.replace("_", " ").replace(".", " ")


def axis_words(key: str) -> str:
    """Return the words for a key with the unit of its description: 'picking speed, m/s'."""
    found = re.search(r", (m/s|m|s)(?=;|$)", _description(key))
    return key_words(key) + (found.group(0) if found else "")


def _description(key: str) -> str:
    model: Any = Scenario
    words = ""
    for name in key.split("."):
        field = model.model_fields.get(name) if isinstance(model, type) and issubclass(model, BaseModel) else None
        model, words = (field.annotation, field.description or "") if field else (None, "")
    return words


def value_words(value: object) -> str:
    """Return a value of a setting: '0.03', 'predictive', 'automatic' for none."""
    return "automatic" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def number_words(value: float, spread: float = 0.0) -> str:
    """Return a number with the digits that its spread leaves: 84.1 for 0.6, 1,217 for 12; three digits without one."""
    size = spread / TWO_DIGITS or abs(value) / 100.0
    places = min(3, max(0, -floor(log10(size)))) if size else 0
    return f"{value:,.{places}f}"


def interval_words(interval: Interval | None, sign: str = " ± ") -> str:
    """Return a mean with the larger half of its interval: '84.1 ± 0.6'; '84.1' if it has no width; '' for none."""
    if interval is None:
        return ""
    half = max(interval.high - interval.mean, interval.mean - interval.low)
    if half <= abs(interval.mean) * SAME:
        return number_words(interval.mean)
    return number_words(interval.mean, half) + sign + number_words(half, half)


UNITS: dict[Goal, str] = {"bins_per_hour": "bins an hour", "cost_per_bin": "a bin", "harvest_seconds": "s for the harvest"}
MOST_NAMED = 3  # settings that the sentence names; of more it says how many


def sentence(result: StudyResult) -> str:
    """Return the answer: the best setting, its figures, what cannot be told apart from it, and what the simulator says."""
    if not result.table:
        return "No setting has been run yet."
    if (best := result.best_row) is None:
        return _jammed(result)
    figures = f"{setting_words(best.setting)}: {_figures(best, result)}{_of_those_that_were_run(result)}"
    parts = [figures, _ties(result), _checked(best, result), _unsure(best)]
    return "; ".join(filter(None, parts)) + "."


def _of_those_that_were_run(result: StudyResult) -> str:
    count = prod(len(values) for values in result.varied.values())
    return f", the best of {len(result.table)} of {count} settings" if len(result.table) < count else ""


def _jammed(result: StudyResult) -> str:
    what = setting_words(result.table[0].setting) if len(result.table) == 1 else f"All {len(result.table)} settings"
    return f"{what} jammed: robots waited for each other for ever."


def _figures(best: Row, result: StudyResult) -> str:
    """The figure of the goal with its interval, then bins an hour and cost without."""
    others: list[Goal] = ["bins_per_hour", "cost_per_bin"]
    names = [result.goal, *(name for name in others if name != result.goal)]
    first, *rest = [(figure, UNITS[name]) for name in names if (figure := getattr(best, name)) is not None]
    long_run = " in the long run" if result.horizon == "long" else ""
    return ", ".join([f"{interval_words(first[0])} {first[1]}{long_run}", *(f"{number_words(one.mean)} {unit}" for one, unit in rest)])


def _ties(result: StudyResult) -> str:
    ties = result.indistinguishable
    if not ties or result.best is None:
        return ""
    within = {"budget": " within the budget", "stopped": " so far"}.get(result.stopped_by, "")
    key = _only_difference([result.best, *ties])
    if key is None:
        return f"{_listed([_one(one) for one in _nearest_first(result)])} cannot be told apart from it{within}"
    best, values = result.best[key], [one[key] for one in ties]
    if key not in COUNTED or None in (best, *values):
        return f"{_listed([value_words(value) for value in values])} cannot be told apart from it{within}"
    if best < min(values):
        return f"{_span(values, result.varied.get(key, []))} cannot be told apart{within}"
    named = counted(key, _span([*values, best], result.varied.get(key, [])))
    return f"{named} cannot be told apart{within}: {value_words(min(values))} is the fewest"


def _nearest_first(result: StudyResult) -> list[dict[str, Any]]:
    best = getattr(result.best_row, result.goal).mean
    rows = [row for row in result.table if row.setting in result.indistinguishable]
    return [row.setting for row in sorted(rows, key=lambda row: abs(getattr(row, result.goal).mean - best))]


def _one(setting: dict[str, Any]) -> str:
    """A setting in words, in brackets if it has a comma of its own."""
    words = setting_words(setting)
    return f"({words})" if "," in words else words


def _only_difference(settings: Sequence[dict[str, Any]]) -> str | None:
    keys = [key for key in settings[0] if any(one[key] != settings[0][key] for one in settings)]
    return keys[0] if len(keys) == 1 else None


def _span(values: list[Any], tried: Sequence[Any]) -> str:
    """Numbers in words: '9 to 11' if they are all that were tried from the first to the last, else '9, 11 and 14'."""
    named = sorted(values)
    between = sorted(value for value in tried if value is not None and named[0] <= value <= named[-1])
    if len(named) > 2 and between == named:
        return f"{value_words(named[0])} to {value_words(named[-1])}"
    return _listed([value_words(value) for value in named])


def _listed(words: list[str]) -> str:
    if len(words) > MOST_NAMED + 1:
        words = [*words[:MOST_NAMED], f"{len(words) - MOST_NAMED} more"]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _checked(best: Row, result: StudyResult) -> str:
    if best.check is None:
        return ""
    check, share = best.check, abs(best.check.difference)
    jams = f", and {check.jammed} of {check.replications} of its runs jammed" if check.jammed else ""
    if check.jammed == check.replications:
        return "in the simulator it jams"
    than = "the same" if share < 0.0005 else f"{100.0 * share:.1f} % {'more' if check.difference > 0 else 'less'}"
    return f"the simulator says {interval_words(check.bins_per_hour)}, {than}{jams}{_overtaken(best, result)}"


def _overtaken(best: Row, result: StudyResult) -> str:
    """The setting that is certainly better in the simulator, if it is about bins or time; '' if there is none."""
    if best.check is None or result.goal == "cost_per_bin":
        return ""
    rates = [(row.check.bins_per_hour, row.setting) for row in result.table if row.check is not None]
    first, setting = max(rates, key=lambda one: one[0].mean)
    is_ahead = first.low > best.check.bins_per_hour.high
    return f", and prefers {setting_words(setting)} with {interval_words(first)}" if is_ahead else ""


def _unsure(best: Row) -> str:
    return f"{best.jammed} of its {best.replications} runs jammed" if best.jammed else ""
