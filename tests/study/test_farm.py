"""A farm: one fleet harvests several blocks one after another; its time is the sum of theirs.

The file of a farm names the files of its blocks, and the minutes of a transfer: the time in which
the fleet moves from one block to the next.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from called import called
from few_runs import FewRuns
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import load
from orchard.report.limits import full_bins
from orchard.study import study as module
from orchard.study.farm import farm_study, sum_of
from orchard.study.farm_file import is_farm, read_farm
from orchard.study.farm_words import answer
from orchard.study.options import StudyOptions
from orchard.study.result import Interval

# Two blocks, the file of a farm of both, and a line with a fleet.
TOP = """\
rows: 3
picking_speed: 0.5
picking: {spread: {distribution: gamma}}
people: {workers: 0, visitors: 0}
animals: {dogs: 0, cats: 0}
"""
LOW = TOP.replace("rows: 3", "rows: 4\nrow_length: 30")
FARM = """\
blocks:
- {file: top.yaml}
- {file: low.yaml, name: Low}
transfer_minutes: 20
"""
FLEET = "carriers: 2\n"


@pytest.fixture
def farm(tmp_path) -> Path:
    """Return the file of a farm with two blocks."""
    (tmp_path / "top.yaml").write_text(TOP)
    (tmp_path / "low.yaml").write_text(LOW)
    path = tmp_path / "farm.yaml"
    path.write_text(FARM)
    return path


def problems(path: Path, *varied: str) -> str:
    """Return what is wrong with a farm's file. `varied`: the keys that the study varies."""
    with pytest.raises(ScenarioError) as raised:
        read_farm(path, varied)
    return str(raised.value)


def of_student(sample) -> Interval:
    """Return the mean of a sample with Student's interval of 95 %."""
    mean = float(np.mean(sample))
    half = float(stats.t.ppf(0.975, len(sample) - 1) * stats.sem(sample))
    return Interval(mean=mean, low=mean - half, high=mean + half)


@settings(max_examples=20)
@given(st.lists(st.lists(st.floats(100.0, 900.0), min_size=3, max_size=9), min_size=2, max_size=4))
def test_a_sum_has_the_sum_of_means_and_variances(samples):
    """If the intervals of the parts are Student's, that of the sum is Welch's: a t distribution,
    whose degrees of freedom follow from the variances of the means (Welch and Satterthwaite).
    """
    parts = [(of_student(sample), len(sample)) for sample in samples]
    total = sum_of(parts, 0.95)
    assert total.mean == pytest.approx(sum(np.mean(sample) for sample in samples))
    variances = [np.var(sample, ddof=1) / len(sample) for sample in samples]
    variance = sum(variances)
    if variance == 0.0:
        assert total.low == total.high == total.mean
        return
    parts_of_freedom = 0.0
    for own, sample in zip(variances, samples, strict=True):
        parts_of_freedom += own**2 / (len(sample) - 1)
    freedom = variance**2 / parts_of_freedom
    half = stats.t.ppf(0.975, freedom) * math.sqrt(variance)
    assert total.high - total.mean == pytest.approx(half, rel=1e-6)


def test_a_farm_takes_its_harvests_and_its_transfers(farm, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "processes", lambda _: FewRuns(1000))
    options = StudyOptions(budget_seconds=3600.0, store=tmp_path / "s.db", within=0.2)
    result = farm_study(read_farm(farm, ["carriers"]), {"carriers": [1, 3]}, options)
    assert [row.setting for row in result.table] == [{"carriers": 1}, {"carriers": 3}]
    for row in result.table:
        # A transfer takes 20 min, 1,200 s. The interval of a sum is wider than half the widest of
        # the parts, and narrower than their sum, because the parts are independent.
        harvests = [row.blocks["top"].mean, row.blocks["Low"].mean]
        assert row.seconds.mean == pytest.approx(sum(harvests) + 1200.0)
        widths = [part.high - part.mean for part in row.blocks.values()]
        width = row.seconds.high - row.seconds.mean
        assert max(widths) * 0.5 < width < sum(widths)
        assert row.bins == sum(
            full_bins(lay_out(load(farm.parent / f"{name}.yaml"))) for name in ("top", "low")
        )
        assert row.bins_per_hour.mean == pytest.approx(3600.0 * row.bins / row.seconds.mean)
    assert result.best_row.standing == "best"
    assert "for 2 blocks (top, Low) with 1 transfer of 20 min" in answer(result)
    assert any("no recording or picture shows them together" in note for note in result.notes)


@pytest.mark.parametrize("name", ["farm.yaml", "top.yaml", "missing/summary.json"])
def test_a_summary_that_cannot_be_written_is_told_first(farm, name, capfd):
    """No file of the farm is replaced, and no harvest is done for nothing."""
    path = farm.parent / name
    before = (farm.read_text(), (farm.parent / "top.yaml").read_text())
    done = called("study", farm, "--vary", "carriers=1", "--summary", path)
    assert done.exit_code == 2 and done.stdout == ""
    assert f"{path}: cannot be written: " in capfd.readouterr().err
    assert (farm.read_text(), (farm.parent / "top.yaml").read_text()) == before


def test_a_farm_that_is_stopped_does_not_blame_the_budget(farm, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "processes", lambda _: FewRuns(0))
    options = StudyOptions(store=tmp_path / "s.db")
    varied = {"carriers": [1, 2]}
    found = farm_study(read_farm(farm, ["carriers"]), varied, options, is_stopped=lambda: True)
    assert found.stopped_by == "stopped"
    (note,) = [note for note in found.notes if "in every block" in note]
    assert note == "the study was stopped before a run in every block of 2 of 2 settings: left out"


