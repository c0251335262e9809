"""The examples that compare: the limit with the long run, the fast model with the simulator, intervals with the truth."""

import re

from command_line import python


def printed(*arguments: str) -> str:
    return python(*arguments).stdout


def test_the_limit_stands_beside_the_long_run():
    said = printed("examples/long_run.py", "4/2/1")
    assert len(re.findall(r"4/2/1 .* (?:carriers|pickers) .* [+-]\d+\.\d", said)) == 12


def test_the_fast_model_stands_beside_the_simulator():
    said = printed("examples/fast_and_full.py", "3/2/1:one-way:nearest:1.0:20.0")
    assert re.search(r"3/2/1:one-way:nearest:1.0:20.0 .* [+-]0\.\d\d ", said)
    assert re.search(r"1 cells: mean error 0\.\d\d %, worst 0\.\d\d %", said)


def test_intervals_stand_beside_the_truth():
    said = printed("examples/interval_coverage.py", "--truth", "3", "1")
    assert re.findall(r"(\d+\.\d) % of (\d+) \(95 %: \d+\.\d to \d+\.\d\)", said)
    assert [int(count) for count in re.findall(r"% of (\d+)", said)] == [3, 1, 1]
