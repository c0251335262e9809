"""A farm as a user of the page enters it: its blocks, the way between them, and the command."""

import pytest

from orchard.app.command import Files
from orchard.app.farm_run import (
    AddedBlock,
    FarmRun,
    FarmSettings,
    farm_command,
    farm_file,
    write_farm,
)
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.study.farm_file import read_farm

TOP = AddedBlock("Top", Scenario(rows=4, picking_rate=1.5))
LOW = AddedBlock("Low", Scenario(rows=6, row_length=90.0, pickers=3))
FARM = FarmSettings(blocks=(TOP, LOW), transfer="12,5", budget="90,5")


def test_the_blocks_are_written_as_a_farm_of_the_command(tmp_path):
    """The pickers of the form go from block to block, whatever a block had when it was added."""
    files = Files(tmp_path, "study-1")
    write_farm(FARM, 4, files)
    farm = read_farm(farm_file(files), ["carriers"])
    assert [block.name for block in farm.blocks] == ["Top", "Low"]
    assert [block.scenario.rows for block in farm.blocks] == [4, 6]
    assert [block.scenario.pickers for block in farm.blocks] == [4, 4]
    assert farm.transfer_seconds == 750.0
    line = farm_command(FARM, files)
    assert line[line.index("study") + 1 : line.index("--progress")] == [
        str(tmp_path / "study-1.farm.yaml"),
        "--vary",
        "carriers",
        "--budget",
        "90.5s",
    ]


def test_a_name_may_have_any_letter_or_sign(tmp_path):
    files = Files(tmp_path, "study-1")
    names = ["Hügel", "🥝 'Gold': [2]"]
    blocks = [AddedBlock(name, TOP.scenario) for name in names]
    write_farm(FarmSettings(blocks=tuple(blocks)), 4, files)
    assert [block.name for block in read_farm(farm_file(files)).blocks] == names


WRONG = [
    (dict(transfer="far"), "To the next block, min: must be a number from 0 to 1440"),
    (dict(transfer="1,250"), "write 1.25 or 1250"),
    (dict(budget="0"), "Time to take, s: must be a number"),
]


@pytest.mark.parametrize(("settings", "words"), WRONG, ids=[words[:12] for _, words in WRONG])
def test_what_is_wrong_is_told_by_its_label(settings, words):
    assert words in FarmSettings(**settings).problem


@pytest.mark.parametrize("name", ["", "Top", "a\nb", "a" * 41])
def test_a_block_needs_a_name_of_its_own(name):
    assert FARM.problem_of_name(name).startswith("Name of the block: ")
    assert FARM.problem_of_name("Hill") == ""


def test_blocks_with_unlike_machines_are_no_farm(tmp_path):
    """The message is that of the command, and nothing is started."""
    fast = AddedBlock("Fast", Scenario(rows=4, carrying={"speed": 2.0}))
    with pytest.raises(ScenarioError, match="Top and Fast differ in `carrying`"):
        FarmRun(FarmSettings(blocks=(TOP, fast)), 2, Files(tmp_path, "study-1"))