def test_a_farm_with_prices_tells_no_cost_of_a_robot(farm, tmp_path, monkeypatch):
    """It says that it does not use them."""
    monkeypatch.setattr(module, "processes", lambda _: FewRuns(1000))
    (tmp_path / "top.yaml").write_text(f"{TOP}prices: {{picker_per_hour: 20}}\n")
    options = StudyOptions(budget_seconds=3600.0, store=tmp_path / "s.db", within=0.2)
    result = farm_study(read_farm(farm, ["carriers"]), {"carriers": [1, 2]}, options)
    assert "prices of the blocks are not used: a farm is asked for its time" in result.notes
    assert not [note for note in result.notes if "pays" in note]


def test_blocks_have_seeds_and_chances_of_their_own(farm):
    """Seeds of a block follow each other, so those of the next block begin far away."""
    seeds = [block.scenario.seed for block in read_farm(farm, ["carriers"]).blocks]
    assert seeds[1] - seeds[0] == 1_000_000


def test_the_farm_says_its_fleet_for_all_blocks(farm):
    farm.write_text(FARM + "pickers: 3\ncarriers: 5\n")
    for block in read_farm(farm).blocks:
        assert (block.scenario.pickers, block.scenario.carrier_count) == (3, 5)


def test_blocks_that_differ_in_their_fleet_are_told(farm):
    low = farm.parent / "low.yaml"
    low.write_text(LOW + "pickers: 4\ncarriers: 3\ncarrying: {speed: 0.7}\n")
    words = problems(farm)
    assert "top and Low differ in `pickers`, and one fleet harvests both (2 and 4)" in words
    assert "write `pickers: 2` into this file" in words
    assert "top and Low differ in `carriers`" in words
    assert "top and Low differ in `carrying`, and one fleet harvests both: write the same" in words
    assert "`carriers`" not in problems(farm, "carriers")


# The file of a farm, and words of what is wrong with it.
MISTAKES = [
    ("blocks: []\ntransfer_minutes: 0\n", "blocks = 0 blocks: must be a list of 2 to 50 blocks"),
    ("blocks: top.yaml\ntransfer_minutes: 0\n", "must be a list of 2 to 50 blocks"),
    (FARM.replace("low.yaml", "top.yaml"), "blocks.1.file = top.yaml: is listed twice, also as"),
    (FARM.replace("low.yaml", "./top.yaml"), "is listed twice, also as blocks.0"),
    (FARM.replace("name: Low", "name: top"), "blocks.1 = top: the name of two blocks, also of"),
    (FARM.replace("low.yaml", "farm.yaml"), "blocks.1.file = farm.yaml: is a farm itself; list"),
    (FARM.replace("low.yaml", "none.yaml"), "block none.yaml:"),
    (FARM.replace("- {file: top.yaml}", "- top.yaml"), "blocks.0 = 'top.yaml': must be a map with"),
    (FARM.replace("name: Low", "nme: Low"), "blocks.1.nme = 'Low': unknown key; a block has file"),
    (FARM.replace("20", "-1"), "transfer_minutes = -1: must be minutes in which the fleet moves"),
    (FARM.replace("transfer_minutes: 20", ""), "transfer_minutes: is missing: minutes in which"),
    (FARM + "rows: 4\n", "rows = 4: unknown key; a farm has blocks, transfer_minutes, pickers"),
    (FARM + "pickers: 90\n", "pickers = 90: must be"),
    (FARM + "pickers: 4\n", "block top.yaml: "),
    (FARM + FLEET + FLEET, "given twice, in lines 5 and 6"),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_a_farm_that_cannot_be_is_told_in_words(farm, text: str, words: str):
    farm.write_text(text)
    assert is_farm(farm)
    assert words in problems(farm)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (["--picture", "a.svg"], "--picture: draws one orchard, and a farm's blocks are no one"),
        (["--csv", "a.csv"], "--csv: has no table of a farm; --summary writes all its figures"),
        (["--horizon", "long"], "--horizon long: a farm is harvested once; leave out --horizon"),
        (["--goal", "cost_per_bin"], "--goal cost_per_bin: a farm is asked for its time"),
        (["--finish-within", "8h"], "--finish-within: is of one orchard; the table has the time"),
        (["--vary", "picking_speed=0.1,0.2"], "--vary picking_speed: nobody chooses it"),
        (["--vary", "carriers=0,2"], "block top"),
    ],
)
def test_what_a_farm_cannot_be_asked_is_told(farm, capfd, option: list[str], words: str):
    # A study may run own classes, which print where they like: its errors pass by what `called`
    # puts in place of stderr.
    told = called("study", farm, "--out", farm.parent / "s.db", *option)
    assert (told.exit_code, told.stdout) == (2, "")
    assert words in told.stderr + capfd.readouterr().err


def test_the_command_answers_and_writes_all_figures(farm, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(module, "processes", lambda _: FewRuns(1000))
    summary = tmp_path / "answer.json"
    told = called(
        "study", farm, "--vary", "carriers=2", "--out", tmp_path / "s.db", "--summary", summary
    )
    assert told.exit_code == 0
    assert (told.stdout + capfd.readouterr().out).startswith("2 carriers: ")
    written = json.loads(summary.read_text())
    assert written["blocks"] == {"top": "top.yaml", "Low": "low.yaml"}
    assert list(written["table"][0]["blocks"]) == ["top", "Low"]
