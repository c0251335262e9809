"""A sensitivity in words: the answer in a few sentences, and the table.

"What is unsure" is the variance of the results.
"""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from orchard.study.result import Interval
from orchard.study.sensitivity.result import Effect, SensitivityResult
from orchard.study.words import UNITS, key_words, number_words

# A share of all variance: values with a smaller one are not named.
WORTH_NAMING = 0.05
MOST_NAMED = 3
# The least share for which the words are used, from the largest to the smallest one.
SHARE_WORDS = (
    (0.9, "nearly all"),
    (0.72, "most"),
    (0.62, "about two thirds"),
    (0.55, "more than half"),
    (0.45, "about half"),
    (0.37, "about two fifths"),
    (0.28, "about a third"),
)
# Key -> the words for a value, where its own words may be taken for another measure.
NAMES = {"row_width": "row width from tree to tree"}
LUCK = "luck of the seed"
UNFITTED = "not told by the fit"
HEADS = ("moved", "from", "to", "at low", "at high", "by itself, %", "in all, %")


def answer(result: SensitivityResult) -> str:
    """Return the answer: how unsure the result is, and what that comes from."""
    if result.jammed and not result.points:
        return "All points that have run jammed: some robots waited for ever."
    if not result.points:
        return "No point has been run yet."
    # As many digits as a tenth of the spread needs.
    tenth = (result.spread.high - result.spread.low) / 10.0
    mean = number_words(result.mean, tenth)
    low = number_words(result.spread.low, tenth)
    high = number_words(result.spread.high, tenth)
    unit = UNITS[result.goal]
    if result.horizon == "long":
        unit += " in the long run"
    words = f"{mean} {unit}, {low} to {high} in 19 of 20 runs"
    if not result.effects:
        return f"{words}; {result.points} points are too few to say what that hangs on."
    if low == high:
        return f"{mean} {unit} whatever is moved. The orchard: {result.orchard}."
    if result.spread.high - result.spread.low < result.within * abs(result.mean):
        within = f"less than {100.0 * result.within:g} % apart"
        return f"Nothing that is moved matters: {words}, {within}. The orchard: {result.orchard}."
    return f"{words}. {_sources(result)} The orchard: {result.orchard}."


def _sources(result: SensitivityResult) -> str:
    """Return where the variance of the results comes from: values, luck, or what is not fitted."""
    named = [effect for effect in result.effects if effect.total.mean >= WORTH_NAMING]
    named = named[:MOST_NAMED]
    largest = max([result.luck.mean, *(effect.total.mean for effect in named)])
    if result.unfitted.mean >= largest:
        return _untold(result, named)
    if not named or result.luck.mean > named[0].total.mean:
        sentence = f"{_share_words(result.luck.mean)} of what is unsure is the luck of the seed"
        parts = [f"{_percent(effect.total)} % comes from {_moved(effect)}" for effect in named]
        return f"{'; '.join([sentence, *parts, *_unfitted(result)])}."
    first = named[0]
    parts = [
        f"{_share_words(first.total.mean)} of what is unsure comes from {_moved(first)}:"
        f" {_percent(first.total)} %"
    ]
    parts += [f"{_percent(effect.total)} % from {_moved(effect)}" for effect in named[1:]]
    parts.append(f"the luck of the seed is {_percent(result.luck)} %")
    return f"{'; '.join([*parts, *_unfitted(result)])}."


def _untold(result: SensitivityResult, named: Sequence[Effect]) -> str:
    """Return the sources if the largest part of the variance is what the fit does not tell.

    Then nobody knows which value has the largest share.
    """
    share = _share_words(result.unfitted.mean)
    parts = [f"{share} of what is unsure is not told by the fit, and may come from any value"]
    parts += [f"at least {_percent(effect.total)} % from {_moved(effect)}" for effect in named]
    parts.append(f"the luck of the seed is {_percent(result.luck)} %")
    return f"{'; '.join(parts)}."


def _unfitted(result: SensitivityResult) -> list[str]:
    """Return how much the fit does not tell, if that is worth naming."""
    if result.unfitted.mean < WORTH_NAMING:
        return []
    return [f"{_percent(result.unfitted)} % is not told by the fit"]


def _share_words(share: float) -> str:
    """Return a share in words, as a sentence begins: 'Half'."""
    for least, words in SHARE_WORDS:
        if share >= least:
            return words.capitalize()
    return "The largest part"


def _moved(effect: Effect) -> str:
    """Return a value with its range: 'picking rate (1.2 to 1.8)'."""
    return f"{value_name(effect.key)} ({effect.low:g} to {effect.high:g})"


def value_name(key: str) -> str:
    """Return the words for a value that is moved: 'picking rate'."""
    return NAMES.get(key, key_words(key))


def _percent(share: Interval) -> str:
    """Return a share with its interval: '72 ± 5'."""
    half = 100.0 * max(share.high - share.mean, share.mean - share.low)
    return f"{100.0 * share.mean:.0f} ± {half:.0f}"


def rows_of(result: SensitivityResult) -> list[list[str]]:
    """Return the cells of the table, by HEADS: the values that are moved, the luck, and what the
    fit does not tell, if there is any.
    """
    # As many digits as this needs.
    tenth = (result.spread.high - result.spread.low) / 10.0
    rows = []
    for effect in result.effects:
        rows.append(
            [
                effect.key,
                f"{effect.low:g}",
                f"{effect.high:g}",
                _end(effect.at_low, tenth),
                _end(effect.at_high, tenth),
                _percent(effect.first_order),
                _percent(effect.total),
            ]
        )
    luck = _percent(result.luck)
    rows.append([LUCK, "", "", "", "", luck, luck])
    if result.unfitted.mean:
        rest = _percent(result.unfitted)
        rows.append([UNFITTED, "", "", "", "", rest, rest])
    return rows


def _end(mean: float | None, spread: float) -> str:
    """Return the mean result at an end of a value; '' if it is not known."""
    if mean is None:
        return ""
    return number_words(mean, spread)


def legend(result: SensitivityResult) -> str:
    """Return what the columns of the table mean."""
    return (
        "at low, at high: the mean result at the ends. by itself: the share of all"
        " variance that would be gone if this value were known; in all: that would be left if all"
        f" but this one were. ± interval of {100.0 * result.confidence:g} % confidence, by"
        " bootstrap."
    )


def as_table(result: SensitivityResult) -> Table:
    """Return the table for a terminal."""
    caption = legend(result)
    table = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left"
    )
    for head in HEADS:
        table.add_column(escape(head), overflow="fold")
    for row in rows_of(result):
        table.add_row(*map(escape, row))
    return table
