"""How a study is said: a setting, a figure and its interval; and the answer in two sentences."""

import re
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from math import ceil, floor, log10
from typing import Any

from pydantic import BaseModel

from orchard.field.scenario import Scenario
from orchard.report.summary import above_optimum, bottleneck_words
from orchard.study.comparing import LOOKS
from orchard.study.result import Goal, Interval, Row, StudyResult
from orchard.study.spread import is_number

GOALS = {
    "bins_per_hour": "most bins an hour",
    "cost_per_bin": "least cost of a bin",
    "harvest_seconds": "shortest harvest",
}
# Keys that are numbers of things.
COUNTED = (
    "rows",
    "pickers",
    "carriers",
    "bays",
    "people.workers",
    "people.visitors",
    "animals.dogs",
    "animals.cats",
    "weeds",
)
# Numbers of which few are good.
ROBOTS = ("pickers", "carriers")
# Keys that need no name: the value says enough.
PHRASES = {
    "dispatch": "with {}",
    "rows_to_pickers": "with {} rows",
    "order_in_row": "{} in rows",
    "route": "on {}",
}
MOST_SECONDS = 120.0  # s: a longer time is told in minutes
# Min: a longer time is told in hours.
MOST_MINUTES = 120.0
# Of the mean: an interval narrower than that is rounding.
SAME = 1e-9
# As a share: it would be shown as 0.0 %.
NO_DIFFERENCE = 0.0005
# A spread that begins with a 1 keeps two digits, all others one.
TWO_DIGITS = 2.0


def setting_words(setting: Mapping[str, Any]) -> str:
    """Return a setting in words: '9 carriers with predictive on two-way, picking speed 0.03'."""
    counts = ", ".join(counted(key, setting[key]) for key in COUNTED if key in setting)
    choices = [words.format(setting[key]) for key, words in PHRASES.items() if key in setting]
    first = " ".join(filter(None, [counts, *choices]))
    parts = [first.removeprefix("with ").removeprefix("on ")]
    for key, value in setting.items():
        if key not in COUNTED and key not in PHRASES:
            parts.append(f"{key_words(key)} {value_words(value, key)}")
    return ", ".join(filter(None, parts)) or "this scenario"


