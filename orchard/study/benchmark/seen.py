"""What a policy of the benchmark sees of an orchard: what its robots could report, and no draws.

The policy's process gets an orchard in which nothing is random: each row is picked at the mean
speed, no robot fails, and there are no people, animals and weeds. So it cannot find the hidden
values anywhere. If a policy reads a hidden key, it gets an error that names the key
(HiddenFromPolicy).
"""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import orchard
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.field.scenario.sections import SPREADS, Carrying, Picking

# The keys of a scenario that say what the seed draws. They have their defaults, or none, in what a
# policy's process gets.
NOTHING_DRAWN: dict[str, Any] = {
    "seed": 0,
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "picking": {
        **{key: {"distribution": "none"} for key in SPREADS},
        "failure": {"mean_between": None},
    },
    "carrying": {"failure": {"mean_between": None}},
}
_PACKAGE = f"{Path(orchard.__file__).parent}{os.sep}"


class HiddenFromPolicy(Exception):
    """Raised where a policy asks for what the seed decides.

    It is no AttributeError: `hasattr`, and `getattr` with a default, would catch that in silence.
    """


class _Hiding:
    """A section of a scenario of which a policy cannot read some keys. The code of orchard can.

    `hidden`: these keys. `place`: where the section is, as a policy finds it.
    """

    hidden: ClassVar[frozenset[str]] = frozenset()
    place: ClassVar[str] = ""

    def __getattribute__(self, name: str) -> Any:
        """Return an attribute. Raises HiddenFromPolicy if a key is hidden, and the file of the code
        that reads it is not of this package.
        """
        cls = type(self)
        if name in cls.hidden and not sys._getframe(1).f_code.co_filename.startswith(_PACKAGE):
            raise HiddenFromPolicy(
                f"{cls.place}.{name} is hidden from a policy of the benchmark, which sees what"
                " robots report, and the means of what the seed draws"
            )
        return super().__getattribute__(name)


class _SeenPicking(_Hiding, Picking):
    hidden: ClassVar[frozenset[str]] = frozenset({*SPREADS, "failure"})
    place: ClassVar[str] = "layout.scenario.picking"


class _SeenCarrying(_Hiding, Carrying):
    hidden: ClassVar[frozenset[str]] = frozenset({"failure"})
    place: ClassVar[str] = "layout.scenario.carrying"


class _SeenScenario(_Hiding, Scenario):
    hidden: ClassVar[frozenset[str]] = frozenset({"seed", "people", "animals", "weeds"})
    place: ClassVar[str] = "layout.scenario"


def nothing_drawn(scenario: Scenario) -> Scenario:
    """Return the scenario that a policy's process gets: without all that the seed draws."""
    return with_changes(scenario, **NOTHING_DRAWN)


def layout_seen(scenario: Scenario) -> Layout:
    """Return the layout that a policy sees. `scenario`: as `nothing_drawn` returns it.

    To read a hidden key of the layout's scenario raises HiddenFromPolicy.
    """
    layout = lay_out(scenario)
    values = {name: getattr(layout.scenario, name) for name in Scenario.model_fields}
    values["picking"] = _SeenPicking.model_construct(**vars(scenario.picking))
    values["carrying"] = _SeenCarrying.model_construct(**vars(scenario.carrying))
    return replace(layout, scenario=_SeenScenario.model_construct(**values))
