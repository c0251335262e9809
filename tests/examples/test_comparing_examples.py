"""The examples that compare: the limit with the long run, the fast model with the simulator,
intervals with the truth, recordings.
"""

import re
import subprocess
import sys
from itertools import islice

from command_line import ROOT, orchard, python
from rerun.catalog import CatalogClient


def printed(*arguments: str) -> str:
    return python(*arguments).stdout


def test_the_limit_stands_beside_the_long_run():
    out = printed("examples/long_run.py", "--against", "30", "4/2/1")
    assert (
        len(
            re.findall(r"4/2/1 .* (?:carriers|pickers) .* (?:[+-]\d+\.\d|leaves a picker out)", out)
        )
        == 12
    )
    assert re.search(r"against 30 rows each: \d+\.\d % on average, \d+\.\d % at most", out)


def test_the_fast_model_stands_beside_the_simulator():
    out = printed("examples/fast_and_full.py", "3/2/1:one-way:nearest:1.0:20.0")
    assert re.search(r"3/2/1:one-way:nearest:1.0:20.0 .* [+-]0\.\d\d ", out)
    assert re.search(r"1 cells: mean error 0\.\d\d %, worst 0\.\d\d %", out)


def test_a_warm_up_and_what_the_limit_explains_are_told():
    out = printed("examples/run_statistics.py", "--seeds", "4", "3/2/2:two-way:predictive:0.05")
    match = re.search(r"MSER-5 leaves out (\d+) % on average.* explains (\d+\.\d) %", out)
    assert int(match[1]) <= 50
    assert float(match[2]) > 90.0, "pickers limit, and each seed draws how fast rows are"


def test_intervals_stand_beside_the_truth():
    """One study of each of five orchards: in four of them no run agrees with another one.

    Of each setting five intervals are looked at: after four numbers of runs, and at the end.
    """
    out = printed("examples/interval_coverage.py", "--seeds", "4", "1")
    assert re.findall(r"(\d+\.\d) % of (\d+) \(95 %: \d+\.\d to \d+\.\d\)", out)
    counts = [int(count) for count in re.findall(r"% of (\d+)", out)]
    one_study = [1, 1]
    wanted = []
    for settings in (3, 5, 4, 3):
        wanted += [settings] * 5 + one_study
    assert counts[: len(wanted)] == wanted
    assert out.count("replications of each on average") == 5


def test_recordings_of_several_runs_are_one_dataset(tmp_path):
    files = [tmp_path / f"{name}.rrd" for name in ("two", "three")]
    for file, carriers in zip(files, (2, 3), strict=True):
        orchard("--mode", "local", "--rows", 3, "--carriers", carriers, "--record", file)
    example = [sys.executable, "examples/compare_recordings.py", *map(str, files)]
    with subprocess.Popen(example, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            *delivered, serving = [line.strip() for line in islice(process.stdout, 3)]
            dataset = CatalogClient(serving.removeprefix("serving ")).get_dataset("harvests")
            assert delivered == ["three: 3 bins delivered", "two: 3 bins delivered"]
            assert dataset.blueprints() == [dataset.default_blueprint()]
            assert len(dataset.segment_ids()) == 2
        finally:
            # An interrupt is ignored by what a shell starts in the background.
            process.terminate()
    assert (
        "docs/orchard.png"
        in python("examples/compare_recordings.py", "docs/orchard.png", code=1).stderr
    )
