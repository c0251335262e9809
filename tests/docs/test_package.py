"""What pyproject.toml says of the package: ranges and exact versions agree, and all files of the
package are in it.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from code_blocks import DOCUMENTS, blocks_in
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
# The extras that a user may install.
OF_USERS = [
    name for name in PROJECT["optional-dependencies"] if name not in ("dev", "docs", "release")
]
# Stubs for mypy: only a clone needs them, so they are not installed.
OF_A_CLONE = [ROOT / "orchard" / "processes.pyi", ROOT / "orchard" / "bags" / "plain.pyi"]
# Package -> its exact version, of constraints.txt.
PINNED = dict(re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.M))


def test_the_exact_version_of_each_dependency_is_in_its_range():
    pinned = {canonicalize_name(name): version for name, version in PINNED.items()}
    lines = [
        *PROJECT["dependencies"],
        *(line for extra in PROJECT["optional-dependencies"].values() for line in extra),
    ]
    for wanted in map(Requirement, lines):
        assert wanted.specifier.contains(pinned[canonicalize_name(wanted.name)]), wanted
        assert wanted.specifier, f"{wanted}: no range"


def test_each_extra_of_a_user_is_in_the_table_of_extras():
    how_to = (ROOT / "docs" / "how-to.md").read_text()
    assert {*re.findall(r"^\| `([\w-]+)` \|", how_to, re.M)} >= {*OF_USERS}


def test_imports_of_the_documents_come_with_a_dependency():
    """A program of a document imports only what a dependency or an extra brings.

    Programs of docs/ros2.md have the packages of ROS 2 besides, from its installation.
    """
    lines = [line for name in OF_USERS for line in PROJECT["optional-dependencies"][name]]
    brought = {Requirement(line).name for line in [*PROJECT["dependencies"], *lines]}
    programs = [
        block.text
        for document in DOCUMENTS
        for block in blocks_in(document)
        if block.language == "python" and document != "docs/ros2.md"
    ]
    imports = {
        name.split(".")[0]
        for program in programs
        for node in ast.walk(ast.parse(program))
        for name in _imported_by(node)
    }
    of_packages = packages_distributions()
    wanted = {root: of_packages.get(root, [root]) for root in imports - {*sys.stdlib_module_names}}
    # docs/extending.md installs the last one.
    known = {"orchard", "my_picker", "stable_baselines3"}
    assert {root for root, names in wanted.items() if not brought & {*names}} <= known


def _imported_by(node):
    """Return the modules that a statement imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) and node.module else []


def test_the_constraints_are_names_and_versions_only():
    lines = [
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if not line.startswith("#")
    ]
    assert len(lines) == len(PINNED)


def test_the_top_level_holds_what_the_projects_user_fixed():
    for folder in ("orchard", "processes", "config", "tests"):
        assert (ROOT / folder).is_dir() and not (ROOT / folder).is_symlink(), folder
    for file in ("pyproject.toml", "keyspace.md", "run.py", "README.md"):
        assert (ROOT / file).is_file(), file


def test_no_file_is_a_link_for_many_unpack_links_as_text():
    folders = [path for path in ROOT.iterdir() if path.is_dir() and path.name[0] != "."]
    links = [str(path) for folder in folders for path in folder.rglob("*") if path.is_symlink()]
    assert links == []


def test_import_linter_knows_every_package():
    bridges = [path.parent.name for path in ROOT.glob("bridges/*/*/__init__.py")]
    known = PYPROJECT["tool"]["importlinter"]["root_packages"]
    assert sorted(known) == sorted(["orchard", "processes", *bridges, "chaos", "bench"])


def test_every_file_of_the_package_that_is_no_code_is_installed():
    data = PYPROJECT["tool"]["setuptools"]["package-data"]
    patterns = [
        f"{package.replace('.', '/')}/{pattern}"
        for package, names in data.items()
        for pattern in names
    ]
    inside = [
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "orchard").rglob("*")
        if path.is_file() and path not in OF_A_CLONE
    ]
    beside = [f"orchard/config/{path.name}" for path in (ROOT / "config").iterdir()]
    files = [file for file in [*inside, *beside] if "__pycache__" not in file]
    assert [
        file
        for file in files
        if not file.endswith(".py") and not any(fnmatch(file, pattern) for pattern in patterns)
    ] == []


def test_all_metadata_name_the_version():
    assert f"version: {PROJECT['version']}\n" in (ROOT / "CITATION.cff").read_text()
    bridges = {
        tomllib.loads(path.read_text())["project"]["version"]
        for path in ROOT.glob("bridges/*/pyproject.toml")
    }
    assert bridges == {PROJECT["version"]}


