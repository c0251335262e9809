"""A farm, asked from the page: its blocks, and the command `orchard study` that does it."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from orchard.app.command import Files, Latest, PageCommand
from orchard.app.page_words import BUDGET_LABEL
from orchard.app.study_run import BUDGET
from orchard.app.typed_numbers import number_of, number_problem, with_point
from orchard.field.scenario import Scenario, to_yaml
from orchard.study.farm import FarmResult
from orchard.study.farm_file import BLOCKS, MOST_BLOCKS, MOST_MINUTES, TRANSFER, read_farm
from orchard.study.result import StudyResult
from orchard.study.settings import CARRIERS

BLOCKS_LABEL = "Blocks"
NAME_LABEL = "Name of the block"
TRANSFER_LABEL = "To the next block, min"
TOO_FEW = "enter at least two: set the form to the rows of a block, name it, and add it"
LONGEST_NAME = 40


@dataclass(frozen=True)
class AddedBlock:
    """A block of a farm, as a user has added it."""

    name: str
    scenario: Scenario


@dataclass(frozen=True)
class FarmSettings:
    """A farm as a user entered it: blocks in their order, minutes from one to the next, and s of
    wall time.
    """

    blocks: tuple[AddedBlock, ...] = ()
    transfer: str = "20"
    budget: str = "300"

    @property
    def problem(self) -> str:
        """What is wrong, by the field's label; '' if nothing is."""
        problem = number_problem(self.budget, BUDGET)
        if problem:
            return f"{BUDGET_LABEL}: {problem}"
        problem = number_problem(self.transfer, (0, MOST_MINUTES))
        if problem:
            return f"{TRANSFER_LABEL}: {problem}"
        return ""

    def problem_of_name(self, name: str) -> str:
        """Return what is wrong with the name of one more block; '' if nothing is."""
        if not name or not name.isprintable() or len(name) > LONGEST_NAME:
            return f"{NAME_LABEL}: must be a text of 1 to {LONGEST_NAME} characters"
        if any(block.name == name for block in self.blocks):
            return f"{NAME_LABEL}: {name} is added already; each block needs its own name"
        if len(self.blocks) >= MOST_BLOCKS:
            return f"{BLOCKS_LABEL}: must be at most {MOST_BLOCKS}"
        return ""


def farm_file(files: Files) -> Path:
    """Return the file that lists the blocks."""
    return files.folder / f"{files.name}.farm.yaml"


def block_file(files: Files, number: int) -> Path:
    """Return the file of a block. `number`: from 0."""
    return files.folder / f"{files.name}.block-{number + 1}.yaml"


def write_farm(settings: FarmSettings, pickers: int, files: Files) -> None:
    """Write the files of a farm. `pickers`: that go from block to block. Raises OSError."""
    listed = []
    for number, block in enumerate(settings.blocks):
        file = block_file(files, number)
        file.write_text(to_yaml(block.scenario))
        listed.append({"file": file.name, "name": block.name})
    farm = {
        BLOCKS: listed,
        TRANSFER: number_of(settings.transfer),
        "pickers": pickers,
    }
    # JSON is YAML, too, but for its escapes: those of 🥝 would be two characters, and no text.
    text = json.dumps(farm, indent=2, ensure_ascii=False)
    farm_file(files).write_text(text, encoding="utf-8")


def farm_command(settings: FarmSettings, files: Files) -> list[str]:
    """Return the command that a user would type for a farm."""
    line = [sys.executable, "-u", "-P", "-m", "orchard", "study", str(farm_file(files))]
    line += ["--vary", CARRIERS]
    line += ["--budget", f"{with_point(settings.budget)}s"]
    line += ["--progress", "json", "--summary", str(files.summary)]
    return line


class FarmRun(PageCommand):
    """The study of one farm. `pickers`: that go from block to block."""

    def __init__(self, settings: FarmSettings, pickers: int, files: Files) -> None:
        """Start it. Raises ScenarioError if the blocks cannot be one farm, or OSError."""
        self.settings = settings
        self.pickers = pickers
        self.result: FarmResult | None = None
        # The block that is studied, and how many settings of it are known.
        self.now = ""
        self.setting_count = 0
        write_farm(settings, pickers, files)
        read_farm(farm_file(files), [CARRIERS])
        super().__init__(settings.blocks[0].scenario, files, farm_command(settings, files))

    def message_of(self, line: str) -> str | None:
        """Take how far the study is. Return any line for a person."""
        try:
            known = msgspec.json.decode(line, type=dict[str, Any])
        except (ValueError, RecursionError):
            return super().message_of(line)
        if "block" in known:
            partial = msgspec.convert(known["study"], type=StudyResult)
            self.now = known["block"]
            self.setting_count = len(partial.table)
            self.has_begun = True
        # The summary has all else.
        return None

    def finish(self) -> None:
        """Read the answer."""
        self.result = self.read(self.files.summary, FarmResult)

    @property
    def is_complete(self) -> bool:
        """Whether there is an answer, and the study was not stopped before it."""
        return self.result is not None and not self.asked_to_stop

    @property
    def share(self) -> float:
        """The share of the blocks that are done."""
        names = [block.name for block in self.settings.blocks]
        if self.now not in names:
            return 0.0
        return names.index(self.now) / len(names)


Farms = Latest[FarmRun]
