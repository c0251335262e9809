"""A clone from which the folder of an extra has been removed: the rest of it works.

`test_left_out.py` asks the same of the catalogue of commands. Here the folders are really gone.
"""

import json
import os
import shutil
import site
import subprocess
import sys
from pathlib import Path

import pytest
from code_blocks import ROOT
from patience import PATIENCE

from orchard.sim.kernels.cache import kernels_folder
from orchard.terminal.catalogue import COMMANDS

PRODUCT = ("orchard", "processes", "config", "bridges")
WITH_TESTS = (*PRODUCT, "tests", "chaos", "docs", "examples", "pyproject.toml", "keyspace.md")
HARVEST = ["harvest", "--rows", "3", "--mode", "local", "--record", "none", "--duration", "1"]
# A package that can be removed -> what then says that it is missing, beside its own commands.
IN_NEED: dict[str, list[list[str]]] = {
    "app": [],
    "bags": [],
    "calibrate": [],
    "futures": [],
    "gym": [],
    "optimum": [["bound"], ["benchmark", "nearest", "--secret", "orchard/local.py"]],
    "roads": [["layout", "export", "--lif", "map.json"]],
    "study": [["app"], ["fork", "last", "--at", "1", "--futures", "2"]],
}
# The packages that are in this clone. Of one that is not, there is nothing to remove.
HERE = [package for package in IN_NEED if (ROOT / "orchard" / package).is_dir()]
# All of them but `futures`: tests of FOLDERS import that.
EXTRAS = ["app", "bags", "calibrate", "gym", "optimum", "roads", "study"]
# Tests of three packages that stay. They start no process.
TESTS = ("tests/plans/test_steps.py", "tests/wire/test_keys.py", "tests/sim/test_deeds.py")
# Folders of tests whose files import no package of EXTRAS.
FOLDERS = ("tests/behaviour", "tests/commands", "tests/discrete", "tests/field", "tests/launch")
# A program that calls commands, given as JSON, in one process. Its last line is a list in JSON:
# exit code, stdout and stderr of each.
CALLS = """
import json, sys
from called import called
print(json.dumps([called(*words) for words in json.loads(sys.argv[1])]))
"""


def clone_without(packages: list[str], parts: tuple[str, ...], folder: Path) -> Path:
    """Copy these parts of the clone without some folders of orchard/. Return the folder."""
    for part in parts:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("*.pyc"))
        else:
            shutil.copy(ROOT / part, folder)
    for package in packages:
        if package in HERE:
            shutil.rmtree(folder / "orchard" / package)
    return folder


def python_in(clone: Path, *words: str) -> str:
    """Run Python in a clone that is not installed. Return what it prints.

    Without `-S` Python would find the removed folders in the clone that is installed for tests.
    """
    kernels = kernels_folder()
    assert kernels is not None
    paths = [str(ROOT / "tests" / "support"), *site.getsitepackages()]
    done = subprocess.run(
        [sys.executable, "-S", *words],
        cwd=clone,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(kernels.parent)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def call(clone: Path, *commands: list[str]) -> list[tuple[int, str, str]]:
    """Return exit code, stdout and stderr of each command in a clone."""
    out = python_in(clone, "-c", CALLS, json.dumps(commands))
    return json.loads(out.splitlines()[-1])


@pytest.mark.parametrize("package", HERE)
def test_without_a_folder_only_what_needs_it_is_missing(package, tmp_path):
    clone = clone_without([package], PRODUCT, tmp_path)
    own = [[name] for name, entry in COMMANDS.items() if entry.package == f"orchard.{package}"]
    missing = [*own, *IN_NEED[package]]
    answers = call(clone, HARVEST, *missing)
    code, stdout, stderr = answers.pop(0)
    assert code == 0, stderr
    assert "hash" in stdout
    for words, (code, _, stderr) in zip(missing, answers, strict=True):
        assert code == 2, words
        assert f"this installation lacks orchard.{package}" in stderr, words
        assert "pip install" not in stderr, words


def test_without_the_folders_of_extras_the_rest_passes(tmp_path):
    clone = clone_without(EXTRAS, WITH_TESTS, tmp_path)
    gone = [f"orchard.{package}" for package in EXTRAS]
    helps = [[name, "--help"] for name, entry in COMMANDS.items() if entry.package not in gone]
    for code, _, stderr in call(clone, *helps):
        assert code == 0, stderr
    out = python_in(clone, "-m", "pytest", "-q", "-p", "no:cacheprovider", *TESTS)
    assert "[100%]" in out
    python_in(clone, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--collect-only", *FOLDERS)