def test_the_quick_part_of_the_suite_is_there():
    out = subprocess.run(
        ["make", "--dry-run", "quick"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert [path for path in re.findall(r"tests/\S+", out) if not (ROOT / path).exists()] == []


# What pip-audit prints of a package with a known vulnerability, and of one without.
VULNERABLE = '{"dependencies": [{"name": "pycrypto", "vulns": [{"id": "CVE-1"}]}]}'
SOUND = '{"dependencies": [{"name": "numpy", "vulns": []}]}'


@pytest.mark.parametrize(
    ("of_the_vulnerable", "of_ours", "code", "words"),
    [
        (VULNERABLE, SOUND, 0, "known of 0 of the 1 packages that were checked"),
        (
            VULNERABLE,
            SOUND.replace("[]", '[{"id": "CVE-2"}]'),
            1,
            "numpy: CVE-2: take a version without them",
        ),
        (
            VULNERABLE,
            SOUND.replace('"vulns": []', '"skip_reason": "no such page"'),
            0,
            "numpy: NOT CHECKED: no such page",
        ),
        (VULNERABLE, "", 0, "any package: NOT CHECKED: no route to the registry"),
        (
            SOUND,
            SOUND,
            0,
            (
                "NOT CHECKED, for the registry reports none of pycrypto==2.6.1, which has some: it"
                " knows of none"
            ),
        ),
        (
            "",
            SOUND,
            0,
            (
                "NOT CHECKED, for the registry reports none of pycrypto==2.6.1, which has some: no"
                " route to the registry"
            ),
        ),
    ],
)
def test_nothing_known_is_told_from_not_checked(of_the_vulnerable, of_ours, code, words, tmp_path):
    """.ci/vulnerabilities.py first asks pip-audit about an old package that is known to be
    vulnerable. If nothing is reported of it, the registry has no such data, and silence about our
    packages says nothing. Here a program that prints these answers stands in for pip-audit.
    """
    audit = tmp_path / "pip-audit"
    packages = tmp_path / "packages.txt"
    answers = f"{of_the_vulnerable!r} if 'pycrypto' in open(sys.argv[-1]).read() else {of_ours!r}"
    audit.write_text(
        f"#!{sys.executable}\nimport sys\nprint({answers})\nprint('no route to the registry',"
        " file=sys.stderr)\n"
    )
    audit.chmod(0o755)
    packages.write_text("numpy==2.4.6\n")
    output = subprocess.run(
        [sys.executable, ".ci/vulnerabilities.py", audit, packages],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert words in output.stdout
    assert output.returncode == code, output.stderr


@pytest.mark.parametrize(
    ("programs", "why"),
    [
        ({"uname": "echo riscv64"}, "this machine is riscv64"),
        ({"uname": "echo x86_64"}, "there is no apt-get or no dpkg-deb"),
        (
            {"uname": "echo x86_64", "dpkg-deb": "", "apt-get": "echo no network; exit 100"},
            "apt has no lists of packages for arm64\nno network",
        ),
    ],
    ids=lambda value: "" if isinstance(value, dict) else value[:20],
)
def test_harvests_on_arm_that_cannot_be_run_are_told(programs, why, tmp_path):
    """The machine has only these programs, which do this."""
    for name in ("bash", "dirname", "mktemp", "mkdir", "rm", "tail", "touch"):
        (tmp_path / name).symlink_to(shutil.which(name))
    for name, does in programs.items():
        (tmp_path / name).write_text(f"#!{shutil.which('bash')}\n{does}\n")
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        [shutil.which("bash"), ROOT / ".ci" / "arm"],
        env={"PATH": str(tmp_path), "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    assert done.stderr == ""
    assert done.stdout.startswith(f"NOT RUN: {why}")
    assert not any(path.is_dir() for path in tmp_path.iterdir())


@pytest.mark.parametrize("uv_can", [True, False])
def test_uv_is_told_of_pips_index_and_pip_does_the_rest(uv_can, tmp_path):
    """.ci/install tries uv first, and then pip. uv does not read pip's settings, so it gets them as
    variables of the environment. An index in the environment counts before one in a file.

    Here pip and uv are scripts that only write down their arguments; uv also writes down these
    variables, and fails unless `uv_can`.
    """
    written = tmp_path / "written"
    file = tmp_path / "pip.conf"
    file.write_text(
        "[global]\nfind-links = /other\nextra-index-url =\n    file:///b\n    file:///c\n"
    )
    fake_uv = (
        'env | grep -E "^UV_(DEFAULT_INDEX|INDEX|FIND)" | sort'
        f' >{written}; echo uv "$@" >>{written};'
        f" exit {int(not uv_can)}"
    )
    for name, text in {
        ".ci/install": (ROOT / ".ci" / "install").read_text(),
        ".venv/bin/pip": (
            f'#!/bin/sh\n[ "$1" = config ] && exec {sys.executable} -m pip "$@"; echo pip "$@"'
            f" >>{written}\n"
        ),
        ".venv/bin/uv": f"#!/bin/sh\n{fake_uv}\n",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    plain = {
        name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "UV_"))
    }
    pips_settings = {
        "PIP_CONFIG_FILE": str(file),
        "PIP_INDEX_URL": "file:///a",
        "PIP_FIND_LINKS": "/d /e",
    }
    done = subprocess.run(
        [tmp_path / ".ci" / "install", "there", "x"],
        env=plain | pips_settings,
        capture_output=True,
        text=True,
        check=True,
    )
    expected = [
        "UV_DEFAULT_INDEX=file:///a",
        "UV_FIND_LINKS=/d,/e",
        "UV_INDEX=file:///b file:///c",
        "UV_INDEX_STRATEGY=unsafe-best-match",
    ]
    expected.append("uv pip install --quiet --python there/bin/python x")
    if not uv_can:
        expected.append("pip --python there/bin/python install --quiet x")
    assert written.read_text().splitlines() == expected
    assert ("uv cannot; pip tries" in done.stderr) is not uv_can
