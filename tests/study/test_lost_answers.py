"""An answer of a study that cannot be written: words say that it is lost, and how to get it."""

import pytest
from called import called
from few_runs import FewRuns
from shell import shell

from orchard.study import ending
from orchard.study import study as studies
from orchard.study.ending import LOST
from orchard.study.sensitivity import study as sensitivities

SMALL = "rows: 3\nrow_length: 20\npeople: {workers: 0, visitors: 0}\n"
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


@pytest.mark.parametrize(
    "words",
    [
        ("farm.yaml", "--vary", "carriers=1"),
        ("small.yaml", "--sensitivity", "--vary", "bay=0..2", "--horizon", "harvest"),
    ],
)
def test_a_farm_and_a_sensitivity_tell_it_too(words, tmp_path, monkeypatch, capfd):
    """Here stdout takes the answer, but counts as lost."""
    monkeypatch.chdir(tmp_path)
    for name in ("small", "low"):
        (tmp_path / f"{name}.yaml").write_text(SMALL)
    blocks = "blocks: [{file: small.yaml}, {file: low.yaml}]\ntransfer_minutes: 5\n"
    (tmp_path / "farm.yaml").write_text(blocks)
    for module in (studies, sensitivities):
        monkeypatch.setattr(module, "processes", lambda count: FewRuns(1000))
    monkeypatch.setattr(ending, "is_answer_lost", lambda: True)
    done = called("study", *words, "--out", "studies.db")
    assert done.exit_code == 1
    assert capfd.readouterr().err.endswith(f"{LOST}\n")
