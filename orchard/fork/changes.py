"""What of a scenario may change while a run goes on, and why the rest may not."""

from collections.abc import Mapping
from functools import reduce
from operator import getitem
from typing import Any

from orchard.field.layout import Layout, lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import with_changes

_GROUND = "the orchard, its roads and what fills a bin stay as they are while a run goes on"
_ROWS = "which picker picks which rows is settled when a run begins; a picker can be stopped"
_COURSES = "robots are on courses that were made for it"
_OF_THE_GROUND = (
    "rows",
    "row_length",
    "row_width",
    "survey",
    "bay",
    "bays",
    "route",
    "metres_per_bin",
    "bins_per_row",
    "crop",
)
_OF_THE_ROWS = ("pickers", "picker_absences", "rows_to_pickers", "order_in_row")
# What cannot change under way -> why.
FIXED: Mapping[str, str] = {
    **dict.fromkeys(_OF_THE_GROUND, _GROUND),
    **dict.fromkeys(_OF_THE_ROWS, _ROWS),
    "sensors": _COURSES,
    "load_out.trailers": "bins stand on the trailers that there are",
    "load_out.empty_bins": "all these bins are at the bay, or on trailers from there",
}
# What may have another value under way, but cannot become null, nor get a value if it was null.
NULL_OR_NOT = (
    "picking.failure.mean_between",
    "carrying.failure.mean_between",
    "carrying.battery.hours",
    "load_out.metres",
    "load_out.speed",
    "load_out.seconds_away",
)


class NotNow(ScenarioError):
    """A change that cannot be at this moment, and may be at another one.

    What it adds has no place, or what it takes away is at work.
    """


def changed_layout(before: Layout, changes: Mapping[str, Any]) -> Layout:
    """Return the layout with some values changed. Raises ScenarioError for what cannot change."""
    old = before.scenario
    scenario = with_changes(old, **changes)
    # The queue stays at least as long as before: carriers are on their way to it.
    if scenario.queue_carriers < old.queue_carriers:
        scenario = with_changes(scenario, queue_room=old.queue_carriers)
    layout = lay_out(scenario)
    _check_changes(before, layout)
    return layout


def problem(why: str, path: str = "", value: object = "") -> Problem:
    """Return a problem of the changes, for a ScenarioError. `path`: of the value at fault."""
    return Problem("changes", why, path, str(value))


def _check_changes(before: Layout, after: Layout) -> None:
    """Raise ScenarioError if the scenarios differ in what cannot change under way."""
    old_values = before.scenario.model_dump()
    new_values = after.scenario.model_dump()
    # Path of a value that cannot change -> why.
    reasons = {
        path: why
        for path, why in FIXED.items()
        if _value_at(old_values, path) != _value_at(new_values, path)
    }
    for path in NULL_OR_NOT:
        was_null = _value_at(old_values, path) is None
        is_null = _value_at(new_values, path) is None
        if was_null != is_null:
            reasons[path] = _COURSES
    # Other lines of the queue may follow from one of these values: that has its reason already.
    if not reasons and _queue_lines(before) != _queue_lines(after):
        reasons = _too_many_carriers(before, after)
    problems = []
    for path, why in reasons.items():
        value = _value_at(new_values, path)
        problems.append(problem(f"cannot change under way: {why}", path, value))
    if problems:
        raise ScenarioError(problems)


def _too_many_carriers(before: Layout, after: Layout) -> dict[str, str]:
    """Return why the queue cannot grow so much, by the key that asks for it."""
    most = before.scenario.queue_carriers
    for count in range(most + 1, after.scenario.queue_carriers):
        larger = lay_out(with_changes(after.scenario, carriers=count, queue_room=None))
        if _queue_lines(larger) == _queue_lines(before):
            most = count
    is_by_carriers = after.scenario.queue_carriers == after.scenario.carrier_count
    if is_by_carriers:
        key = "carriers"
    else:
        key = "queue_room"
    why = (
        "the lines of the queue would be others, "
        "and carriers are on their way to those that there are"
    )
    return {key: f"{why}; expected at most {most}"}


def _queue_lines(layout: Layout) -> tuple[Any, ...]:
    """Return what says in which line of the queue each carrier waits: two layouts for which it is
    equal have the same lines.

    A single line may become longer, so the number of its places is left out.
    """
    queue = layout.queue
    places = 0
    if len(queue.lines) > 1:
        places = queue.places
    return queue.lines, layout.first_charging, places


def _value_at(values: Mapping[str, Any], path: str) -> Any:
    """Return the value at a dotted path."""
    return reduce(getitem, path.split("."), values)
