"""The commands of a study in documents run, with a smaller orchard and less time."""

import pytest
from code_blocks import ROOT, block, commands
from command_line import orchard

from docs.study import SCENARIO, result
from orchard.field.scenario import check, parse

SMALL = (
    "rows: 3\npickers: 2\npicking_rate: 40\nprices: {picker_per_hour: 20, carrier_per_hour: 6}\n"
)
SHORT = ["--budget", "1s", "--model", "fast", "--workers", "1"]
BLOCKS = [
    ("study", "rent"),
    ("study", "vary"),
    ("study", "finish"),
    ("study", "own"),
    ("study", "sensitivity"),
    ("bounds", "policies"),
]
COMMANDS = [
    command for page, name in BLOCKS for command in commands(block(f"docs/{page}.md", name))
]


@pytest.mark.parametrize("command", COMMANDS, ids=range(len(COMMANDS)))
def test_the_commands_of_the_study_run(command, tmp_path):
    # A file has precedence over a scenario of the package with the same name.
    for name in ("rent.yaml", "undisturbed", "hand_picking"):
        (tmp_path / name).write_text(SMALL)
    done = orchard(
        *command[2:], *SHORT, "--out", tmp_path / "studies.db", code=None, folder=tmp_path
    )
    # On a busy machine a second may be too short for a run: then the exit code is 1.
    is_too_short = "the budget is too short" in done.stderr
    assert done.returncode == int(is_too_short), done.stdout + done.stderr
    answers = ("bins an hour", "a bin", "there was no time", "harvests within", "No point")
    assert any(answer in done.stdout for answer in answers)


def test_the_scenario_of_the_study_is_one():
    assert parse(block("docs/study.md", "rent.yaml")) == parse(SCENARIO)


def test_the_document_says_what_was_measured():
    assert " ".join(result().answer.split()) in " ".join(
        (ROOT / "docs" / "study.md").read_text().split()
    )
    assert f"{result().answer.partition('. The orchard')[0]}." in (ROOT / "README.md").read_text()
    assert result().best["carriers"] < max(result().varied["carriers"]), "the answer lies inside"
    assert parse(SCENARIO) == check(result().scenario)
