"""The bay of the event model: which bins it takes before another one.

Carriers come from the east, and stand in the bay at places that are 4.1 m apart: the first place is
the one with the greatest x. `bins_before` is called with what it reads of the machine, and no more.
"""

from types import SimpleNamespace

from orchard.event_model import codes as c
from orchard.event_model.kernel.bay import bins_before
from orchard.event_model.plain import as_python

# What each carrier does now.
UNLOADS = SimpleNamespace(kind=c.UNLOAD)


def in_bay(x: float, is_taken: bool) -> SimpleNamespace:
    """Return a carrier that stands in the bay at x, m, with a full bin.

    `is_taken`: whether the bay has begun to unload it.
    """
    return SimpleNamespace(state=c.LASTING, op=0, x=x, is_taken=is_taken)


def before_the_last(*robots: SimpleNamespace) -> int:
    """Return how many bins the bay takes before that of the last carrier."""
    machine = SimpleNamespace(robots=robots, ops=[UNLOADS])
    return int(as_python(bins_before)(machine, len(robots) - 1))


def test_a_bin_waits_for_those_further_on_in_the_bay() -> None:
    assert before_the_last(in_bay(-20.0, False), in_bay(-24.1, False)) == 1
    assert before_the_last(in_bay(-24.1, False), in_bay(-20.0, False)) == 0


def test_a_bin_waits_for_one_behind_that_is_begun() -> None:
    """A person may have stopped a carrier at the second place while the first place was free."""
    assert before_the_last(in_bay(-24.1, True), in_bay(-20.0, False)) == 1
