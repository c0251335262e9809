"""The question of a study: which settings it compares, and by what.

The keys that vary are of two kinds. A choice is a value that the user can decide, such as the
number of carriers. A circumstance is one that nobody can choose, such as the number of people.
Settings are compared only with settings of the same circumstances.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from orchard.field.decisions import is_choice
from orchard.field.scenario import Scenario
from orchard.study.options import StudyOptions
from orchard.study.result import Goal, Model
from orchard.study.settings import (
    CARRIERS,
    Setting,
    have_prices,
    is_possible,
    more_numbers,
    most_carriers,
    settings_of,
)
from orchard.study.spread import number_beyond, spread


@dataclass(kw_only=True)
class Question:
    """What a study is asked. Settings are numbered from 0, and `i` is such a number.

    An open study adds numbers of carriers while it runs, so `settings` and `varied` may grow.
    """

    scenario: Scenario
    #: Key -> all its values.
    varied: dict[str, list[Any]]
    settings: list[Setting]
    options: StudyOptions
    #: Whether the study chooses the numbers of carriers.
    is_open: bool
    #: Sentences about combinations of values that are no settings, because they cannot be together.
    left_out: Sequence[str] = ()

    def __post_init__(self) -> None:
        self.goal: Goal = self.options.goal or _usual_goal(self.settings)
        #: The keys with several values that nobody can choose.
        self.circumstances: list[str] = []
        choices = []
        for key, values in self.varied.items():
            is_compared = len(values) > 1 or (self.is_open and key == CARRIERS)
            if is_compared and is_choice(Scenario, key, values):
                choices.append(key)
            elif is_compared:
                self.circumstances.append(key)
        #: Whether settings are compared, and not only shown beside each other.
        self.has_choices = bool(choices) or not self.circumstances
        #: For how many carriers the orchard has room; 0 if the study is not open.
        self.most_carriers = 0
        if self.is_open:
            self.most_carriers = most_carriers(self.scenario)

    @property
    def model(self) -> Model:
        """The model that does all settings."""
        return self.options.first_model

    def values_of(self, settings: Iterable[int]) -> list[dict[str, Any]]:
        """Return the values of these settings by key."""
        return [self.settings[i].values for i in settings]

    def in_order_of_runs(self) -> list[int]:
        """Return all settings in the order in which they run: first those that tell most of the
        whole range.
        """
        return spread(self.varied, self.values_of(range(len(self.settings))))

    def place(self, i: int) -> tuple[int, ...]:
        """Return where a setting stands in the table: in the order of the values of all keys."""
        return self._place_by(self.varied, i)

    def circumstances_of(self, i: int) -> tuple[int, ...]:
        """Return the circumstances of a setting: for each of these keys the place of its value."""
        return self._place_by(self.circumstances, i)

    def _place_by(self, keys: Iterable[str], i: int) -> tuple[int, ...]:
        values = self.settings[i].values
        return tuple(self.varied[key].index(values[key]) for key in keys)

    def robots(self, i: int) -> int:
        """Return the number of robots of a setting, of trailers, chargers and places that unload,
        of which few are good.

        If the goal is the cost, which has the cost of robots in it, it is that of the others, which
        have no price.
        """
        scenario = self.settings[i].scenario
        without_price = scenario.chargers + scenario.bays + (scenario.load_out.trailers.count or 0)
        if self.goal == "cost_per_bin":
            return without_price
        return self.settings[i].robots + without_price

    def has_limit(self, i: int) -> bool:
        """Whether no run of a setting can exceed its limit without traffic.

        That is so of the long run, with built-in classes.
        """
        scenario = self.settings[i].scenario
        is_harvest = self.options.horizon == "harvest"
        # One harvest begins with full batteries, and may be faster than the long run.
        has_head_start = is_harvest and scenario.has_batteries
        # A faster harvest may cost more: its last day is shorter, and costs as much.
        has_least_pay = scenario.prices.picker_least_per_day is not None
        may_cost_more = self.goal == "cost_per_bin" and is_harvest and has_least_pay
        return not (has_head_start or may_cost_more or scenario.own_classes)

    def add_numbers(self, best: Sequence[int]) -> bool:
        """Add numbers of carriers that an open study must try too. Return whether there are any.

        `best`: the best settings so far, one for each combination of circumstances.
        """
        tried = self.varied[CARRIERS]
        wanted = set[int]()
        for i in best:
            best_number = self.settings[i].scenario.carrier_count
            wanted.update(more_numbers(tried, best_number, self.most_carriers))
        more = sorted(wanted)
        if more:
            added, _ = settings_of(self.scenario, self.varied | {CARRIERS: more})
            self.settings += added
        self.varied[CARRIERS] = sorted([*tried, *more])
        return bool(more)

    def beyond(self, best: Sequence[int]) -> dict[str, Any]:
        """Return values beyond the ranges that were tried, and may be better: key -> value.

        That is the next value of each choice of which a setting of `best` has the last one. Values
        that the scenario cannot have are left out.
        """
        values_beyond = dict[str, Any]()
        if not self.has_choices:
            return values_beyond
        choices = [key for key in self.varied if key not in self.circumstances]
        for i in best:
            values = self.settings[i].values
            for key in choices:
                following = number_beyond(self.varied[key], values[key])
                if following is None:
                    continue
                if is_possible(self.scenario, values | {key: following}):
                    values_beyond.setdefault(key, following)
        return values_beyond


def _usual_goal(settings: Sequence[Setting]) -> Goal:
    """Return the goal of a study for which the user has given none."""
    if have_prices(settings):
        return "cost_per_bin"
    return "bins_per_hour"
