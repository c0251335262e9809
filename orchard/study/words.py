"""How a study is said: a setting, a figure and its interval; and the answer in two sentences."""

import re
from collections.abc import Collection, Mapping, Sequence
from math import ceil, floor, log10
from typing import Any

from pydantic import BaseModel

from orchard.field.scenario import Scenario
from orchard.report.summary import above_optimum
from orchard.study.comparing import LOOKS
from orchard.study.result import Goal, Interval, Row, StudyResult

GOALS = {
    "bins_per_hour": "most bins an hour",
    "cost_per_bin": "least cost of a bin",
    "harvest_seconds": "shortest harvest",
}
COUNTED = (
    "rows",
    "pickers",
    "carriers",
    "people.workers",
    "people.visitors",
    "animals.dogs",
    "animals.cats",
    "weeds",
)  # numbers of things
ROBOTS = ("pickers", "carriers")  # numbers of which few are good
# keys whose value says enough
SAID = {
    "dispatch": "with {}",
    "rows_to_pickers": "with {} rows",
    "order_in_row": "{} in rows",
    "route": "on {}",
}
SAME = 1e-9  # of the mean: an interval narrower than that is rounding
TWO_DIGITS = 2.0  # a spread that begins with a 1 keeps two digits, all others one


def setting_words(setting: Mapping[str, Any]) -> str:
    """Return a setting in words: '9 carriers with predictive on two-way, picking speed 0.03'."""
    counts = ", ".join(counted(key, setting[key]) for key in COUNTED if key in setting)
    choices = [words.format(setting[key]) for key, words in SAID.items() if key in setting]
    named = [
        f"{key_words(key)} {value_words(value, key)}"
        for key, value in setting.items()
        if key not in (*COUNTED, *SAID)
    ]
    first = " ".join(filter(None, [counts, *choices])).removeprefix("with ").removeprefix("on ")
    return ", ".join(filter(None, [first, *named])) or "this scenario"


