"""The recipes of CONTRIBUTING.md: what they name is there, and one is carried out in a copy of the clone."""

import re
import shutil
import subprocess
import sys
from typing import NamedTuple

import pytest
from code_blocks import ROOT
from patience import PATIENCE

RECIPES = dict(
    re.findall(
        r"^\*\*(A new [^*]+)\*\*(.*?)(?=^\*\*|\Z)",
        (ROOT / "CONTRIBUTING.md").read_text().split("\n## Recipes\n")[1].split("\n## ")[0],
        re.M | re.S,
    )
)
PARTS = ("orchard", "processes", "config", "bridges", "docs", "tests", "chaos", "bench", "examples")
LEFT_OUT = shutil.ignore_patterns("*.pyc", "*.webp", "*.png")


class Edit(NamedTuple):
    """A change of one file: a text that stands there once, and what takes its place."""

    file: str
    before: str
    after: str


NEW_POLICY = '''class ByName(Ranking):
    """The bin whose name is first gets a carrier first."""

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return (report.name,)


class LongestWaiting(Ranking):
'''
EDITS = {
    "A new dispatch policy": [
        Edit("orchard/agents/ranking.py", "class LongestWaiting(Ranking):\n", NEW_POLICY),
        Edit("orchard/agents/policies.py", "import (\n    Far", "import (\n    ByName,\n    Far"),
        Edit(
            "orchard/agents/policies.py",
            "    Nearest,\n    FarthestFirst,\n",
            "    Nearest,\n    ByName,\n    FarthestFirst,\n",
        ),
        Edit(
            "orchard/field/scenario.py",
            '    NEAREST,\n    "farthest-first",\n',
            '    NEAREST,\n    "by-name",\n    "farthest-first",\n',
        ),
        Edit(
            "docs/bounds.md",
            "| `nearest` | the bin that",
            "| `by-name` | the bin whose name is first | an example |\n| `nearest` | the bin that",
        ),
        Edit(
            "tests/agents/test_policies.py",
            "DECISIONS = {\n",
            'DECISIONS = {\n    "by-name": ["bin_01", "bin_02"],\n',
        ),
    ]
}
QUICK = "policy_prefers or each_bin_gets or assigns_only or two_lines"


def paths_in(text):
    """Return the files and folders that a text names."""
    return re.findall(r"`?((?:orchard|config|docs|tests)/[\w/.]*\w/?)`?", text)


@pytest.mark.parametrize("recipe", RECIPES)
def test_what_a_recipe_names_is_there(recipe):
    assert [path for path in paths_in(RECIPES[recipe]) if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("recipe", EDITS)
def test_a_recipe_leads_to_its_end(recipe, tmp_path):
    """Each file that must be edited is named, and then the quick ones of the tests pass that the recipe names."""
    edits = EDITS[recipe]
    *steps, tests = re.split(r"\n\d\. ", RECIPES[recipe])
    named = paths_in(" ".join(steps))
    assert {edit.file for edit in edits} == {*named}
    for part in PARTS:
        shutil.copytree(ROOT / part, tmp_path / part, ignore=LEFT_OUT)
    for file in ("pyproject.toml", "keyspace.md", "run.py"):
        shutil.copy(ROOT / file, tmp_path)
    for edit in edits:
        path = tmp_path / edit.file
        text = path.read_text()
        assert text.count(edit.before) == 1, edit
        path.write_text(text.replace(edit.before, edit.after))
    run_there(tmp_path, "-m", "docs.generate")
    run_there(tmp_path, "-m", "pytest", *paths_in(tests), "-k", QUICK, "-p", "no:cacheprovider")


def run_there(folder, *words):
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
