"""What a user has entered: the values of a scenario, and what is wrong with each.

A path names a value in the scenario file, as `picking.spread.cv`. Own classes are agents, policies
and rules of the user's own code, which a scenario file may name.
"""

import re
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any

from orchard.app.entries import MEASURES, entries, flat, label_of, words_of
from orchard.app.own_classes import AGENTS, CHOICES
from orchard.app.typed_numbers import advice_on, meanings_of
from orchard.behaviour.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, other_ways, with_changes, with_effect
from orchard.study.words import counted

# Keys of one word that a problem may name.
SHORT_KEYS = ("cv", "distribution", "hours")
# Values that each title names.
IN_TITLE = ("rows", "pickers", "carriers", "seed")


def title_of(scenario: Scenario) -> str:
    """Return a scenario in a line.

    Size and seed come first, then all that is not as in the default scenario.
    """
    default = flat(Scenario())
    carriers = counted("carriers", scenario.carrier_count)
    parts = [f"{scenario.rows} rows, {scenario.pickers} pickers, {carriers}, seed {scenario.seed}"]
    for path, value in flat(scenario).items():
        if path not in IN_TITLE and value != default[path]:
            parts.append(f"{_within_sentence(entries()[path].label)} {words_of(path, value)}")
    if scenario.survey:
        parts.append("surveyed rows")
    if scenario.own_classes:
        parts.append("own classes")
    return ", ".join(parts)


def _within_sentence(label: str) -> str:
    """Return a label as it is written within a sentence. An abbreviation such as GNSS stays."""
    if label[:2].isupper():
        return label
    return label[0].lower() + label[1:]


