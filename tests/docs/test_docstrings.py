"""The examples in docstrings: each does what it says."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = [
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
    for path in sorted(ROOT.glob("orchard/**/*.py"))
    if ">>> " in path.read_text()
]


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_a_module_do_what_they_say(module):
    """The examples run one after another, each with the names of its module."""
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried > 0
    assert failed == 0


def test_the_public_packages_have_examples():
    public = ("orchard.contract.", "orchard.net.", "orchard.wire.", "orchard.sim.engine")
    for package in (*public, "orchard.local", "orchard.field."):
        assert [module for module in MODULES if module.startswith(package)], package
