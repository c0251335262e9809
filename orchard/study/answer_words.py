"""The answer of a study in two sentences: the best setting, and for which orchard that holds.

The answer consists of parts, each by a function below that returns "" if there is nothing to say.
`orchard.study.finish_words` has the answer of a study with a deadline.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from math import ceil
from typing import Any

from orchard.report.summary import above_optimum, bottleneck_words
from orchard.study.comparing import LOOKS
from orchard.study.result import Goal, Interval, Row, StudyResult
from orchard.study.spread import is_number
from orchard.study.words import (
    UNITS,
    interval_words,
    key_words,
    number_words,
    setting_words,
    value_words,
)

# Keys of numbers of robots, of which fewer are better.
ROBOTS = ("pickers", "carriers")
# A time of more seconds than this is given in minutes, and one of more minutes than this in hours.
MOST_SECONDS = 120.0
MOST_MINUTES = 120.0
# A share below this would be shown as 0.0 %.
NO_DIFFERENCE = 0.0005
# How many settings a sentence names at most; of the others it says how many there are.
MOST_NAMED = 3


def answer(result: StudyResult) -> str:
    """Return the answer in two sentences: the best setting with its figures, and what is not
    certain; then the orchard for which this holds.
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
    """Return the answer of a study in which the user can choose everything that varies."""
    best = result.best_row
    if best is None:
        return _all_jammed(result)
    parts = [
        f"{_best_words(best, result)}: {_figures(best, result)}",
        _optimum(best),
        failed_words(result.failed),
        _not_run(result),
        _end(result),
        _alike(result),
        _undecided(result),
        _on_the_edge(result),
        _checked(best, result),
    ]
    orchard = (
        f"The orchard: {result.orchard}; without traffic {bottleneck_words(best.bottleneck)} would"
        f" allow {number_words(best.bound_bins_per_hour)} bins an hour"
    )
    return f"{'; '.join(filter(None, parts))}. {orchard}."


def _given_words(result: StudyResult) -> str:
    """Return the answer of a study in which something varies that nobody can choose, such as the
    number of people (`StudyResult.given`): the best choice for each combination of its values.
    """
    # Values of these keys, as text -> their rows.
    groups = dict[str, list[Row]]()
    for row in result.table:
        given = [row.setting[key] for key in result.given]
        groups.setdefault(repr(given), []).append(row)
    answers = [_of_group(rows, result) for rows in groups.values()]
    if len(answers) > MOST_NAMED + 1:
        # Only the first one and the last one are named.
        between = f"{len(answers) - 2} more in the table"
        answers = [answers[0], between, answers[-1]]
    keys = " and ".join(map(key_words, result.given))
    consequence = "there is no best"
    if any(row.standing == "best" for row in result.table):
        consequence = "each has a best of its own"
    parts = [
        *answers,
        f"{keys} {_is_or_are(result.given)} given and not chosen, so {consequence}",
        failed_words(result.failed),
        _not_run(result),
        _end(result),
        _undecided_choices(result),
    ]
    return f"{'; '.join(filter(None, parts))}. The orchard: {result.orchard}."


def _is_or_are(subjects: Sequence[object]) -> str:
    """Return the verb of a sentence with these subjects."""
    if len(subjects) == 1:
        return "is"
    return "are"


def _of_group(rows: Sequence[Row], result: StudyResult) -> str:
    """Return the best choice among rows with the same values of `result.given`; the figures alone
    if there is no choice.
    """
    circumstances = setting_words({key: rows[0].setting[key] for key in result.given})
    for row in rows:
        if row.standing == "alone":
            return f"{circumstances}: {_figures(row, result)}"
        if row.standing == "best":
            return f"{circumstances}: {_choice(row, result)}{_figures(row, result)}"
    return f"{circumstances}: jammed"


def _choice(best: Row, result: StudyResult) -> str:
    """Return the values of a best setting that can be chosen: '9 carriers, '; else ''."""
    chosen = {key: value for key, value in best.setting.items() if key not in result.given}
    if not chosen:
        return ""
    return f"{setting_words(chosen)}, "


def _undecided_choices(result: StudyResult) -> str:
    """Return which of the choices are not decided, and how much more time would decide them."""
    if not result.undecided or result.not_run:
        return ""
    tell = f"to tell {len(result.undecided)} of the settings from the best"
    return _more_runs(tell, result.seconds_needed)


def _more_runs(tell: str, seconds: float | None) -> str:
    """Return that there are too few runs, and how much more time would be enough.

    `tell`: for what, as 'to tell a from b'. `seconds`: None if even the most replications that a
    study makes are too few.
    """
    if seconds is None:
        return f"{LOOKS[-1]} runs of each are too few {tell}"
    return f"not enough runs {tell}: {_time_words(seconds)} more would"


def _time_words(seconds: float) -> str:
    """Return a time rounded up: '40 s', '59 min', '3 h'."""
    if seconds <= MOST_SECONDS:
        return f"{max(1, ceil(seconds))} s"
    if seconds <= MOST_MINUTES * 60.0:
        return f"{ceil(seconds / 60.0)} min"
    return f"{ceil(seconds / 3600.0):,} h"


