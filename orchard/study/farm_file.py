"""A farm: blocks, each a scenario of its own, that one fleet harvests one after another.

The file lists them:

    blocks:
    - {file: top.yaml}
    - {file: low.yaml, name: Low}
    transfer_minutes: 20
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchard.field.problems import Lines, Problem, ScenarioError, key_text, printable, show
from orchard.field.scenario import Scenario, load, with_changes
from orchard.field.yaml_file import read, values_of
from orchard.folders import real
from orchard.report.limits import with_seed

BLOCKS = "blocks"
TRANSFER = "transfer_minutes"
# Keys that the farm's file may give for all blocks. Otherwise the blocks must have the same values.
FLEET = ("pickers", "carriers")
# Sections of the blocks' scenarios that must be the same, because the same machines work in all.
MACHINES = ("carrying", "handling")
MOST_BLOCKS = 50
# Minutes of a transfer, at most: a day.
MOST_MINUTES = 1440.0
# The first seeds of two blocks differ by so much, so that no two blocks have a run of the same
# seed.
SEEDS_OF_A_BLOCK = 1_000_000
EXAMPLE = "such as {file: top.yaml}"


@dataclass(frozen=True)
class FarmBlock:
    """A block of a farm."""

    name: str
    file: str
    scenario: Scenario


@dataclass(frozen=True)
class Farm:
    """Blocks in the order in which they are harvested, and the time from one to the next."""

    blocks: tuple[FarmBlock, ...]
    transfer_seconds: float

    @property
    def all_transfers(self) -> float:
        """The time of all transfers, s."""
        return self.transfer_seconds * (len(self.blocks) - 1)


def is_farm(path: Path | None) -> bool:
    """Whether a file is that of a farm, because it lists blocks.

    A file that cannot be read is none here. It is reported where it is read as a scenario.
    """
    if path is None or not path.is_file():
        return False
    try:
        values, _, _ = values_of(read(path, str(path)), str(path))
    except ScenarioError:
        return False
    return isinstance(values, dict) and BLOCKS in values


def read_farm(path: Path, varied: Sequence[str] = ()) -> Farm:
    """Return the farm of a file.

    `varied`: keys that a study varies; in these the blocks may differ. Raises ScenarioError with
    all that is wrong.
    """
    return _Reader(path, varied).farm()


class _Reader:
    """Reads the file of a farm, and gathers what is wrong."""

    def __init__(self, path: Path, varied: Sequence[str]) -> None:
        self._path = path
        self._varied = varied
        self._source = key_text(str(path))
        values, lines, repeated = values_of(read(path, self._source), self._source)
        self._values: dict[str, Any] = {}
        if isinstance(values, dict):
            self._values = values
        self._lines: Lines = lines
        self._problems: list[Problem] = list(repeated)
        # File of a block, and name of a block -> its entry in the list, as "blocks.0".
        self._entry_of_file: dict[Path, str] = {}
        self._entry_of_name: dict[str, str] = {}

    def farm(self) -> Farm:
        """Return the farm. Raises ScenarioError."""
        known = (BLOCKS, TRANSFER, *FLEET)
        for key in self._values:
            if key not in known:
                text = f"unknown key; a farm has {', '.join(known)}"
                self._add(text, (str(key),), show(self._values[key]))
        transfer = self._transfer()
        blocks = self._blocks()
        if not self._problems:
            self._problems += self._disagreements(blocks)
        if self._problems:
            raise ScenarioError(self._problems)
        return Farm(tuple(blocks), transfer)

    def _add(self, text: str, path: tuple[str, ...], value: str = "") -> None:
        """Note a problem. `path`: in the file, as ("blocks", "0", "file")."""
        line = self._lines.get(path, 0)
        self._problems.append(Problem(self._source, text, ".".join(path), value, line))

    def _transfer(self) -> float:
        """Return the time from one block to the next, s."""
        wanted = f"minutes in which the fleet moves to the next block, 0 to {MOST_MINUTES:g}"
        if TRANSFER not in self._values:
            self._add(f"is missing: {wanted}", (TRANSFER,))
            return 0.0
        minutes: Any = self._values[TRANSFER]
        is_number = isinstance(minutes, int | float) and not isinstance(minutes, bool)
        if not is_number or not 0.0 <= minutes <= MOST_MINUTES:
            self._add(f"must be {wanted}", (TRANSFER,), show(minutes))
            return 0.0
        return 60.0 * float(minutes)

    def _blocks(self) -> list[FarmBlock]:
        """Return the blocks that can be used."""
        blocks = []
        for number, entry in enumerate(self._listed()):
            block = self._block(number, entry)
            if block is not None:
                blocks.append(block)
        return blocks

    def _listed(self) -> list[Any]:
        """Return the entries of the list of blocks; [] if it is no list, or not of so many."""
        listed = self._values.get(BLOCKS)
        if isinstance(listed, list) and 2 <= len(listed) <= MOST_BLOCKS:
            return listed
        text = (
            f"must be a list of 2 to {MOST_BLOCKS} blocks, {EXAMPLE}; study one block by its own"
            " file: orchard study top.yaml"
        )
        shown = show(listed)
        if isinstance(listed, list):
            shown = f"{len(listed)} blocks"
        self._add(text, (BLOCKS,), shown)
        return []

    def _block(self, number: int, entry: Any) -> FarmBlock | None:
        """Return the block of an entry of the list; None if it cannot be used.

        `number`: of the entry, from 0.
        """
        at = (BLOCKS, str(number))
        file = self._file(entry, at)
        if file is None:
            return None
        place = real(self._path.parent / file)
        if place in self._entry_of_file:
            same = self._entry_of_file[place]
            text = f"is listed twice, also as {same}; a block is harvested once"
            self._add(text, (*at, "file"), printable(file))
            return None
        self._entry_of_file[place] = ".".join(at)
        name = str(entry.get("name", Path(file).stem))
        if name in self._entry_of_name:
            same = self._entry_of_name[name]
            text = f"the name of two blocks, also of {same}; each needs its own `name`"
            self._add(text, at, printable(name))
            return None
        self._entry_of_name[name] = ".".join(at)
        scenario = self._scenario(place, file, number, at)
        if scenario is None:
            return None
        return FarmBlock(printable(name, 40), file, scenario)

    def _file(self, entry: Any, at: tuple[str, ...]) -> str | None:
        """Return the file of a block; None if something is wrong with its entry."""
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            self._add(f"must be a map with the scenario's file, {EXAMPLE}", at, show(entry))
            return None
        unknown = [key for key in entry if key not in ("file", "name")]
        for key in unknown:
            text = "unknown key; a block has file and name, and all else stands in its file"
            self._add(text, (*at, str(key)), show(entry[key]))
        name = entry.get("name", "block")
        if not isinstance(name, str) or not name.isprintable() or not name:
            self._add("must be a text", (*at, "name"), show(name))
            return None
        if unknown:
            return None
        return str(entry["file"])

    def _scenario(
        self, place: Path, file: str, number: int, at: tuple[str, ...]
    ) -> Scenario | None:
        """Return the scenario of a block with the farm's fleet, and seeds of its own."""
        if is_farm(place):
            self._add("is a farm itself; list its blocks here", (*at, "file"), printable(file))
            return None
        changes = {key: self._values[key] for key in FLEET if key in self._values}
        try:
            scenario = load(place)
            if changes:
                scenario = with_changes(scenario, **changes)
        except ScenarioError as error:
            for problem in error.problems:
                where = f"block {printable(file)}: {problem}"
                self._problems.append(Problem(self._source, where, ".".join(at)))
            return None
        return with_seed(scenario, scenario.seed + SEEDS_OF_A_BLOCK * number)

    def _disagreements(self, blocks: Sequence[FarmBlock]) -> Iterator[Problem]:
        """Yield a problem for each part of the fleet that differs between blocks."""
        first = blocks[0]
        for key in (*FLEET, *MACHINES):
            if key in self._varied or (key in FLEET and key in self._values):
                continue
            for block in blocks[1:]:
                if _of(block, key) != _of(first, key):
                    yield Problem(self._source, self._disagreement(key, first, block), BLOCKS)
                    break

    def _disagreement(self, key: str, first: FarmBlock, block: FarmBlock) -> str:
        """Return what differs between two blocks, and what would be right."""
        differs = f"{first.name} and {block.name} differ in `{key}`, and one fleet harvests both"
        if key in FLEET:
            numbers = f"{_of(first, key)} and {_of(block, key)}"
            return f"{differs} ({numbers}): write `{key}: {_of(first, key)}` into this file"
        return f"{differs}: write the same into their files"


def _of(block: FarmBlock, key: str) -> Any:
    """Return the value of a block for a key of FLEET or MACHINES."""
    if key == "carriers":
        return block.scenario.carrier_count
    return getattr(block.scenario, key)
