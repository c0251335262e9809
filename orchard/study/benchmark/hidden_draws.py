"""Draws the orchards of the hidden split.

An orchard in which all early policies (those that send carriers before bins are full) do the same
harvest would tell nothing of a policy. So such an orchard is drawn again.
"""

from collections.abc import Callable, Container
from typing import Any

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, check, with_changes
from orchard.study.benchmark.bounds import seeds_of
from orchard.study.benchmark.families import FAMILIES, name_of, scenario_of

# The early policies, which are the good ones.
EARLY = ("rolling", "predictive", "predictive-farthest")
# Draws of an orchard, at most. None of eight secrets that were tried needed more than two.
MOST_DRAWS = 20


def hidden_scenarios(
    secret: bytes, wanted: Container[str], tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Return the scenarios of the hidden split that are wanted, by name, each with its first seed.

    An orchard in which all early policies do the same is drawn again; `tell` gets a sentence about
    it. Harvests of the event model decide that. So another version of this program may draw another
    orchard from the same secret.
    """
    drawn = {}
    for family in FAMILIES:
        name = name_of(family, "hidden")
        if name in wanted:
            drawn[name] = _first_that_separates(family, secret, tell)
    return drawn


def separates_policies(scenario: Scenario) -> bool:
    """Whether early policies take different times in an orchard, with at least one of its seeds."""
    for seed in seeds_of(scenario):
        times = set()
        for policy in EARLY:
            seeded = lay_out(with_changes(scenario, seed=seed, dispatch=policy))
            times.add(round(DiscreteHarvest(seeded).run().seconds, 1))
        if len(times) > 1:
            return True
    return False


def _first_that_separates(
    family: str, secret: bytes, tell: Callable[[str], None]
) -> dict[str, Any]:
    """Return the first draw of a family that separates policies; the last one if none does."""
    name = name_of(family, "hidden")
    for again in range(MOST_DRAWS):
        values = scenario_of(family, "hidden", secret, again)
        if separates_policies(check(values, name)):
            if again > 0:
                tell(
                    f"{name}: all early policies did the same in the orchard that the secret draws"
                    f" first, so it was drawn again, {again} times."
                )
            return values
    tell(f"{name}: all early policies do the same in each of its {MOST_DRAWS} draws.")
    return values
