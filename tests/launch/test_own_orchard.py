"""The commands of `orchard layout`: the document's commands run, and mistakes are told with exit
code 2.

`orchard layout import` makes a scenario of a survey. The sample is a survey of 8 rows; its sizes
below are what the import measures, and are printed as they stand here.
"""

import json
import os
import subprocess
import sys

import pytest
from called import called
from code_blocks import ROOT, block, commands
from command_line import python
from patience import PATIENCE

from orchard.field.scenario import load, parse

SAMPLE = ROOT / "examples" / "te_puke.geojson"
NEEDS = "pyproj is missing: pip install 'orchard-sim[survey,dev]'"


def imported(*words: object):
    """Run `orchard layout import`."""
    return called("layout", "import", *words)


def test_the_commands_of_the_document_harvest_the_sample(tmp_path):
    pytest.importorskip("pyproj", reason=NEEDS)
    make, harvest, export = commands(block("docs/how-to.md", "own orchard"))
    make = [str(SAMPLE) if word.endswith(".geojson") else word for word in make]
    # As it stands it only takes longer.
    short = [
        *harvest,
        "--mode",
        "local",
        "--record",
        "none",
        "--duration",
        "2",
    ]
    for words in (make, short, export):
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
        assert done.returncode == 0, done.stdout + done.stderr
    assert load(tmp_path / "te_puke.yaml").rows == 8
    stations = json.loads((tmp_path / "te_puke.lif.json").read_text())["layouts"][0]["stations"]
    assert {f"row/{number}" for number in range(1, 9)} < {
        station["stationId"] for station in stations
    }
    places = python("-c", block("docs/how-to.md", "places"), cwd=tmp_path, PYTHONPATH=str(ROOT))
    assert places.stdout.startswith("block-3/1 (1892797.98")


def test_the_scenario_in_the_document_is_one():
    scenario = parse(block("docs/how-to.md", "surveyed"))
    assert scenario.survey is not None
    assert [row.id for row in scenario.survey.rows] == [
        "A",
        "B",
        "C",
    ]


def test_a_file_is_not_overwritten_and_the_sizes_are_told(tmp_path):
    pytest.importorskip("pyproj", reason=NEEDS)
    out = tmp_path / "mine.yaml"
    done = imported(SAMPLE, "--out", out)
    sizes = (
        f"{out}: 8 rows, 89.11 to 95.20 m long, 5.45 to 6.04 m apart; ends from west to east 99.32"
        " m apart; the roads are straight, and lie up to 7.60 m further out than a row's end, on"
        " average 3.56 m\n"
        "- middle at 37.79003 S, 176.32560 E; rows run 71.0 degrees clockwise from north\n"
        "- the 8 lines are taken for lanes, which a picker drives between two lines of trees. If"
        " they are lines of trees, there are at most 7 rows: orchard layout import"
        f" {SAMPLE} --lines trees\n"
    )
    assert done.exit_code == 0
    assert done.stdout == sizes
    assert load(out).survey == parse(imported(SAMPLE).stdout).survey
    out.write_text("rows: 3")
    again = imported(SAMPLE, "--out", out)
    assert again.exit_code == 2
    assert again.stderr == f"{out}: there is such a file; --out must name a new one\n"
    assert out.read_text() == "rows: 3"


def test_place_and_sizes_are_printed_and_drawn_on_the_plan(tmp_path):
    pytest.importorskip("pyproj", reason=NEEDS)
    plan = tmp_path / "plan.svg"
    done = imported(SAMPLE, "--plan", plan)
    place = "middle at 37.79003 S, 176.32560 E; rows run 71.0 degrees clockwise from north"
    assert done.exit_code == 0
    assert done.stderr.startswith(f"- {place}\n")
    sizes = "8 rows, 89.11 to 95.20 m long, 5.45 to 6.04 m apart"
    assert f">{sizes}; {place}</text>" in plan.read_text()
    again = imported(SAMPLE, "--plan", plan)
    assert again.exit_code == 2
    assert again.stdout == ""
    assert again.stderr == f"{plan}: there is such a file; --plan must name a new one\n"


def test_a_file_name_stays_within_the_comment_of_the_scenario(tmp_path):
    pytest.importorskip("pyproj", reason=NEEDS)
    strange = tmp_path / os.fsdecode(b"a\nrows: 3\xff.geojson")
    strange.write_bytes(SAMPLE.read_bytes())
    out = tmp_path / "mine.yaml"
    assert imported(strange, "--out", out).exit_code == 0
    assert out.read_text().startswith("# The rows of a?rows: 3?.geojson; ")
    assert load(out).rows == 8


def test_what_is_wrong_is_told_on_stderr_with_exit_code_2(tmp_path):
    done = imported(tmp_path / "none.geojson")
    words = f"{tmp_path / 'none.geojson'}: cannot be read: No such file or directory\n"
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr == words


def test_an_import_tells_how_to_get_what_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    done = imported(SAMPLE)
    assert done.exit_code == 2
    assert done.stderr == "An import needs the package pyproj: pip install 'orchard-sim[survey]'\n"
