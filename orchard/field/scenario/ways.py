"""The ways to say one thing: keys of which each says what others would say.

For example, `picking_rate` says how fast pickers pick, and so does `picking_speed`. A scenario uses
at most one way; `orchard/field/scenario/rules.py` checks that.
"""

from functools import reduce
from typing import Any

from orchard.field.problems import Section

# The keys of the way to say by a crop how much of a row fills a bin. They are set together.
CROP = ("crop.tonnes_per_hectare", "crop.kilograms_per_bin")
# Each line has the ways to say one thing. A way is a tuple of the keys that it needs.
WAYS: tuple[tuple[tuple[str, ...], ...], ...] = (
    (("picking_speed",), ("picking_rate",)),
    (("metres_per_bin",), ("bins_per_row",), CROP),
    (("load_out.metres", "load_out.speed", "load_out.seconds"), ("load_out.seconds_away",)),
)


def value_at(section: Section, path: str) -> Any:
    """Return the value at a dotted path in a section, such as "crop.kilograms_per_bin"."""
    return reduce(getattr, path.split("."), section)


def other_ways(path: str) -> list[str]:
    """Return the keys of all other ways to say what a key says; none if there is one way only.

    `path`: the key, dotted.

    >>> other_ways("bins_per_row")
    ['metres_per_bin', 'crop.tonnes_per_hectare', 'crop.kilograms_per_bin']
    """
    others = []
    for ways in WAYS:
        if any(path in way for way in ways):
            others += [key for way in ways if path not in way for key in way]
    return others