class Draft:
    """What a user has entered for a scenario.

    `values`: by path; they are replaced, never changed, because copies of a draft share them.
    `scenario`: None while a value is invalid. `problems`: messages by path.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.take(scenario)

    def take(self, scenario: Scenario) -> None:
        """Replace all that is entered by the values of a scenario, and take its own classes."""
        # It has what is not entered on the page: the user's own classes and the survey. Maps of
        # pickers are entered: a picker that goes from a field must not stay.
        self._base = scenario.model_copy(update={"picker_rates": {}, "picker_absences": {}})
        self.values = flat(scenario)
        self._check()

    def become(self, draft: "Draft") -> None:
        """Take all that is entered in another draft, also what is invalid."""
        self._base = draft._base
        self.values = draft.values
        self._check()

    def is_same(self, draft: "Draft") -> bool:
        """Whether another draft has all that this one has."""
        return self.values == draft.values and self._base == draft._base

    @property
    def is_untouched(self) -> bool:
        """Whether it holds the default scenario, so that nothing is lost with it."""
        return self.scenario == Scenario()

    @property
    def told(self) -> dict[str, str]:
        """What to say at each field that has a problem, by path. Each problem is told once.

        A rule about several fields is told at the one that it names first, and the others refer
        to that.
        """
        told: dict[str, str] = {}
        told_at: dict[str, str] = {}
        for path, problem in self.problems.items():
            first = told_at.setdefault(problem, path)
            told[path] = problem if first == path else f"See “{label_of(first)}”."
        return told

    @property
    def title(self) -> str:
        """What is entered, in a line."""
        if self.scenario is None:
            return f"{counted_fields(len(self.problems))} an invalid value"
        return title_of(self.scenario)

    def enter(self, values: Mapping[str, Any]) -> None:
        """Enter values by path, as they are typed, and check all again.

        Some values say the same in different ways, such as a picking speed and a rate. The last
        one that is entered counts: the other ways are left to the program.

        Raises KeyError if there is no such entry.
        """
        typed = {path: entries()[path].typed(value) for path, value in values.items()}
        replaced: dict[str, Any] = {}
        for path, value in typed.items():
            if value is not None:
                replaced |= dict.fromkeys(other_ways(path))
        self.values = self.values | replaced | typed
        self._check()

    @property
    def classes(self) -> dict[str, str]:
        """The user's own classes and functions.

        By the key of the scenario, or the agent, that names them.
        """
        own_classes = self._base.own_classes
        return {
            key: path for key, path in own_classes.items() if self.values.get(key, path) == path
        }

    def drop_classes(self) -> None:
        """Put the built-in classes and rules in place of the user's own."""
        default = Scenario()
        built_in = {path: getattr(default, path) for path in CHOICES if path in self.classes}
        self.values = self.values | built_in
        self._base = self._base.model_copy(
            update={path: getattr(default, path) for path in (*AGENTS, *CHOICES)}
        )
        self._check()

    def problems_with(self, values: dict[str, Any]) -> dict[str, str]:
        """Return what is wrong if some values are others, without entering them: path -> message.

        `values`: by path, as a scenario has them.
        """
        changed = copy(self)
        changed.values = self.values | values
        changed._check()
        return changed.problems

    def _check(self) -> None:
        """Work out `scenario` and `problems` from the values."""
        self.scenario: Scenario | None = None
        self.problems = self._foreign_rules()
        if self.problems:
            return
        try:
            scenario = with_effect(with_changes(self._base, **self.values), "entries")
            if self.classes:
                check_plugins(lay_out(scenario))
        except ScenarioError as error:
            messages = self._by_field(error.problems)
            self.problems = {path: text + self._advice(path) for path, text in messages.items()}
        except ValueError as error:
            self.problems = {"agents": str(error)}
        else:
            self.scenario = scenario

    def _advice(self, path: str) -> str:
        """Return advice on a number that can be read in two ways.

        Return '' for all else, and if the number is refused in both ways.
        """
        text = self.values.get(path)
        accepted = [meaning for meaning in meanings_of(text) if self._is_accepted(path, meaning)]
        return advice_on(text, accepted)

    def _is_accepted(self, path: str, text: str) -> bool:
        """Whether nothing is wrong with an entry by itself, if this is typed there."""
        entry = entries()[path]
        value = entry.from_page(entry.typed(text))
        try:
            with_changes(self._base, **self.values | {path: value})
        except ScenarioError as error:
            for problem in error.problems:
                if problem.path == path:
                    return False
        return True

    def _foreign_rules(self) -> dict[str, str]:
        """Return a message for each rule that is neither built in nor named in the file.

        A link must not run any class.
        """
        problems = {}
        for path, built_in in CHOICES.items():
            if self.values[path] not in (*built_in, getattr(self._base, path)):
                problems[path] = (
                    f"{label_of(path)}: must be {', '.join(built_in)};"
                    " a class of your own must be named in a scenario file"
                )
        return problems

    def _by_field(self, problems: list[Problem]) -> dict[str, str]:
        """Return messages by field. Each begins with what it is about, by the form's labels.

        A rule about several fields appears at each of them, with their values.
        """
        messages: dict[str, str] = {}
        for problem in problems:
            text = self._words_of(problem)
            for path in map(_entry_of, problem.path.split(", ")):
                messages[path] = f"{messages[path]}; {text}" if path in messages else text
        return messages

    def _words_of(self, problem: Problem) -> str:
        """Return a problem as the page says it.

        "Rows: must be ...", or of several values "Rows = 3, Pickers = 4: must be ...".
        """
        paths = problem.path.split(", ")
        if len(paths) > 1:
            about = ", ".join(f"{label_of(path)} = {self._shown(path)}" for path in paths)
            return f"{about}: {_by_labels(problem.text, paths)}"
        entry = entries().get(_entry_of(problem.path))
        if entry is None:
            return f"{problem.what}: {problem.text}"
        is_of_survey = self._base.survey is not None and problem.path in MEASURES
        if is_of_survey:
            return f"{entry.label}: is as surveyed, and cannot be changed here"
        # A message about limits ends with the description of the value in brackets. The form shows
        # the description already, so its own words for the limits are enough. So they are in place
        # of an example of a map or a list as a file has it.
        text = problem.text
        is_for_files = text.endswith(")") or "{" in text or "[" in text
        if entry.wanted and is_for_files:
            text = entry.wanted
        return f"{entry.label}: {_by_labels(text, paths)}"

    def _shown(self, path: str) -> str:
        """Return a value of the draft as words, in the measure of the page."""
        if path not in self.values:
            return "set"
        return words_of(path, self.values[path])


def _entry_of(path: str) -> str:
    """Return the path of the entry that a value is a part of: shift.breaks of shift.breaks.0.1.

    Without such an entry it is the path itself.
    """
    whole = path
    while whole and whole not in entries():
        whole = whole.rpartition(".")[0]
    return whole or path


def counted_fields(number: int) -> str:
    """Return the subject of a sentence on fields: "1 field has", "2 fields have"."""
    if number == 1:
        return "1 field has"
    return f"{number} fields have"


def _by_labels(text: str, paths: Sequence[str]) -> str:
    """Return the text of a problem with the form's labels in place of keys of the file.

    `paths`: what the problem is about.
    """
    for path in sorted(entries(), key=len, reverse=True):
        name = path.rpartition(".")[2]
        # Another key of one word, such as `rows`, may be a word of the sentence.
        is_key = "_" in name or name in SHORT_KEYS
        if is_key and (path == name or path in paths):
            text = re.sub(rf"\b{name}\b", f"“{label_of(path)}”", text)
    none = entries()[paths[-1]].none if paths[-1] in entries() else "automatic"
    return re.sub(r"\bnull\b", f"“{none}”", text)
