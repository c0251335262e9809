"""What each browser has set. The server keeps it, so that a reload of the page shows it again."""

from dataclasses import dataclass, field
from functools import lru_cache

from orchard.app.draft import Draft
from orchard.app.harvest_run import RunSettings
from orchard.app.study_run import StudySettings
from orchard.field.scenario import Scenario

MOST = 200  # browsers


@dataclass
class Desk:
    """The settings of one browser, on all its pages."""

    draft: Draft = field(default_factory=lambda: Draft(Scenario()))
    settings: RunSettings = field(default_factory=RunSettings)
    study: StudySettings = field(default_factory=StudySettings)
    dark: bool | None = None  # None: as the browser prefers


@lru_cache(MOST)
def desk_of(browser: str) -> Desk:
    """Return the desk of a browser. Beyond MOST, the one that has been away longest is dropped."""
    return Desk()