def orchard_words(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Return the orchard of a study without the keys that vary: '20 rows of 49 m, 10 pickers,
    one-way, predictive dispatch, 5.5 m from row to row, ...'. Speeds and handling are always said.
    """
    words = {
        "pickers": counted("pickers", scenario.pickers) + _rate_words(scenario, varied),
        "carriers": counted("carriers", scenario.carrier_count),
        "route": scenario.route,
        "dispatch": f"{scenario.dispatch} dispatch",
    }
    parts = [_rows_words(scenario, varied)]
    words |= _machine_words(scenario)
    parts += [phrase for key, phrase in words.items() if key not in varied]
    return ", ".join(parts)


def _machine_words(scenario: Scenario) -> dict[str, str]:
    """Return the spacing of rows, and what machines can, in words, by the keys that say it."""
    handling = scenario.handling
    row_width = f"{scenario.row_pitch:.4g} m from row to row"
    if scenario.survey is not None:
        row_width += " on average"
    words = {
        "row_width": row_width,
        "carrying.speed": f"carriers at {scenario.carrying.speed:g} m/s",
        "picking.driving_speed": f"pickers that drive at {scenario.picking.driving_speed:g} m/s",
        "handling.unloading": f"{handling.unloading:g} s at the bay",
        "handling.coupling": f"{handling.coupling:g} s to couple a bin",
        "handling.uncoupling": f"{handling.uncoupling:g} s to uncouple it",
    }
    if scenario.bays > 1:
        words["bays"] = f"{scenario.bays} carriers unload at a time"
    if handling.exchange:
        words["handling.exchange"] = f"{handling.exchange:g} s with the empty bin"
    return words | _load_out_words(scenario)


def _load_out_words(scenario: Scenario) -> dict[str, str]:
    """Return how long carriers, or trailers, are away at the load-out, in words, by their keys."""
    words = _way_words(scenario)
    trailers = scenario.load_out.trailers
    if trailers.count is not None and trailers.bins is not None:
        words["load_out.trailers.count"] = counted("trailers", trailers.count)
        words["load_out.trailers.bins"] = f"{counted('bins', trailers.bins)} on each"
    truck = scenario.load_out.truck
    if truck.every is not None and truck.bins is not None:
        words["load_out.truck.every"] = f"a truck every {truck.every:g} s"
        words["load_out.truck.bins"] = f"{counted('bins', truck.bins)} on it"
    empty_bins = scenario.load_out.empty_bins
    if empty_bins is not None:
        words["load_out.empty_bins"] = f"{counted('empty bins', empty_bins)} at the bay"
    return words


def _way_words(scenario: Scenario) -> dict[str, str]:
    """Return the way to the load-out in words, by the key that says it."""
    load_out = scenario.load_out
    if load_out.seconds_away is not None:
        return {"load_out.seconds_away": f"{load_out.seconds_away:g} s away at the load-out"}
    if load_out.metres is None:
        return {}
    return {
        "load_out.metres": (
            f"a load-out {load_out.metres:g} m away, {load_out.speed:g} m/s on the way to it"
        ),
        "load_out.seconds": f"{load_out.seconds:g} s there",
    }


def _rows_words(scenario: Scenario, varied: Collection[str]) -> str:
    """Return how many rows there are, how long they are, and what fills a bin."""
    words = "rows"
    if "rows" not in varied:
        words = f"{scenario.rows} rows"
    if scenario.survey:
        words += ", as surveyed"
    elif "row_length" not in varied:
        words += f" of {scenario.row_length:g} m"
    if "metres_per_bin" in varied or "bins_per_row" in varied:
        return words
    if scenario.bin_metres:
        return f"{words}, a bin every {scenario.bin_metres:.3g} m"
    return f"{words}, one bin a row"


def _rate_words(scenario: Scenario, varied: Collection[str]) -> str:
    """Return how fast pickers are, if the scenario says so by a rate."""
    rate = scenario.picking_rate
    if not rate or "picking_rate" in varied:
        return ""
    return f" at {rate:g} bins an hour"


def counted(key: str, number: object) -> str:
    """Return a number of things: '9 carriers', '1 worker'."""
    things = key.rpartition(".")[2]
    if number == 1:
        things = things.removesuffix("s")
    return f"{value_words(number)} {things}"


def key_words(key: str) -> str:
    """Return the words for a key of the scenario: 'picking speed', 'people workers'."""
    return key.replace("_", " ").replace(".", " ")


def axis_words(key: str) -> str:
    """Return the words for a key with the unit of its description: 'picking speed, m/s'."""
    words = key_words(key)
    unit = re.search(r", (m/s|m|s)(?=;|$)", _description(key))
    if unit is None:
        return words
    return words + unit.group(0)


def _description(key: str) -> str:
    """Return the description of a key of the scenario; '' for what is none."""
    model: Any = Scenario
    words = ""
    for name in key.split("."):
        is_section = isinstance(model, type) and issubclass(model, BaseModel)
        if not is_section or name not in model.model_fields:
            return ""
        field = model.model_fields[name]
        model = field.annotation
        words = field.description or ""
    return words


def value_words(value: object, key: str = "") -> str:
    """Return a value of a setting: '0.03', 'predictive', and for none what the key's description
    says: 'never'.
    """
    if value is None:
        return none_words(_description(key))
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)


def none_words(description: str) -> str:
    """Return the words for no value that a description gives.

    They end a sentence of it, as after `null: never` or `null: no days`; else they are 'automatic'.
    """
    meaning = re.search(r"null: ((?:no )?\w+)(?:\.|$)", description)
    if meaning is None:
        return "automatic"
    return meaning.group(1)


def number_words(value: float, spread: float = 0.0) -> str:
    """Return a number with the digits that its spread leaves: 84.1 for 0.6, 1,217 for 12; three
    digits without one.
    """
    size = spread / TWO_DIGITS or abs(value) / 100.0
    places = 0
    if size:
        places = min(3, max(0, -floor(log10(size))))
    return f"{value:,.{places}f}"


def interval_words(interval: Interval | None, sign: str = " ± ") -> str:
    """Return a mean with the larger half of its interval: '84.1 ± 0.6'; '84.1' if it has no width;
    '' for none.
    """
    if interval is None:
        return ""
    half = max(interval.high - interval.mean, interval.mean - interval.low)
    if half <= abs(interval.mean) * SAME:
        return number_words(interval.mean)
    return number_words(interval.mean, half) + sign + number_words(half, half)


UNITS: dict[Goal, str] = {
    "bins_per_hour": "bins an hour",
    "cost_per_bin": "a bin",
    "harvest_seconds": "s for the harvest",
}
# Settings that the answer names; of more it says how many.
MOST_NAMED = 3


def answer(result: StudyResult) -> str:
    """Return the answer in two sentences: the best setting, its figures and what is not sure of it;
    and for which orchard that holds.
    """
    if not result.table:
        return "No setting has been run yet."
    if result.given:
        words = _given_words(result)
    else:
        words = _chosen_words(result)
    if result.not_run and result.best_rows:
        return f"So far {words}"
    return words


def _chosen_words(result: StudyResult) -> str:
    """Return the answer of a study in which all that varies can be chosen."""
    best = result.best_row
    if best is None:
        return _all_jammed(result)
    parts = [
        f"{_best_words(best, result)}: {_figures(best, result)}",
        _optimum(best),
        _not_run(result),
        _end(result),
        _alike(result),
        _undecided(result),
        _checked(best, result),
    ]
    orchard = (
        f"The orchard: {result.orchard}; without traffic {bottleneck_words(best.bottleneck)} would"
        f" allow {number_words(best.bound_bins_per_hour)} bins an hour"
    )
    return f"{'; '.join(filter(None, parts))}. {orchard}."


def _given_words(result: StudyResult) -> str:
    """Return the answer for each combination of values that nobody chooses: no best of all."""
    groups = dict[str, list[Row]]()
    for row in result.table:
        given = [row.setting[key] for key in result.given]
        groups.setdefault(repr(given), []).append(row)
    answers = [_of_group(rows, result) for rows in groups.values()]
    if len(answers) > MOST_NAMED + 1:
        between = f"{len(answers) - 2} more in the table"
        answers = [answers[0], between, answers[-1]]
    keys = " and ".join(map(key_words, result.given))
    consequence = "there is no best"
    if any(row.standing == "best" for row in result.table):
        consequence = "each has a best of its own"
    parts = [
        *answers,
        f"{keys} {_is_or_are(result.given)} given and not chosen, so {consequence}",
        _not_run(result),
        _end(result),
        _undecided_choices(result),
    ]
    return f"{'; '.join(filter(None, parts))}. The orchard: {result.orchard}."


def _is_or_are(subjects: Sequence[object]) -> str:
    """Return the verb for so many subjects."""
    if len(subjects) == 1:
        return "is"
    return "are"


def _of_group(rows: Sequence[Row], result: StudyResult) -> str:
    """Return the best choice, or the figures alone, of rows in which what nobody chooses is the
    same.
    """
    circumstances = setting_words({key: rows[0].setting[key] for key in result.given})
    for row in rows:
        if row.standing == "alone":
            return f"{circumstances}: {_figures(row, result)}"
        if row.standing == "best":
            return f"{circumstances}: {_choice(row, result)}{_figures(row, result)}"
    return f"{circumstances}: jammed"


def _choice(best: Row, result: StudyResult) -> str:
    """Return what is chosen of the values of a best setting: '9 carriers, '; '' if nothing is."""
    chosen = {key: value for key, value in best.setting.items() if key not in result.given}
    if not chosen:
        return ""
    return f"{setting_words(chosen)}, "


def _undecided_choices(result: StudyResult) -> str:
    """Return what more runs would tell of the choices, if they are not decided."""
    if not result.undecided or result.not_run:
        return ""
    tell = f"to tell {len(result.undecided)} of the settings from the best"
    return _more_runs(tell, result.seconds_needed)


def _more_runs(tell: str, seconds: float | None) -> str:
    """Return that runs are too few, and how many more would do. `tell`: 'to tell a from b'."""
    if seconds is None:
        return f"{LOOKS[-1]} runs of each are too few {tell}"
    return f"not enough runs {tell}: {_time_words(seconds)} more would"


def _time_words(seconds: float) -> str:
    """Return a time that more runs need, rounded up: '40 s', '59 min', '3 h'."""
    if seconds <= MOST_SECONDS:
        return f"{max(1, ceil(seconds))} s"
    if seconds <= MOST_MINUTES * 60.0:
        return f"{ceil(seconds / 60.0)} min"
    return f"{ceil(seconds / 3600.0):,} h"


def _all_jammed(result: StudyResult) -> str:
    """Return that no setting of the table has a harvest."""
    if len(result.table) == 1:
        settings = setting_words(result.table[0].setting)
    else:
        settings = f"All {len(result.table)} settings"
    parts = [f"{settings} jammed: some robots waited for ever", _not_run(result)]
    return f"{'; '.join(filter(None, parts))}."


def _best_words(best: Row, result: StudyResult) -> str:
    """Return the best setting. An end of a range comes first: 'At least 8 pickers, 3 carriers'."""
    rest = dict(best.setting)
    parts = []
    for key, value in result.beyond.items():
        words = setting_words({key: best.setting[key]})
        if value > best.setting[key]:
            parts.append(f"at least {words}")
            del rest[key]
        elif not result.undecided:
            parts.append(f"at most {words}")
            del rest[key]
    if not parts:
        return setting_words(rest)
    if rest:
        parts.append(setting_words(rest))
    words = ", ".join(parts)
    return words[0].upper() + words[1:]


def _not_run(result: StudyResult) -> str:
    """Return what is asked for and has no run yet: then nothing is said of what lies beyond."""
    if not result.not_run:
        return ""
    count = len(result.not_run)
    all_of_them = count + len(result.table)
    some = _in_brackets(_nearest_not_run(result))
    if count == 1:
        words = f"1 of {all_of_them} settings has not run, {some}"
        them = "it"
    else:
        words = f"{count} of {all_of_them} settings have not run, such as {some}"
        them = "each once"
    if not result.given:
        words += ", and may be better"
    if result.seconds_needed is None:
        return words
    return f"{words}: {_time_words(result.seconds_needed)} more would run {them}"


def _nearest_not_run(result: StudyResult) -> dict[str, Any]:
    """Return the setting without a run that differs least from the best one so far."""
    best = result.best
    if best is None:
        return result.not_run[0]
    return min(result.not_run, key=partial(_difference, best))


def _difference(setting: Mapping[str, Any], other: Mapping[str, Any]) -> tuple[int, float]:
    """Return in how many keys two settings differ, and by how much in numbers."""
    different = 0
    distances = []
    for key, value in setting.items():
        if value == other[key]:
            continue
        different += 1
        if is_number(value) and is_number(other[key]):
            distances.append(abs(value - other[key]))
    return different, sum(distances)


def _figures(best: Row, result: StudyResult) -> str:
    """Return the figure of the goal with its interval, then bins an hour and cost.

    The least cost of one harvest has its time too: it may be the same for a long one and a short
    one.
    """
    goals: list[Goal] = [result.goal, "bins_per_hour", "cost_per_bin"]
    if result.goal == "cost_per_bin" and result.horizon == "harvest":
        goals.append("harvest_seconds")
    parts: list[str] = []
    for goal in dict.fromkeys(goals):
        figure: Interval | None = getattr(best, goal)
        if figure is None:
            continue
        if parts:
            parts.append(f"{number_words(figure.mean)} {UNITS[goal]}")
        else:
            parts.append(f"{interval_words(figure)} {UNITS[goal]}")
    words = ", ".join(parts)
    if result.horizon == "long":
        words += " in the long run"
    if best.replications <= 1 and result.is_cut and not result.not_run:
        words += ", known from one run only"
    return words


def _optimum(best: Row) -> str:
    """Return how far the best is from the proven optimum, if that is known."""
    if best.proven_seconds is None or best.harvest_seconds is None:
        return ""
    return above_optimum(best.harvest_seconds.mean, best.proven_seconds)


def _end(result: StudyResult) -> str:
    """Return that the best is the last one of what was tried."""
    further = [setting_words({key: value}) for key, value in result.beyond.items()]
    if not further:
        return ""
    return f"the range is too small, as {_listed(further)} may be better"


def _alike(result: StudyResult) -> str:
    """Return what is as good as the best, once nothing may be better."""
    equal = result.equal_settings
    best = result.best_row
    is_open = result.beyond or result.undecided or result.not_run
    if not equal or best is None or is_open:
        return ""
    within = f"{100.0 * result.within:g} %"
    if best.lead is not None and best.lead.high > result.within:
        half = best.lead.high - best.lead.mean
        return (
            f"the best mean is {100.0 * best.lead.mean:.1f} ± {100.0 * half:.1f} % ahead, where"
            f" {within} count"
        )
    key = _only_difference([best.setting, *equal])
    if key in ROBOTS and result.goal != "cost_per_bin":
        numbers = [setting[key] for setting in equal]
        if None not in (best.setting[key], *numbers):
            return f"{_more_robots(best.setting[key], numbers)} less than {within}"
    return f"{_listed(_named(equal, key))} {_is_or_are(equal)} within {within} of it"


def _named(settings: Sequence[Mapping[str, Any]], key: str | None) -> list[str]:
    """Return settings in words: by a value, if this is the only key in which they differ."""
    if key is None:
        return [_in_brackets(setting) for setting in settings]
    return [value_words(setting[key]) for setting in settings]


def _more_robots(best: int, larger: Sequence[int]) -> str:
    """Return that more robots gain: by one more, or by so many."""
    following = min(larger)
    if following == best + 1:
        return "one more gains"
    return f"{value_words(following)} gain"


def _undecided(result: StudyResult) -> str:
    """Return what more runs would tell of the best, if it is not decided."""
    if not result.undecided or result.best is None or result.not_run:
        return ""
    others = [setting for setting in result.undecided if setting != result.best]
    if not others:
        others = result.equal_settings
    if not others:
        return ""
    key = _only_difference([result.best, *others])
    best, *names = _named([result.best, *others], key)
    return _more_runs(f"to tell {_listed(names)} from {best}", result.seconds_needed)


def _in_brackets(setting: Mapping[str, Any]) -> str:
    """Return a setting in words, in brackets if it has a comma of its own."""
    words = setting_words(setting)
    if "," in words:
        return f"({words})"
    return words


def _only_difference(settings: Sequence[dict[str, Any]]) -> str | None:
    """Return the key in which the settings differ; None if there are several, or none."""
    first, *others = settings
    differences = set[str]()
    for other in others:
        differences.update(key for key in first if other[key] != first[key])
    if len(differences) != 1:
        return None
    (key,) = differences
    return key


def _listed(words: list[str]) -> str:
    """Return some words as a list in a sentence: 'a, b and c'."""
    if len(words) > MOST_NAMED + 1:
        words = [*words[:MOST_NAMED], f"{len(words) - MOST_NAMED} more"]
    *first, last = words
    if not first:
        return last
    return f"{', '.join(first)} and {last}"


def _checked(best: Row, result: StudyResult) -> str:
    """Return what the simulator says of the best, if it was checked."""
    check = best.check
    if check is None:
        return ""
    if check.jammed == check.replications:
        return "in the simulator it jams"
    words = f"the simulator says {interval_words(check.bins_per_hour)}, "
    percent = f"{100.0 * abs(check.difference):.1f} %"
    if abs(check.difference) < NO_DIFFERENCE:
        words += "the same"
    elif check.difference > 0.0:
        words += f"{percent} more"
    else:
        words += f"{percent} less"
    if check.jammed:
        words += f", and {check.jammed} of {check.replications} of its runs jammed"
    return words + _overtaken(best, result)


def _overtaken(best: Row, result: StudyResult) -> str:
    """Return the setting that is certainly better in the simulator, if it is about bins or time;
    '' if there is none.
    """
    if best.check is None or result.goal == "cost_per_bin":
        return ""
    first = best
    rate = best.check.bins_per_hour
    for row in result.table:
        if row.check is not None and row.check.bins_per_hour.mean > rate.mean:
            first = row
            rate = row.check.bins_per_hour
    if rate.low <= best.check.bins_per_hour.high * (1.0 + result.within):
        return ""
    return f", and prefers {setting_words(first.setting)} with {interval_words(rate)}"
