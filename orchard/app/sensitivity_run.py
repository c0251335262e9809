"""What the result hangs on, asked from the page: what is moved, and the command that does it."""

import re
import sys
from dataclasses import dataclass

import msgspec

from orchard.app.command import Files, Latest, PageCommand
from orchard.app.entries import MEASURES, entries, label_of
from orchard.app.page_words import BUDGET_LABEL, with_labels
from orchard.app.study_run import (
    BUDGET,
    HORIZON_LABEL,
    NO_FIRST_HOUR,
)
from orchard.app.typed_numbers import meanings_of, number_of, number_problem, shown, with_point
from orchard.field.scenario import Scenario
from orchard.study.result import Horizon
from orchard.study.sensitivity.factors import MOST_FACTORS, SAY_RANGE, factors_of
from orchard.study.sensitivity.result import SensitivityResult

MOVED_LABEL = "What is moved"
FAR_LABEL = "How far"
RANGE = re.compile(r"(.+?) *(?:-|\u2013|\.\.| to ) *(.+)")
SHARE_OR_RANGE = (
    "must be a share such as 20 %, or from where to where, such as 1.2-1.8; leave it empty for the"
    " usual shares"
)
FOR_ONE = "from where to where is of one value: choose one, or enter a share such as 20 %"
NOTHING_CHOSEN = f"choose under “{MOVED_LABEL}” which value is moved so far"
TOO_MANY = f"must be at most {MOST_FACTORS} values"
# In place of the words for the command line.
SAY_FROM_TO = f"enter under “{FAR_LABEL}” from where to where, such as 1.2-1.8"


@dataclass(frozen=True)
class SensitivitySettings:
    """What is moved, and how far, as a user entered it.

    `moved`: paths; without any, the usual ones. `far`: a share, or a range if one value is moved;
    '' for the usual shares. `budget`: s of wall time.
    """

    moved: tuple[str, ...] = ()
    far: str = ""
    horizon: Horizon = "harvest"
    budget: str = "300"

    @property
    def problem(self) -> str:
        """What is wrong, by the field's label; '' if nothing is."""
        problem = number_problem(self.budget, BUDGET)
        if problem:
            return f"{BUDGET_LABEL}: {problem}"
        if len(self.moved) > MOST_FACTORS:
            return f"{MOVED_LABEL}: {TOO_MANY}"
        problem = self._problem_of_far()
        if problem:
            return f"{FAR_LABEL}: {problem}"
        return ""

    def problem_with(self, scenario: Scenario) -> str:
        """Return what is wrong, by itself or with the scenario that is asked; '' if nothing is."""
        if self.problem:
            return self.problem
        if self.horizon == "long" and scenario.picker_absences:
            return f"{HORIZON_LABEL}: {NO_FIRST_HOUR}"
        _, problems = factors_of(scenario, self.moves)
        for problem in problems:
            text = problem.text.replace(SAY_RANGE, SAY_FROM_TO)
            return f"{MOVED_LABEL}: {label_of(problem.path)}: {text}"
        return ""

    @property
    def moves(self) -> list[str]:
        """What is moved, as the command takes it: picking_rate=1.2..1.8, carriers=20%."""
        far = _far_of(self.far)
        if not far:
            return list(self.moved)
        return [f"{path}={far}" for path in self.moved]

    def _problem_of_far(self) -> str:
        far = _far_of(self.far)
        if far is None:
            meanings = []
            for part in re.split(r"[-\u2013 %]+", self.far):
                meanings += meanings_of(part)
            if meanings:
                return f"{SHARE_OR_RANGE}; write {' or '.join(meanings)}"
            return SHARE_OR_RANGE
        if far and not self.moved:
            return NOTHING_CHOSEN
        if ".." in far and len(self.moved) > 1:
            return FOR_ONE
        return ""


def movable() -> dict[str, str]:
    """Return the values that can be moved: path -> label, in the order of the file.

    A share of the spacing of rows is none of the width between them, so it is left out.
    """
    labels = {}
    for path, entry in entries().items():
        is_number = entry.kind in (int, float)
        if is_number and path != "seed" and path not in MEASURES:
            labels[path] = entry.label
    return labels


def _far_of(text: str) -> str | None:
    """Return a share or a range as the command takes it; '' for no text, None for all else.

    >>> _far_of("20 %"), _far_of("1,2-1,8"), _far_of("far")
    ('20%', '1.2..1.8', None)
    """
    text = text.strip()
    if not text:
        return ""
    if text.endswith("%"):
        share = number_of(text.removesuffix("%"))
        if isinstance(share, str) or not 0.0 < share < 100.0:
            return None
        return f"{shown(share)}%"
    match = RANGE.fullmatch(text)
    if match is None:
        return None
    low = number_of(match[1])
    high = number_of(match[2])
    if isinstance(low, str) or isinstance(high, str):
        return None
    return f"{shown(low)}..{shown(high)}"


def sensitivity_command(settings: SensitivitySettings, files: Files) -> list[str]:
    """Return the command that a user would type for a sensitivity."""
    line = [sys.executable, "-u", "-P", "-m", "orchard", "study", str(files.scenario)]
    line += ["--sensitivity"]
    for move in settings.moves:
        line += ["--vary", move]
    line += ["--horizon", settings.horizon]
    line += ["--budget", f"{with_point(settings.budget)}s"]
    line += ["--progress", "json", "--summary", str(files.summary)]
    return line


class SensitivityRun(PageCommand):
    """One sensitivity. `share`: of its runs that are done. `result`: None before its end."""

    def __init__(self, scenario: Scenario, settings: SensitivitySettings, files: Files) -> None:
        """Start it. Raises OSError."""
        self.settings = settings
        self.share = 0.0
        self.result: SensitivityResult | None = None
        super().__init__(scenario, files, sensitivity_command(settings, files))

    def message_of(self, line: str) -> str | None:
        """Take the share of the runs that are done. Return any line for a person."""
        if line.startswith('{"sensitivity"'):
            # The summary has the same.
            return None
        try:
            self.share = msgspec.json.decode(line, type=dict[str, float])["runs_done"]
        except (ValueError, KeyError, RecursionError):
            return super().message_of(line)
        self.has_begun = True
        return None

    def finish(self) -> None:
        """Read the answer, in the words of the page."""
        result = self.read(self.files.summary, SensitivityResult)
        if result is not None:
            self.result = with_labels(result)

    @property
    def is_complete(self) -> bool:
        """Whether there is an answer, and the runs were not stopped before it."""
        return self.result is not None and not self.asked_to_stop


Sensitivities = Latest[SensitivityRun]