def orchard_words(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Return the orchard of a study without the keys that vary: '20 rows of 49 m, 10 pickers,
    one-way, predictive dispatch'.
    """
    rows = "rows" if "rows" in varied else f"{scenario.rows} rows"
    length = (
        ", as surveyed"
        if scenario.survey
        else ""
        if "row_length" in varied
        else f" of {scenario.row_length:g} m"
    )
    each, varies = scenario.bin_metres, not {"metres_per_bin", "bins_per_row"}.isdisjoint(varied)
    bins = "" if varies else f", a bin every {each:.3g} m" if each else ", one bin a row"
    rate = scenario.picking_rate
    fast = f" at {rate:g} bins an hour" if rate and "picking_rate" not in varied else ""
    words = {
        "pickers": counted("pickers", scenario.pickers) + fast,
        "carriers": counted("carriers", scenario.carrier_count),
        "route": scenario.route,
        "dispatch": f"{scenario.dispatch} dispatch",
    }
    return ", ".join(
        [rows + length + bins, *(said for key, said in words.items() if key not in varied)]
    )


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
        field = (
            model.model_fields.get(name)
            if isinstance(model, type) and issubclass(model, BaseModel)
            else None
        )
        model, words = (field.annotation, field.description or "") if field else (None, "")
    return words


def value_words(value: object, key: str = "") -> str:
    """Return a value of a setting: '0.03', 'predictive', and for none what the key's description
    says: 'never'.
    """
    return (
        none_words(_description(key))
        if value is None
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


def none_words(description: str) -> str:
    """Return the words for no value that a description gives, as after `null: never`; else
    'automatic'.
    """
    found = re.search(r"null: (\w+)$", description)
    return found.group(1) if found else "automatic"


def number_words(value: float, spread: float = 0.0) -> str:
    """Return a number with the digits that its spread leaves: 84.1 for 0.6, 1,217 for 12; three
    digits without one.
    """
    size = spread / TWO_DIGITS or abs(value) / 100.0
    places = min(3, max(0, -floor(log10(size)))) if size else 0
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
MOST_NAMED = 3  # settings that the answer names; of more it says how many


def answer(result: StudyResult) -> str:
    """Return the answer in two sentences: the best setting, its figures and what is not sure of it;
    and for which orchard that holds.
    """
    if not result.table:
        return "No setting has been run yet."
    if result.given:
        return _given_words(result)
    if (best := result.best_row) is None:
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
    limit = best.bottleneck if best.bottleneck == "unloading" else f"the {best.bottleneck}"
    orchard = (
        f"The orchard: {result.orchard}; without traffic {limit} would allow"
        f" {number_words(best.bound_bins_per_hour)} bins an hour"
    )
    return f"{'; '.join(filter(None, parts))}. {orchard}."


def _given_words(result: StudyResult) -> str:
    """What depends on values that nobody chooses, for each combination of them: no best of all."""
    groups = dict[str, list[Row]]()
    for row in result.table:
        groups.setdefault(repr([row.setting[key] for key in result.given]), []).append(row)
    said = [_of_group(rows, result) for rows in groups.values()]
    if len(said) > MOST_NAMED + 1:
        between = f"{len(said) - 2} more in the table"
        said = [said[0], between, said[-1]]
    keys = " and ".join(map(key_words, result.given))
    is_chosen = any(row.standing == "best" for row in result.table)
    consequence = "each has a best of its own" if is_chosen else "there is no best"
    verb = "is" if len(result.given) == 1 else "are"
    parts = [
        *said,
        f"{keys} {verb} given and not chosen, so {consequence}",
        _not_run(result),
        _end(result),
        _undecided_choices(result),
    ]
    return f"{'; '.join(filter(None, parts))}. The orchard: {result.orchard}."


def _of_group(rows: Sequence[Row], result: StudyResult) -> str:
    """The best choice, or the figures alone, of rows in which what nobody chooses is the same."""
    given = setting_words({key: rows[0].setting[key] for key in result.given})
    best = next((row for row in rows if row.standing in ("best", "alone")), None)
    if best is None:
        return f"{given}: jammed"
    chosen = {key: value for key, value in best.setting.items() if key not in result.given}
    choice = f"{setting_words(chosen)}, " if chosen and best.standing == "best" else ""
    return f"{given}: {choice}{_figures(best, result)}"


def _undecided_choices(result: StudyResult) -> str:
    if not result.undecided or result.not_run:
        return ""
    tell = f"to tell {len(result.undecided)} of the settings from the best"
    return _more_runs(tell, result.seconds_needed)


def _more_runs(tell: str, seconds: float | None) -> str:
    if seconds is None:
        return f"{LOOKS[-1]} runs of each are too few {tell}"
    return f"not enough runs {tell}: {max(1, ceil(seconds)):,} s more would"


def _all_jammed(result: StudyResult) -> str:
    """That no setting of the table has a harvest."""
    if len(result.table) == 1:
        settings = setting_words(result.table[0].setting)
    else:
        settings = f"All {len(result.table)} settings"
    parts = [f"{settings} jammed: some robots waited for ever", _not_run(result)]
    return f"{'; '.join(filter(None, parts))}."


def _best_words(best: Row, result: StudyResult) -> str:
    """The best setting. An end of a range comes first: 'At least 8 pickers, 3 carriers'."""
    ends = dict[str, str]()
    for key, value in result.beyond.items():
        if value > best.setting[key]:
            ends[key] = "at least"
        elif not result.undecided:
            ends[key] = "at most"
    parts = [f"{word} {setting_words({key: best.setting[key]})}" for key, word in ends.items()]
    rest = {key: value for key, value in best.setting.items() if key not in ends}
    if rest or not parts:
        parts.append(setting_words(rest))
    words = ", ".join(parts)
    return words[0].upper() + words[1:] if ends else words


def _not_run(result: StudyResult) -> str:
    """What is asked for and has no run yet: then nothing is said of what lies beyond."""
    if not result.not_run:
        return ""
    count = len(result.not_run)
    all_of_them = count + len(result.table)
    some = setting_words(result.not_run[0])
    if count == 1:
        words = f"1 of {all_of_them} settings has not run, {some}"
    else:
        words = f"{count} of {all_of_them} settings have not run, such as {some}"
    if not result.given:
        words += ", and may be better"
    if result.seconds_needed is None:
        return words
    return f"{words}: {max(1, ceil(result.seconds_needed)):,} s more would run each once"


def _figures(best: Row, result: StudyResult) -> str:
    """Bins an hour and cost; before them the figure of another goal, with its interval.

    The least cost of one harvest has its time too: it may be the same for a long one and a short
    one.
    """
    names: list[Goal] = ["bins_per_hour", "cost_per_bin"]
    if result.goal == "cost_per_bin" and result.horizon == "harvest":
        names.append("harvest_seconds")
    order = [result.goal, *(name for name in names if name != result.goal)]
    first, *rest = [
        (figure, UNITS[name]) for name in order if (figure := getattr(best, name)) is not None
    ]
    run = (
        ""
        if best.replications > 1
        else " in the one run so far"
        if result.stopped_by in ("budget", "stopped")
        else ""
    )
    long_run = " in the long run" if result.horizon == "long" else ""
    others = [f"{number_words(one.mean)} {unit}" for one, unit in rest]
    return ", ".join([f"{interval_words(first[0])} {first[1]}", *others]) + long_run + run


def _optimum(best: Row) -> str:
    if best.proven_seconds is None or best.harvest_seconds is None:
        return ""
    return above_optimum(best.harvest_seconds.mean, best.proven_seconds)


def _end(result: StudyResult) -> str:
    """That the best is the last one of what was tried."""
    further = [setting_words({key: value}) for key, value in result.beyond.items()]
    return f"the range is too small, as {_listed(further)} may be better" if further else ""


def _alike(result: StudyResult) -> str:
    """What is as good as the best."""
    equal = [row.setting for row in result.table if row.standing == "equal"]
    is_open = result.beyond or result.undecided or result.not_run
    if not equal or result.best is None or is_open:
        return ""
    key, within = _only_difference([result.best, *equal]), f"{100.0 * result.within:g} %"
    if (lead := result.best_row and result.best_row.lead) and lead.high > result.within:
        return (
            f"the best mean is {100.0 * lead.mean:.1f} ± {100.0 * (lead.high - lead.mean):.1f} %"
            f" ahead, where {within} count"
        )
    if key is None:
        return (
            f"{_listed([_one(one) for one in equal])} {'is' if len(equal) == 1 else 'are'} within"
            f" {within} of it"
        )
    values = [one[key] for one in equal]
    if key in ROBOTS and result.goal != "cost_per_bin" and None not in (result.best[key], *values):
        following = min(values)
        more = (
            "one more gains"
            if following == result.best[key] + 1
            else f"{value_words(following)} gain"
        )
        return f"{more} less than {within}"
    return (
        f"{_listed(list(map(value_words, values)))} {'is' if len(values) == 1 else 'are'} within"
        f" {within} of it"
    )


def _undecided(result: StudyResult) -> str:
    others = [one for one in result.undecided if one != result.best] or [
        row.setting for row in result.table if row.standing == "equal"
    ]
    if not result.undecided or result.best is None or not others or result.not_run:
        return ""
    key = _only_difference([result.best, *others])
    names = [value_words(one[key]) if key else _one(one) for one in others]
    this = value_words(result.best[key]) if key else _one(result.best)
    tell = f"to tell {_listed(names)} from {this}"
    return _more_runs(tell, result.seconds_needed)


def _one(setting: Mapping[str, Any]) -> str:
    """A setting in words, in brackets if it has a comma of its own."""
    words = setting_words(setting)
    return f"({words})" if "," in words else words


def _only_difference(settings: Sequence[dict[str, Any]]) -> str | None:
    keys = [key for key in settings[0] if any(one[key] != settings[0][key] for one in settings)]
    return keys[0] if len(keys) == 1 else None


def _listed(words: list[str]) -> str:
    if len(words) > MOST_NAMED + 1:
        words = [*words[:MOST_NAMED], f"{len(words) - MOST_NAMED} more"]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _checked(best: Row, result: StudyResult) -> str:
    if best.check is None:
        return ""
    check, share = best.check, abs(best.check.difference)
    jams = (
        f", and {check.jammed} of {check.replications} of its runs jammed" if check.jammed else ""
    )
    if check.jammed == check.replications:
        return "in the simulator it jams"
    than = (
        "the same"
        if share < 0.0005
        else f"{100.0 * share:.1f} % {'more' if check.difference > 0 else 'less'}"
    )
    return (
        f"the simulator says {interval_words(check.bins_per_hour)},"
        f" {than}{jams}{_overtaken(best, result)}"
    )


def _overtaken(best: Row, result: StudyResult) -> str:
    """The setting that is certainly better in the simulator, if it is about bins or time; '' if
    there is none.
    """
    if best.check is None or result.goal == "cost_per_bin":
        return ""
    rates = [
        (row.check.bins_per_hour, row.setting) for row in result.table if row.check is not None
    ]
    first, setting = max(rates, key=lambda one: one[0].mean)
    is_ahead = first.low > best.check.bins_per_hour.high * (1.0 + result.within)
    return (
        f", and prefers {setting_words(setting)} with {interval_words(first)}" if is_ahead else ""
    )
