"""What a user has changed since a study was asked: its answer is that of another question."""

from collections.abc import Collection

from orchard.app.also_compared import COMPARED_LABEL
from orchard.app.entries import flat, label_of
from orchard.app.page_words import DEADLINE_LABEL
from orchard.app.study_run import HORIZON_LABEL, StudySettings
from orchard.field.scenario import Scenario

# Labels that are named; the rest are counted.
MOST_NAMED = 4
# Field of the settings -> its label. The time that a study may take changes no question.
LABELS = {
    "deadline": DEADLINE_LABEL,
    "deadline_unit": DEADLINE_LABEL,
    "compared": COMPARED_LABEL,
    "compared_values": COMPARED_LABEL,
    "dispatch": "Dispatch policies",
    "route": "Routes",
    "horizon": HORIZON_LABEL,
}


def changed_values(asked: Scenario, now: Scenario, varied: Collection[str]) -> list[str]:
    """Return the labels of the values that are not as they were asked.

    `varied`: the paths of what the study varies, whose values in the form do not matter.
    """
    values_asked = flat(asked)
    labels = []
    for path, value in flat(now).items():
        if path not in varied and value != values_asked[path]:
            labels.append(label_of(path))
    return labels


def changed_settings(asked: StudySettings, now: StudySettings) -> list[str]:
    """Return the labels of the settings of a study that are not as they were asked."""
    labels = []
    for field, label in LABELS.items():
        if getattr(asked, field) != getattr(now, field) and label not in labels:
            labels.append(label)
    return labels


def changed_words(labels: list[str]) -> str:
    """Return the sentence that says what has changed; '' if nothing has.

    >>> changed_words(["Rows", "Yield"])
    'Changed since this was asked: Rows, Yield. Ask again for what is entered now.'
    """
    if not labels:
        return ""
    named = ", ".join(labels[:MOST_NAMED])
    more = len(labels) - MOST_NAMED
    if more > 0:
        named += f" and {more} more"
    return f"Changed since this was asked: {named}. Ask again for what is entered now."
