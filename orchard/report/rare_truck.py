"""A note for a user whose scenario has a truck that first comes after the harvest's end.

The truck brings empty bins to the bay (`load_out.truck`), and the bay begins with some
(`load_out.empty_bins`).
"""

from functools import lru_cache

from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.report.losses import seconds_without_waits
from orchard.report.summary import clock


@lru_cache(maxsize=KEPT_LAYOUTS)
def notes_on_truck(layout: Layout) -> tuple[str, ...]:
    """Return a note if the harvest would be over before the first truck comes; else nothing.

    The note says what follows: the empty bins at the bay suffice, so that no truck is needed, or
    carriers wait in the bay for the truck.
    """
    load_out = layout.scenario.load_out
    every = load_out.truck.every
    if every is None or load_out.empty_bins is None:
        return ()
    seconds = seconds_without_waits(layout)
    if every < seconds:
        return ()
    bins = layout.bins
    note = (
        f"load_out.truck.every = {every:g}: the first truck comes at {clock(every)}, and without"
        f" waits this harvest is over at about {clock(seconds)}"
    )
    if load_out.empty_bins >= bins:
        return (
            f"{note}; {load_out.empty_bins} empty bins suffice for its {bins}, so none is needed",
        )
    return (
        f"{note}; {load_out.empty_bins} empty bins do not suffice for its {bins}, so carriers wait"
        f" in the bay: expected every below {seconds:.0f}, or {bins} empty_bins",
    )
