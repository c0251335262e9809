"""An answer of a study that cannot be written: words say that it is lost, and how to get it."""

import pytest
from shell import shell

from orchard.study.study_command import LOST

# In a shell `>&-` closes stdout, and /dev/full takes nothing, as a full disk.
ANSWERS = [
    "study small.yaml --vary carriers=1 --model fast --budget 60s --workers 1 --out studies.db",
    "study small.yaml --vary carriers=1 --model fast --workers 1 --out studies.db --progress json",
]


@pytest.mark.parametrize("command", ANSWERS)
@pytest.mark.parametrize(
    ("to", "why"), [(">&-", "it is closed"), (">/dev/full", "No space left on device")]
)
def test_an_answer_of_a_study_that_is_lost_is_told(command, to, why, tmp_path):
    (tmp_path / "small.yaml").write_text("rows: 3\npeople: {workers: 0, visitors: 0}\n")
    code, told = shell(f"orchard {command} {to}", tmp_path)
    assert code == 1, told
    assert f"stdout cannot be written: {why}" in told
    assert told.endswith(f"{LOST}\n")
