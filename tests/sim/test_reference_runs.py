"""Thirty short runs have the results that are kept: their hashes, and what was picked and
delivered.
"""

import json

import pytest
from reference_runs import RESULTS, RUNS, result_of

KEPT = json.loads(RESULTS.read_text())


def test_each_reference_run_has_a_kept_result() -> None:
    assert list(KEPT) == list(RUNS)


@pytest.mark.parametrize("name", RUNS)
def test_a_reference_run_has_its_kept_result(name: str) -> None:
    """A change may be meant to change a result.

    Then `python tests/support/reference_runs.py` writes them anew.
    """
    assert result_of(name) == KEPT[name]