def _all_jammed(result: StudyResult) -> str:
    """Return the answer of a study in which all settings of the table jammed."""
    if len(result.table) == 1:
        settings = setting_words(result.table[0].setting)
    else:
        settings = f"All {len(result.table)} settings"
    parts = [
        f"{settings} jammed: some robots waited for ever",
        failed_words(result.failed),
        _not_run(result),
    ]
    return f"{'; '.join(filter(None, parts))}."


def _best_words(best: Row, result: StudyResult) -> str:
    """Return the best setting. Values at an end of their range come first, as bounds: 'At least 8
    pickers, 3 carriers'.

    It is no upper bound as long as a setting is not told from the best one: that may have more.
    """
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


def failed_words(failed: Sequence[Mapping[str, Any]]) -> str:
    """Return which settings failed, by an error in the user's own code; '' if none did."""
    if not failed:
        return ""
    first = _in_brackets(failed[0])
    if len(failed) == 1:
        return f"{first} failed, and is left out"
    return f"{len(failed)} settings failed, such as {first}, and are left out"


def _not_run(result: StudyResult) -> str:
    """Return which settings have no run yet, and how much more time would run them."""
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
    """Return in how many keys two settings differ, and the sum of the differences of their numbers.

    Pairs are compared from left to right, so that one key less counts more than any number.
    """
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
    """Return the figure of the goal with its interval, then bins an hour and the cost of a bin.

    If the goal is the least cost of one harvest, its time is added: a long harvest and a short one
    may cost the same. With a shift each harvest has its time, and when it ends.
    """
    goals: list[Goal] = [result.goal, "bins_per_hour", "cost_per_bin"]
    is_by_cost = result.goal == "cost_per_bin" and result.horizon == "harvest"
    if is_by_cost or best.ends:
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
        if goal == "harvest_seconds" and best.ends:
            parts[-1] += f", which ends on {best.ends}"
    words = ", ".join(parts)
    if result.horizon == "long":
        words += " in the long run"
    if best.replications <= 1 and result.is_cut and not result.not_run:
        words += ", known from one run only"
    return words


def _optimum(best: Row) -> str:
    """Return how far the best harvest is from the proven optimum; '' if that is not known."""
    if best.proven_seconds is None or best.harvest_seconds is None:
        return ""
    return above_optimum(best.harvest_seconds.mean, best.proven_seconds)


def _end(result: StudyResult) -> str:
    """Return which values beyond the range that was tried may be better; '' if there are none."""
    further = [setting_words({key: value}) for key, value in result.beyond.items()]
    if not further:
        return ""
    return f"the range is too small, as {_listed(further)} may be better"


def _alike(result: StudyResult) -> str:
    """Return which settings are as good as the best one; '' while something better is possible."""
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
    # The best of equally good settings has the fewest robots, so the others have more.
    if key in ROBOTS and result.goal != "cost_per_bin":
        numbers = [setting[key] for setting in equal]
        if None not in (best.setting[key], *numbers):
            return f"{_more_robots(best.setting[key], numbers)} less than {within}"
    return f"{_listed(_named(equal, key))} {_is_or_are(equal)} within {within} of it"


def _named(settings: Sequence[Mapping[str, Any]], key: str | None) -> list[str]:
    """Return settings in words. `key`: the only one in which they differ, whose value is enough;
    None: they differ in several.
    """
    if key is None:
        return [_in_brackets(setting) for setting in settings]
    return [value_words(setting[key]) for setting in settings]


def _more_robots(best: int, larger: Sequence[int]) -> str:
    """Return the begin of a sentence on what more robots gain: 'one more gains', '9 gain'."""
    following = min(larger)
    if following == best + 1:
        return "one more gains"
    return f"{value_words(following)} gain"


def _undecided(result: StudyResult) -> str:
    """Return from which settings the best one is not told apart yet, and how much more time would
    do that; '' if all is decided.
    """
    if not result.undecided or result.best is None or result.not_run:
        return ""
    others = [setting for setting in result.undecided if setting != result.best]
    if not others:
        # Only the best one itself is undecided: it may be worse than those that are equal.
        others = result.equal_settings
    if not others:
        return ""
    key = _only_difference([result.best, *others])
    best, *names = _named([result.best, *others], key)
    return _more_runs(f"to tell {_listed(names)} from {best}", result.seconds_needed)


def _on_the_edge(result: StudyResult) -> str:
    """Return which settings are so near to the edge of what counts that more runs are not worth it;
    '' if there are none.
    """
    near = result.on_the_edge
    if not near or result.undecided or result.best is None or result.not_run:
        return ""
    names = _named(near, _only_difference([result.best, *near]))
    within = f"{100.0 * result.within:g} %"
    return f"{_listed(names)} may be within {within} of the best mean, too: more runs hardly tell"


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
    """Return the result of the simulator for the best setting; '' if it was not to check it."""
    if best.setting in result.check_failed:
        return "in the simulator it failed, so it is not checked"
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
    """Return the setting that is certainly better than the best one in the simulator, by its bins
    an hour; '' if there is none, or the goal is the cost.
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
