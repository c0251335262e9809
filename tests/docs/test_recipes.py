"""The recipes of CONTRIBUTING.md: what they name is there, and each leads to its end in a copy."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from code_blocks import ROOT
from patience import PATIENCE
from recipe_edits import EDITS

# The heading of each recipe, such as "A new event" -> its text.
RECIPES = dict(
    re.findall(
        r"^\*\*(A new [^*]+)\*\*(.*?)(?=^\*\*|\Z)",
        (ROOT / "CONTRIBUTING.md").read_text().split("\n## Recipes\n")[1].split("\n## ")[0],
        re.M | re.S,
    )
)
PARTS = ("orchard", "processes", "config", "bridges", "docs", "tests", "chaos", "bench", "examples")
LEFT_OUT = shutil.ignore_patterns("*.pyc", "*.webp", "*.png")
# Words of steps in which a recipe need not edit anything.
OPTIONAL = ("nothing", " if ")
# Parts of names of tests, as `pytest -k` takes them: those, of the tests that a recipe names, that
# tell most of it. Tests of generated files are not among them, for these have just been made.
QUICK = {
    "A new event": "tips or coupling_and or same_seed or cells_of_tables",
    "A new message between agents": "hears_how_long or letters_arrive or cells_of_tables",
    "A new value of a scenario": "in_wind or default_file or every_field or circumstance or once",
    "A new figure of the summary": "figures_of_a_whole or one_schema or document_has_all",
    "A new kind of robot": "drone or start_with_their_bins or in_order or cells_of_tables",
    "A new dispatch policy": "preferred_bin or each_bin_gets or assigns_only or two_lines",
}


def paths_in(text: str) -> list[str]:
    """Return the files and folders that a text names."""
    return re.findall(r"`?((?:orchard|config|docs|tests)/[\w/.]*\w/?)`?", text)


def steps_of(recipe: str) -> tuple[list[str], str]:
    """Return the steps of a recipe: all but the last, and the last, which names its tests."""
    *steps, tests = re.split(r"\n\d\. ", RECIPES[recipe])[1:]
    return steps, tests


@pytest.mark.parametrize("recipe", RECIPES)
def test_what_a_recipe_names_is_there(recipe):
    assert [path for path in paths_in(RECIPES[recipe]) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_names_what_must_be_edited(recipe):
    """A step names each file that is edited, or its folder. Each step edits something."""
    steps, tests = steps_of(recipe)
    edited = {edit.file for edit in EDITS[recipe]}
    named = [*paths_in(" ".join(steps)), *paths_in(tests)]
    assert [file for file in edited if not any(is_in(file, path) for path in named)] == []
    for step in steps:
        paths = paths_in(step.replace("make docs", ""))
        if paths and not any(word in step for word in OPTIONAL) and "`make docs`" not in step[:12]:
            assert any(is_in(file, path) for file in edited for path in paths), step
    assert "`make docs`" in RECIPES[recipe], "each of them changes a generated file"


def is_in(file: str, path: str) -> bool:
    """Whether a path names a file, or the folder in which it is."""
    return file == path or (path.endswith("/") and file.startswith(path))


def test_each_recipe_leads_to_its_end(tmp_path):
    """All recipes are carried out in one copy, and the tests of QUICK pass there.

    A copy for each recipe would cost minutes.
    """
    for part in PARTS:
        shutil.copytree(ROOT / part, tmp_path / part, ignore=LEFT_OUT)
    for pattern in ("*.md", "*.toml", "*.py"):
        for file in ROOT.glob(pattern):
            shutil.copy(file, tmp_path)
    for edits in EDITS.values():
        for edit in edits:
            edit.carry_out(tmp_path)
    run_there(tmp_path, "-m", "docs.generate")
    tests = sorted({file for recipe in RECIPES for file in files_to_run(recipe)})
    quick = " or ".join(QUICK[recipe] for recipe in RECIPES)
    run_there(tmp_path, "-m", "pytest", *tests, "-k", quick, "-p", "no:cacheprovider")


def files_to_run(recipe: str) -> list[str]:
    """Return the files of tests that a recipe names; for a folder, those in it that it edits."""
    edited = {edit.file for edit in EDITS[recipe]}
    tests = []
    for path in paths_in(steps_of(recipe)[1]):
        is_folder = path.endswith("/")
        tests += sorted(file for file in edited if is_in(file, path)) if is_folder else [path]
    return tests


def run_there(folder: Path, *words: str) -> None:
    """Run Python in a copy of the clone. Raise AssertionError with all output if it fails."""
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=3 * PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
