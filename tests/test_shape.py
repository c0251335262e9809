"""The shape that keeps the program simple: who imports what."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OWNERS = {
    "zenoh": ["orchard/bus.py"],
    "msgspec.msgpack": ["orchard/messages.py"],
    "yaml": ["orchard/config.py"],
    "rerun": ["orchard/view/"],
    "nicegui": ["orchard/app/"],
    "cryptography": ["orchard/certificates.py"],
    "numba": ["orchard/compiled.py", "orchard/laser_kernel.py", "orchard/move_kernel.py", "orchard/boxes.py"],
}
SOURCES = sorted([*ROOT.glob("orchard/**/*.py"), *ROOT.glob("processes/*.py"), ROOT / "run.py"])


def imports_of(path: Path) -> set[str]:
    """The modules that a file imports, also those within functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize("package", OWNERS)
def test_each_foreign_package_enters_through_one_place(package):
    users = {path.relative_to(ROOT).as_posix() for path in SOURCES if any(f"{m}.".startswith(f"{package}.") for m in imports_of(path))}
    assert all(any(user.startswith(owner) for owner in OWNERS[package]) for user in users), users
    assert users


def test_the_library_knows_nothing_of_processes():
    for path in ROOT.glob("orchard/**/*.py"):
        if "orchard/app/" not in path.as_posix():
            assert not any(m.split(".")[0] in ("processes", "run") for m in imports_of(path)), path


def test_agents_know_no_world_and_no_clock():
    forbidden = {"orchard.world", "orchard.physics", "orchard.engine", "orchard.bus", "orchard.scan", "time", "random", "datetime"}
    for path in [*ROOT.glob("orchard/agents/*.py"), ROOT / "orchard/steps.py", ROOT / "orchard/doer.py", ROOT / "orchard/sense.py"]:
        assert not forbidden & imports_of(path), path
