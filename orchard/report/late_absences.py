"""A note on pickers that leave (`picker_absences` of the scenario) after the harvest's end."""

from functools import lru_cache

from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.report.losses import seconds_without_waits
from orchard.report.summary import clock


@lru_cache(maxsize=KEPT_LAYOUTS)
def notes_on_absences(layout: Layout) -> tuple[str, ...]:
    """Return a note for each picker of which an absence begins when the harvest, if no robot waits
    in it, is over.
    """
    absences = layout.scenario.picker_absences
    if not absences:
        return ()
    seconds = seconds_without_waits(layout)
    notes = []
    for name, intervals in absences.items():
        late = [begin for begin, _ in intervals if 3600.0 * begin >= seconds]
        if late:
            notes.append(
                f"picker_absences.{name}: it leaves after {late[0]:g} h of work, and without waits"
                f" this harvest is over at about {clock(seconds)}, so that may change nothing"
            )
    return tuple(notes)
