"""What each browser has set. The server keeps it, so that a reload of the page shows it again."""

from collections import OrderedDict
from dataclasses import dataclass, field

from orchard.app.draft import Draft
from orchard.app.farm_run import FarmSettings
from orchard.app.harvest_run import RunSettings
from orchard.app.replaced import Replaced
from orchard.app.sensitivity_run import SensitivitySettings
from orchard.app.study_run import StudySettings
from orchard.field.scenario import Scenario

# Browsers that have their settings kept.
MOST = 200


@dataclass
class Desk:
    """The settings of one browser, on all its pages."""

    draft: Draft = field(default_factory=lambda: Draft(Scenario()))
    settings: RunSettings = field(default_factory=RunSettings)
    study: StudySettings = field(default_factory=StudySettings)
    sensitivity: SensitivitySettings = field(default_factory=SensitivitySettings)
    farm: FarmSettings = field(default_factory=FarmSettings)
    #: What was entered before presets, files and links replaced it.
    replaced: Replaced = field(default_factory=Replaced)
    #: None: as the browser prefers.
    dark: bool | None = None


class Desks:
    """The desks of the browsers that have shown the page, at most MOST.

    A request alone leaves nothing here: a page of another site can make requests without end.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[str, Desk] = OrderedDict()

    def of(self, browser: str) -> Desk:
        """Return the desk of a browser.

        One that was never shown gets a new desk, which is not kept.
        """
        return self._kept.get(browser) or Desk()

    def keep(self, browser: str, desk: Desk) -> None:
        """Keep the desk of a browser that shows the page.

        Beyond MOST, the desk whose browser has not shown the page for longest is dropped.
        """
        self._kept.setdefault(browser, desk)
        self._kept.move_to_end(browser)
        if len(self._kept) > MOST:
            self._kept.popitem(last=False)
