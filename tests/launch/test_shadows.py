"""Files in the working folder never take the place of Python's own modules, and run only if a class
there is named.

Real processes, as a user starts them.
"""

import pytest
from command_line import ROOT, python, summary_of

# Names of Python's own modules, of packages, of what Python runs at its start if it finds it, and
# of what libraries use if it is there.
NAMES = (
    "random",
    "queue",
    "types",
    "ast",
    "numpy",
    "lazy_loader",
    "sitecustomize",
    "usercustomize",
    "colorama",
)
# A module that leaves the file `ran` beside it when something imports it.
RUNS = "from pathlib import Path\nPath(__file__).with_name('ran').write_text(__name__)\n"
# A module of the user's own with a class of agents. It notes which `queue` and `random` it gets.
OWN = """\
import queue
import random
from pathlib import Path

from orchard import Action

Path(__file__).with_name("imported").write_text(f"{queue.__file__} {random.__file__}")


class Rester:
    Memory = dict

    def __init__(self, layout, name):
        pass

    def tick(self, observation, mail, memory):
        return Action(memory=memory, doing="resting")
"""
SHORT = ("--rows", 3, "--duration", 1, "--hosts", 1)


@pytest.fixture
def folder(tmp_path):
    """Return a working folder with files that have the names of modules."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(RUNS)
    (tmp_path / "zenoh").mkdir()
    (tmp_path / "zenoh" / "__init__.py").write_text(RUNS.replace("(__file__)", "(__file__).parent"))
    return tmp_path


def run(folder, *arguments: object) -> dict:
    """Run `orchard` in a folder. Return its summary. No file there may have run."""
    summary = folder / "summary.json"
    python(ROOT / "run.py", *arguments, "--summary", summary, cwd=folder)
    assert not (folder / "ran").exists(), (folder / "ran").read_text()
    return summary_of(summary)


def test_a_run_of_many_processes_runs_no_shadowing_module(folder):
    assert run(folder, *SHORT, "--record", folder / "run.rrd")["ticks"] == 10
    assert (folder / "run.rrd").stat().st_size > 0


def test_a_study_begins_beside_them_and_runs_none(folder):
    words = ("--vary", "rows=3", "--vary", "carriers=1", "--horizon", "harvest")
    answer = run(folder, "study", *words, "--budget", "60s", "--workers", 2, "--within", "50%")
    assert answer["table"][0]["replications"] > 0


def test_python_m_orchard_begins_beside_them_and_runs_none(folder):
    python("-m", "orchard", *SHORT, "--mode", "local", "--record", "none", cwd=folder)
    assert not (folder / "ran").exists()


def test_a_users_package_still_finds_its_own_modules(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "__init__.py").write_text("import orchard\n")
    (tmp_path / "mine" / "__main__.py").write_text("import mine.other\n")
    (tmp_path / "mine" / "other.py").write_text("from orchard import Scenario\n")
    python("-m", "mine", cwd=tmp_path)


@pytest.mark.parametrize("mode", ["lockstep", "local"])
def test_a_named_class_gets_pythons_own_modules(mode, folder):
    (folder / "rester.py").write_text(OWN)
    (folder / "own.yaml").write_text("rows: 3\nagents: {picker: rester.Rester}\n")
    words = ("own.yaml", "--duration", 1, "--hosts", 1, "--record", "none", "--mode", mode)
    assert run(folder, *words)["ticks"] == 10
    assert str(folder) not in (folder / "imported").read_text()
