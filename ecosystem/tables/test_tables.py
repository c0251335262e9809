"""The programs of docs/how-to.md run, with pandas and polars, on the tables of a run, and what they
find stands in the run's summary.
"""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pandas as pd
import polars as pl
import pytest

# The command `orchard`; `.ci/ecosystem` names that of the clone.
ORCHARD = shlex.split(os.environ.get("ORCHARD", "orchard"))
SECONDS = 300  # that a command may take
TICK_SECONDS = 0.1
PAGE = (Path(__file__).parents[2] / "docs" / "how-to.md").read_text()
# The blocks of code of the page, by their names, and those of them that are programs on tables.
BLOCKS = dict(re.findall(r"^```(?:python|sh) (\S+)\n(.*?)^```$", PAGE, re.M | re.S))
PROGRAMS = ("units", "waiting")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the tables of the run that the page begins with, and its summary."""
    folder = tmp_path_factory.mktemp("run")
    _, *words = shlex.split(BLOCKS["tables"])
    done = subprocess.run(
        [*ORCHARD, *words, "--summary", "summary.json"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def summary_in(folder: Path) -> dict:
    """Return the summary of the run."""
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_programs_of_the_page_run(folder: Path, name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", BLOCKS[name]],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_pandas_finds_what_the_summary_says(folder: Path) -> None:
    """The table of bodies has a row for each body and tick, from which these figures follow."""
    bodies = pd.read_parquet(folder / "tables" / "bodies.parquet")
    summary = summary_in(folder)
    assert len(bodies) == summary["ticks"] * summary["agents"]
    kinds = bodies["name"].str.rsplit("_", n=1).str[0]
    for kind, states in summary["state_seconds"].items():
        seconds = bodies[kinds == kind].groupby("state").size() * TICK_SECONDS
        assert seconds.round(1).to_dict() == states
    speeds = (bodies[["linear_x", "linear_y"]] ** 2).sum(axis=1) ** 0.5
    driven = speeds * TICK_SECONDS
    assert driven.groupby(kinds).sum()["carrier"] == pytest.approx(
        summary["distance_metres"]["carrier"], rel=1e-3
    )
    exchanges = pd.read_parquet(folder / "tables" / "exchanges.parquet")
    # The table counts the drive to the row's end, too.
    assert exchanges["waited_seconds"].mean() > summary["picker_waiting_seconds"] > 0.0


def test_polars_reads_a_folder_of_files_as_one_table(folder: Path) -> None:
    bodies = pl.read_parquet(folder / "tables" / "bodies.parquet")
    summary = summary_in(folder)
    assert len(bodies) == summary["ticks"] * summary["agents"]
    assert bodies["tick"].is_sorted()


def test_polars_reads_the_summary(folder: Path) -> None:
    """It is a table of one row, with a dotted name for each figure."""
    table = pl.read_parquet(folder / "tables" / "summary.parquet")
    summary = summary_in(folder)
    assert len(table) == 1
    (row,) = table.to_dicts()
    assert row["hash"] == summary["hash"]
    picking = summary["state_seconds"]["picker"]["picking"]
    assert row["state_seconds.picker.picking"] == picking
    assert json.loads(row["scenario"]) == summary["scenario"]
    assert row["history.seconds"] == summary["history"]["seconds"]
