"""The answer of a study in one sentence."""

from collections.abc import Sequence
from math import prod
from typing import Any

from orchard.study.result import Goal, Row, StudyResult
from orchard.study.words import COUNTED, counted, interval_words, number_words, setting_words, value_words

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
    """How many settings the answer is about, if these are not all."""
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
    """What cannot be told apart from the best; '' if it is alone."""
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
    """The settings that cannot be told apart from the best, those first with the mean that is nearest to its mean."""
    best = getattr(result.best_row, result.goal).mean
    rows = [row for row in result.table if row.setting in result.indistinguishable]
    return [row.setting for row in sorted(rows, key=lambda row: abs(getattr(row, result.goal).mean - best))]


def _one(setting: dict[str, Any]) -> str:
    """A setting in words, in brackets if it has a comma of its own."""
    words = setting_words(setting)
    return f"({words})" if "," in words else words


def _only_difference(settings: Sequence[dict[str, Any]]) -> str | None:
    """The one key in which settings differ; None if there are several."""
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
    """Words with commas and 'and'; of many the first ones, and how many more there are."""
    if len(words) > MOST_NAMED + 1:
        words = [*words[:MOST_NAMED], f"{len(words) - MOST_NAMED} more"]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _checked(best: Row, result: StudyResult) -> str:
    """What the simulator says of the best setting, and whether it puts another one first; '' if it was not asked."""
    if best.check is None:
        return ""
    check, share = best.check, abs(best.check.difference)
    jams = f", and {check.jammed} of {check.replications} of its runs jammed" if check.jammed else ""
    if check.jammed == check.replications:
        return "in the simulator it jams"
    than = "the same" if share < 0.0005 else f"{100.0 * share:.1f} % {'more' if check.difference > 0 else 'less'}"
    return f"the simulator says {interval_words(check.bins_per_hour)}, {than}{jams}{_overtaken(best, result)}"


def _overtaken(best: Row, result: StudyResult) -> str:
    """The setting that is better than the best for certain in the simulator, if it is about bins or time; '' if there is none."""
    if best.check is None or result.goal == "cost_per_bin":
        return ""
    rates = [(row.check.bins_per_hour, row.setting) for row in result.table if row.check is not None]
    first, setting = max(rates, key=lambda one: one[0].mean)
    is_ahead = first.low > best.check.bins_per_hour.high
    return f", and prefers {setting_words(setting)} with {interval_words(first)}" if is_ahead else ""


def _unsure(best: Row) -> str:
    return f"{best.jammed} of its {best.replications} runs jammed" if best.jammed else ""
