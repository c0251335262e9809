"""The ways to start `orchard`: what a run in local mode loads, where runs are kept, how the program
is called again.

A user starts it as `run.py`, as `python -m orchard` or as the installed command.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from code_blocks import ROOT
from command_line import python
from patience import PATIENCE

from orchard.commands import main as commands
from orchard.folders import runs_folder
from orchard.security.identity import certificates
from orchard.terminal import typed as terminal

# A program that runs in local mode, and prints the modules that it has loaded.
LOADS = """\
import sys
from orchard.__main__ import main
sys.argv = ["orchard", "--mode", "local", "--rows", "3", "--duration", "1", "--record", "none"]
try:
    main()
finally:
    print("loaded:", *sorted(sys.modules))
"""


def test_a_run_in_local_mode_loads_nothing_that_it_does_not_need(tmp_path):
    """The run keeps its snapshots in the folder that ORCHARD_RUNS names."""
    done = python("-c", LOADS, cwd=tmp_path, ORCHARD_RUNS=str(tmp_path / "runs"))
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "numba" in loaded
    assert not loaded & {
        "zenoh",
        "rerun",
        "rerun_bindings",
        "rerun_cli",
        "nicegui",
        "cryptography",
        "pyarrow",
        "rosbags",
        "scipy.linalg",
    }
    (snapshots,) = (tmp_path / "runs").iterdir()
    assert snapshots.suffix == ".snapshots"


def test_runs_are_kept_in_the_clone_or_with_the_data_of_the_user(tmp_path, monkeypatch):
    """An installed package keeps them with the user's data, unless the user names a folder."""
    monkeypatch.delenv("ORCHARD_RUNS", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert runs_folder() == ROOT / "runs"
    assert runs_folder(tmp_path / "site-packages").is_relative_to(
        tmp_path if sys.platform == "linux" else Path.home()
    )
    monkeypatch.setenv("ORCHARD_RUNS", "own")
    assert runs_folder() == Path.cwd() / "own"


# What a clone needs to run.
PARTS = ("orchard", "processes", "config", "bridges", "run.py", "pyproject.toml")


def unzipped(folder):
    """Copy the clone to a folder, by a zip that Python unpacks: links become files of text.

    So it is with Git, too, where it has no `core.symlinks`. The compiled kernels are copied too:
    they would take two minutes.
    """
    packed = folder.with_suffix(".zip")
    with zipfile.ZipFile(packed, "w") as archive:
        for part in (ROOT / name for name in PARTS):
            for path in [part, *part.rglob("*")]:
                name = path.relative_to(ROOT)
                if path.is_symlink():
                    archive.writestr(str(name), str(path.readlink()))
                elif path.is_file() and path.suffix != ".pyc":
                    archive.write(path, name)
    with zipfile.ZipFile(packed) as archive:
        archive.extractall(folder)


# A program that prints where three packages or modules lie that are found under other names.
WHERE = """\
import importlib
names = ("orchard.config", "orchard.processes.agents", "orchard.bags.plain.topics")
modules = map(importlib.import_module, names)
places = [module.__spec__.submodule_search_locations or [module.__file__] for module in modules]
print(*(next(iter(place)) for place in places))
"""


@pytest.mark.parametrize(
    "words", [["run.py", "--mode", "local"], ["-m", "orchard", "--mode", "lockstep"]]
)
def test_each_door_of_a_clone_works_without_links(words, tmp_path):
    """The clone is copied, so that this one keeps its own runs."""
    unzipped(tmp_path / "clone")
    there = {key: value for key, value in os.environ.items() if key != "ORCHARD_RUNS"}

    def done(*arguments):
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path / "clone",
            env=there,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
            timeout=PATIENCE,
        ).stdout

    folders = [Path(path) for path in done("-c", WHERE).split()]
    assert [path.is_relative_to(tmp_path) for path in folders] == [True] * 3
    done(*words, "--rows", "3", "--duration", "1")
    assert len(list((tmp_path / "clone" / "runs").glob("*.rrd"))) == 1


# What a user started, and how the program tells to start it again.
CALLED_BY = [
    ("{folder}/run.py", "venv/python run.py"),
    ("{folder}/orchard/__main__.py", "venv/python -m orchard"),
    ("{folder}/venv/orchard", "venv/orchard"),
    ("/found/orchard", "orchard"),
]


@pytest.mark.parametrize(("started", "typed"), CALLED_BY)
def test_the_program_tells_how_it_is_called_again(started, typed, tmp_path, monkeypatch):
    """Paths are relative to the working folder, and a command on the path has its name only."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "venv" / "python"))
    monkeypatch.setattr(shutil, "which", {"orchard": "/found/orchard"}.get)
    monkeypatch.setattr(sys, "argv", [started.format(folder=tmp_path)])
    assert terminal.program() == typed


def test_the_page_tells_how_to_get_what_it_needs(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    monkeypatch.delitem(sys.modules, "orchard.app.serve", raising=False)
    monkeypatch.setattr(sys, "argv", ["orchard", "app"])
    with pytest.raises(SystemExit, match="2"):
        commands.main()
    assert (
        "The page needs the package nicegui: pip install 'orchard-sim[app]'"
        in capsys.readouterr().err
    )


def test_certificates_tell_how_to_get_what_they_need(monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    monkeypatch.delitem(sys.modules, "orchard.security.certificates", raising=False)
    with pytest.raises(
        ValueError,
        match=r"cryptography is missing; certificates need it: pip install 'orchard-sim\[secure\]'",
    ):
        certificates()
