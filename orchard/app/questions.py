"""What can be asked on the page. Of each kind of question one study goes on at a time."""

from pathlib import Path

from orchard.app.farm_run import Farms
from orchard.app.sensitivity_run import Sensitivities
from orchard.app.study_run import Studies


class Questions:
    """The studies that all pages share: of how many, of what it hangs on, and of farms."""

    def __init__(self, folder: Path) -> None:
        """`folder`: of their files."""
        self.fleets = Studies(folder, "study")
        self.sensitivities = Sensitivities(folder, "study")
        self.farms = Farms(folder, "study")

    def close(self) -> None:
        """Stop what goes on, and wait for its end."""
        self.fleets.close()
        self.sensitivities.close()
        self.farms.close()
