"""The examples that compare: policies in the simulator, and the closed form with the long run."""

import re
import subprocess
import sys

from command_line import ROOT, SECONDS


def printed(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_policies_are_compared_in_whole_harvests():
    said = printed("examples/compare_policies.py", "--rows", "3", "--pickers", "3", "--carriers", "2", "nearest", "predictive")
    rates = dict(re.findall(r"(\S+) +([\d.]+) bins/h, pickers wait", said))
    assert float(rates["predictive"]) > float(rates["nearest"])


def test_the_closed_form_stands_beside_the_long_run():
    said = printed("examples/long_run.py", "--rounds", "3", "4/2/1")
    assert len(re.findall(r"4/2/1 .* (?:carriers|pickers) .* [+-]\d+\.\d", said)) == 8


def test_the_fast_model_stands_beside_the_simulator():
    said = printed("examples/fast_and_full.py", "3/2/1:one-way:nearest:1.0:20.0")
    assert re.search(r"3/2/1:one-way:nearest:1.0:20.0 .* [+-]0\.\d\d ", said)
    assert re.search(r"1 cells: mean error 0\.\d\d %, worst 0\.\d\d %", said)
