"""The command `orchard calibrate`, as a person uses it."""

from datetime import datetime, timedelta
from pathlib import Path

import pytest
from code_blocks import block, commands
from command_line import orchard
from made_logs import log_text

from orchard.calibrate.bins import LoggedBin
from orchard.calibrate.model_bins import model_bins
from orchard.field.scenario import Scenario, load, to_short_yaml, with_changes

# An orchard of 6 rows of 3 bins, so a day has 18 bins. Its picking rate is what a log tells.
BASE = Scenario(
    rows=6,
    row_length=60.0,
    pickers=3,
    carriers=2,
    bins_per_row=3.0,
    people={"workers": 0, "visitors": 0},
    animals={"dogs": 0, "cats": 0},
    tractor=False,
    dispatch="nearest",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with a log of two days at 4 bins an hour, and the scenario beside it.

    Picking times of rows spread by 15 %, and those of bins by 20 %. The names are those of the
    command in docs/how-to.md.
    """
    data = tmp_path_factory.mktemp("calibrate")
    spreads = {
        "spread": {"distribution": "lognormal", "cv": 0.15},
        "spread_of_bins": {"distribution": "lognormal", "cv": 0.2},
    }
    truth = with_changes(BASE, picking_rate=4.0, picking=spreads)
    bins = []
    for day in range(2):
        for bin_ in model_bins(with_changes(truth, seed=day + 1)):
            moved = bin_.day + timedelta(days=day)
            bins.append(LoggedBin(**vars(bin_) | {"day": moved}))
    (data / "log.csv").write_text(log_text(bins))
    (data / "rent.yaml").write_text(to_short_yaml(BASE))
    return data


def test_the_documented_command_gives_a_tested_rate(folder):
    (line,) = commands(block("docs/how-to.md", "calibrate"))
    # After Python and run.py.
    words = line[2:]
    out = orchard(*words, folder=folder).stdout
    assert "36 bins of 2 days" in out
    assert "2000-01-02, which the fit did not see:" in out
    scenario = load(folder / "mine.yaml")
    assert scenario.picking_rate == pytest.approx(4.0, rel=0.2)
    assert scenario.rows == 6
    assert scenario.pickers == 3
    assert scenario.carriers == 2
    assert f"{scenario.picking_rate:.3g}" in out
    bins = scenario.picking.spread_of_bins
    assert bins.cv == pytest.approx(0.2, rel=0.5)
    (row,) = [line for line in out.splitlines() if line.startswith("bins of a row differ by")]
    assert f" {100.0 * bins.cv:.3g} " in row
    assert row.rstrip().endswith("picking.spread_of_bins.cv")
    assert "shares of the variance: " in out
    # A scenario of this command may be replaced, and no other file.
    assert orchard(*words, folder=folder).stdout == out
    text = (folder / "rent.yaml").read_text()
    refused = orchard(*words[:2], "--out", "rent.yaml", folder=folder, code=2).stderr
    assert "is not a scenario of `orchard calibrate` that the Orchard has written" in refused
    assert (folder / "rent.yaml").read_text() == text


def test_a_wrong_log_is_told_and_nothing_is_written(folder, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text((folder / "log.csv").read_text().replace(",fetched,", ",fetch,", 1))
    out = tmp_path / "mine.yaml"
    run = orchard("calibrate", log, "--out", out, code=2)
    assert run.stdout == ""
    assert "event = fetch: must be full, fetched or unloaded; did you mean fetched?" in run.stderr
    assert not out.exists()


def test_a_missing_log_and_a_wrong_confidence_are_told(tmp_path):
    log = tmp_path / "none.csv"
    assert orchard("calibrate", log, code=2).stderr == f"{log}: No such file or directory\n"
    err = orchard("calibrate", log, "--confidence", "2", code=2).stderr
    assert "2: expected a share from 0.5 to 0.999, such as 0.95 or 95%" in err


def paused(text: str, hours: int, picker: str = "") -> str:
    """Return a log in which work stops at eight for some hours, of one picker or of all."""
    head, *lines = text.splitlines()
    later_lines = []
    for line in lines:
        time = datetime.fromisoformat(line.split(",")[0])
        if time.hour >= 8 and picker in line:
            time += timedelta(hours=hours)
        later_lines.append(",".join([time.isoformat(), *line.split(",")[1:]]))
    return "\n".join([head, *sorted(later_lines)]) + "\n"


def test_a_break_of_the_scenarios_shift_is_no_working_time(folder, tmp_path):
    """Without the scenario, bins of that time are left out, and a message says what to do."""
    log = tmp_path / "log.csv"
    log.write_text(paused((folder / "log.csv").read_text(), 3))
    shift = {"begin": "07:00", "end": "18:00", "breaks": [["08:00", "11:00"]]}
    on = tmp_path / "rent.yaml"
    on.write_text(to_short_yaml(with_changes(BASE, shift=shift)))
    advice = "which belongs in shift.breaks of the scenario (--on)"
    assert advice in orchard("calibrate", log).stdout
    assert advice not in orchard("calibrate", log, "--on", on).stdout


def test_a_bin_that_took_far_too_long_is_named(folder, tmp_path):
    """One picker pauses for an hour; a bin takes a quarter of that."""
    log = tmp_path / "log.csv"
    log.write_text(paused((folder / "log.csv").read_text(), 1, "picker_01"))
    out = orchard("calibrate", log).stdout
    assert "of picker_01 took" in out
    assert "a break, or lines are missing; it is left out" in out
