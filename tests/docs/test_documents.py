"""The documents tell the truth: commands and code in them run, generated files are what their programs write."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from docs.generate import generated

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
CODE = re.findall(r"```python\n(.*?)```", README, re.S)
EXTENDING = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "extending.md").read_text(), re.S)
EXAMPLES = {block: ast.get_docstring(ast.parse(block)) for block in EXTENDING}  # block -> its docstring; None: it is not a file
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", README, re.S) for line in block.splitlines()]
SECONDS = 240


@pytest.mark.parametrize("code", CODE, ids=range(len(CODE)))
def test_the_code_in_the_readme_runs(code):
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("code", [block for block, words in EXAMPLES.items() if words is None])
def test_the_code_in_extending_md_runs(code):
    test_the_code_in_the_readme_runs(code)


def test_the_examples_in_extending_md_are_the_files():
    shown = {}
    for block, words in EXAMPLES.items():
        if words is not None:
            (module,) = set(re.findall(r"examples\.seams\.(\w+)\.", words))
            shown[f"{module}.py"] = block
    assert shown == {path.name: path.read_text() for path in (ROOT / "examples" / "seams").glob("*.py")}
    assert all(len(text.splitlines()) <= 30 for text in shown.values())


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_in_the_readme_run(command, tmp_path):
    """`make` only says what it would do: it would test itself. The others run for real, in this environment."""
    words = shlex.split(command)
    if words[0] == "make":
        words.insert(1, "--dry-run")
    else:
        assert words[:2] == [".venv/bin/python", "run.py"]
        words = [sys.executable, str(ROOT / "run.py"), *words[2:]]
        words = [str(ROOT / word) if word.startswith("config/") else word for word in words]
        words += [] if "--record" in words else ["--record", "run.rrd"]
        words += [] if "--duration" in words else ["--duration", "60"]  # as they stand they only take longer
    cwd = ROOT if words[0] == "make" else tmp_path
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_files_that_the_readme_names_exist():
    for name in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / name).exists(), name


def test_the_generated_files_are_what_the_code_says():
    for name, text in generated().items():
        assert (ROOT / name).read_text() == text, f"{name} is stale: make docs"


def test_the_map_of_the_code_names_every_package():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    packages = {
        path.parent.relative_to(ROOT).as_posix() for folder in ("orchard", "processes") for path in ROOT.glob(f"{folder}/**/__init__.py")
    }
    assert [package for package in packages - {"orchard"} if f"`{package}/`" not in text] == []


def test_each_package_says_what_it_holds():
    for path in ROOT.glob("orchard/**/__init__.py"):
        assert ast.get_docstring(ast.parse(path.read_text())), path


def test_every_dependency_has_a_reason():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## Dependencies, and why")[1]
    named = {name for line in table.splitlines() if line.startswith("| ") for name in line.split("|")[1].strip().split(", ")}
    assert {re.split(r"[=<>\[]", line)[0] for line in wanted} <= named
