"""Words of a command as the page says them: its labels in place of options and keys."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from orchard.app.entries import entries, label_of
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.words import answer
from orchard.study.words import key_words

DEADLINE_LABEL = "Done within"
BUDGET_LABEL = "Time to take, s"
# Options that the page has no field for, with the words that speak of them.
ONLY_IN_COMMANDS = (
    re.compile(r"^command line: "),
    re.compile(r"; --model full asks the simulator"),
    re.compile(r"; a study without --sensitivity runs the ends themselves: --vary \S+"),
)
# What an option is called on the page.
OPTIONS = (
    (re.compile(r"--finish-(within|by)( [0-9.]+(h|d|min))?"), DEADLINE_LABEL),
    (re.compile(r"--budget( [0-9.]+s)?"), f"“{BUDGET_LABEL}”"),
    (re.compile(r"--duration"), "“End after”"),
    (re.compile(r"--horizon harvest"), "“one harvest”"),
    (re.compile(r"--horizon long"), "“the long run”"),
)


def in_page_words(text: str) -> str:
    """Return a line of a command with the page's labels in place of options and keys.

    >>> in_page_words("--finish-within 0.5h: too short, or a higher picking_rate")
    'Done within: too short, or a higher “Bins an hour each”'
    """
    for only_in_commands in ONLY_IN_COMMANDS:
        text = only_in_commands.sub("", text)
    for option, label in OPTIONS:
        text = option.sub(label, text)
    return _keys().sub(lambda key: f"“{label_of(key[1])}”", text)


@cache
def _keys() -> re.Pattern[str]:
    """Return what matches a key of the scenario that is no word of a sentence."""
    keys = [path for path in entries() if "_" in path or "." in path]
    # The longest first: prices.picker_bought.years is no key of prices.
    longest_first = sorted(keys, key=len, reverse=True)
    return re.compile(rf"(?<![\w.])({'|'.join(map(re.escape, longest_first))})(?![\w.])")


def with_labels(result: SensitivityResult) -> SensitivityResult:
    """Return a sensitivity with the labels of the form in place of keys, in all its words."""
    effects = [replace(effect, key=label_of(effect.key)) for effect in result.effects]
    labelled = replace(result, effects=effects)
    keys = [effect.key for effect in result.effects]
    notes = [in_page_words(_labels_in(note, keys)) for note in result.notes]
    return replace(labelled, answer=answer(labelled), notes=notes)


def _labels_in(note: str, keys: Sequence[str]) -> str:
    """Return a note with labels in place of the words for these keys."""
    for key in sorted(keys, key=len, reverse=True):
        note = re.sub(rf"\b{re.escape(key_words(key))}\b", label_of(key), note)
    return note
