"""Packages that are left out: their commands say so, and all else works."""

import importlib.util
import sys

import pytest
from called import called

from orchard.commands import main
from orchard.terminal import catalogue
from orchard.terminal.catalogue import COMMANDS
from orchard.terminal.group import command_of


def leave_out(package, monkeypatch):
    """Let Python find all packages except this one, as if its folder had been removed."""

    def find_spec(name):
        return None if name == package else importlib.util.find_spec(name)

    monkeypatch.setattr(catalogue, "find_spec", find_spec)
    for name in list(sys.modules):
        if name == package or name.startswith(f"{package}."):
            monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize("package", ["orchard.study", "orchard.app", "orchard.bags"])
def test_a_command_of_a_package_that_is_left_out_says_so(package, monkeypatch):
    leave_out(package, monkeypatch)
    commands = [name for name, entry in COMMANDS.items() if entry.package == package]
    assert commands
    for name in commands:
        done = called(name)
        assert done.exit_code == 2
        assert f"this installation lacks {package}" in done.stderr


@pytest.mark.parametrize("package", ["orchard.study", "orchard.app", "orchard.bags"])
def test_all_other_commands_load_without_a_package(package, monkeypatch):
    entries = {name: entry for name, entry in COMMANDS.items() if entry.is_here}
    leave_out(package, monkeypatch)
    assert "layout" in entries
    for name, entry in entries.items():
        if entry.package != package:
            assert command_of(name, entry) is not None


def test_the_help_lists_only_commands_that_are_here(monkeypatch):
    leave_out("orchard.study", monkeypatch)
    text = main._harvest_help()
    assert "  layout" in text
    assert "  study" not in text
    assert main.app.list_commands(None).count("benchmark") == 0


def test_the_export_of_roads_says_that_its_package_is_left_out(monkeypatch):
    leave_out("orchard.roads", monkeypatch)
    done = called("layout", "export", "--lif", "map.json")
    assert done.exit_code == 2
    assert "this installation lacks orchard.roads" in done.stderr


TABLE = ("harvest", "--mode", "local", "--duration", 1, "--record", "none", "--table", "tables")


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("pyarrow", "--table needs the package pyarrow: pip install 'orchard-sim[tables]'"),
        ("orchard.tables", "--table: this installation lacks orchard.tables"),
    ],
)
def test_tables_without_what_writes_them_are_refused(missing, words, monkeypatch, tmp_path, capfd):
    monkeypatch.chdir(tmp_path)
    for name in list(sys.modules):
        if name.startswith("orchard.tables"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    assert called(*TABLE).exit_code == 2
    assert words in capfd.readouterr().err
    assert not (tmp_path / "tables").exists()


def test_a_folder_with_nothing_but_a_cache_is_no_package(monkeypatch):
    """Of a removed package a cache may remain, and Python finds a package without a file."""
    entry = catalogue.CommandEntry("tests_of_nothing.commands", "study", "")
    monkeypatch.setattr(
        catalogue, "find_spec", lambda name: importlib.util.spec_from_loader(name, None)
    )
    assert not entry.is_here
