"""The store: what is there is not lost, not run again, and not mixed with other versions; no other
file is touched.

A store is a file of SQLite with the records of runs. The key of a record is a hash of all that
decides the run: the scenario, the seed, the model, the version of the program, own classes.
"""

import sqlite3
import time
from contextlib import closing

import pytest

from orchard.field.scenario import Scenario, with_changes
from orchard.study import runs, store
from orchard.study.options import StudyOptions
from orchard.study.runs import PlannedRun
from orchard.study.store import Store, StoreError, StoreFailed
from orchard.study.study import study

SCENARIO = Scenario(rows=3, people={"workers": 0, "visitors": 0}, animals={"dogs": 0, "cats": 0})


@pytest.fixture(scope="module")
def record():
    """Return the record of a run."""
    return PlannedRun(SCENARIO, "fast").do(time.time() + 100.0)


@pytest.fixture
def path(tmp_path, record):
    """Return the file of a store that has the record."""
    with Store(tmp_path / "studies.db") as made:
        made.keep(record)
    return made.path


def test_a_store_may_be_named_by_a_text(path):
    assert StudyOptions(store=str(path)).store_file == path


def execute(path, statement):
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(statement)


def test_a_run_is_kept_once_and_found_again(tmp_path, record):
    path = tmp_path / "new" / "studies.db"
    with Store(path) as first:
        first.keep(record)
        first.keep(record)
    with Store(path) as again:
        assert again.known([record.key, "another"]) == {record.key: record}
        assert again.known([]) == {}


def test_many_keys_are_looked_up(path, record):
    """SQLite takes a limited number of values in one question."""
    with Store(path) as many:
        assert list(many.known([*map(str, range(2000)), record.key])) == [record.key]


def test_a_store_of_another_version_is_forgotten_if_asked(path, record, monkeypatch):
    """A store of another version is refused by name. With --anew its runs are forgotten.

    With --anew a store of the same version keeps its runs.
    """
    monkeypatch.setattr(store, "software", lambda: "9.9.9+abc")
    with pytest.raises(
        StoreError,
        match=(
            r"studies\.db: is a store of version .*, and this is 9\.9\.9\+abc; --anew forgets its"
            r" runs"
        ),
    ):
        Store(path)
    monkeypatch.undo()
    with Store(path, anew=True) as same:
        assert same.known([record.key])
    monkeypatch.setattr(store, "software", lambda: "9.9.9+abc")
    with Store(path, anew=True) as other:
        assert other.known([record.key]) == {}


@pytest.mark.parametrize("content", ["database", b"rows: 3\n", b""])
def test_a_file_that_is_no_store_stays_as_it_is(tmp_path, content):
    path = tmp_path / "mine.db"
    if content == "database":
        execute(path, "CREATE TABLE mine (x)")
    else:
        path.write_bytes(content)
    before = path.read_bytes()
    for anew in (False, True):
        with pytest.raises(
            StoreError, match=r"mine\.db: is no store of a study; it stays as it is"
        ):
            Store(path, anew)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("broken_by", "told"),
    [
        ("DELETE FROM software", "is no store of a study"),
        ("DROP TABLE runs", "the runs in it cannot be read: no such table"),
    ],
)
def test_a_store_that_another_program_has_changed_is_told(path, record, broken_by, told):
    execute(path, broken_by)
    with (
        pytest.raises((StoreError, StoreFailed), match=rf"studies\.db: {told}"),
        Store(path) as again,
    ):
        again.known([record.key])


def test_a_store_that_fits_on_no_disk_leaves_nothing(tmp_path, monkeypatch):
    def fill(store, half):
        half.write_bytes(b"SQLite")
        raise sqlite3.OperationalError("disk I/O error")

    monkeypatch.setattr(Store, "_fill", fill)
    with pytest.raises(StoreError, match=r"full\.db: cannot be used as a store: disk I/O error"):
        Store(tmp_path / "full.db")
    assert [*tmp_path.iterdir()] == []


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot be used as a store"):
        Store(tmp_path / "file" / "studies.db")


def test_the_key_holds_all_that_decides_and_nothing_else(tmp_path, monkeypatch):
    """A price changes no run, so it is not in the key."""
    run = PlannedRun(SCENARIO, "fast")
    others = [
        PlannedRun(with_changes(SCENARIO, carriers=2), "fast"),
        PlannedRun(SCENARIO, "full"),
        PlannedRun(SCENARIO, "fast", "long"),
        PlannedRun.of(SCENARIO, 7, "fast", "harvest"),
    ]
    assert len({one.key for one in [run, *others]}) == 5
    assert PlannedRun(with_changes(SCENARIO, prices={"per_bin": 3.0}), "fast").key == run.key
    monkeypatch.setattr(runs, "software", lambda: "9.9.9")
    assert PlannedRun(SCENARIO, "fast").key != run.key


def test_the_key_holds_the_source_of_a_policy_of_the_users_own(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    source = "class Mine:\n    Memory = dict\n"
    keys = []
    for name, text in (("one", source), ("two", source), ("three", source + "    early = True\n")):
        (tmp_path / f"policy_{name}.py").write_text(text)
        keys.append(
            PlannedRun(with_changes(SCENARIO, dispatch=f"policy_{name}.Mine"), "fast").own_source
        )
    assert keys[0] == keys[1] != keys[2]
    assert PlannedRun(SCENARIO, "fast").own_source == ""


def test_the_key_holds_the_users_files_and_no_library(tmp_path, monkeypatch):
    """The key holds the text of each file of the user that the policy imports, and no library.

    Files are imported with their package, by a relative path, one by the other, and in a function.
    `plot_other.py` is imported by none.
    """
    monkeypatch.syspath_prepend(tmp_path)
    files = {
        "plot_policy.py": (
            "import json, numpy\nimport plot.rules\nclass Mine: pass\ndef late():\n    from"
            " plot_late import MOST\n"
        ),
        "plot/__init__.py": "",
        "plot/rules.py": (
            "from . import limits\nfrom .limits import MOST\nfrom orchard import Scenario\n"
        ),
        "plot/limits.py": "import plot_policy\nMOST = 3\n",
        "plot_late.py": (
            "try:\n    from .near import MOST\nexcept ImportError:  # it is in no package\n    MOST"
            " = 3\n"
        ),
        "plot_other.py": "MOST = 3\n",
    }
    (tmp_path / "plot").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    known = runs.own_source((("dispatch", "plot_policy.Mine"),))
    assert sorted(known) == sorted(
        text.encode() for name, text in files.items() if name != "plot_other.py"
    )


def test_a_store_made_at_the_same_time_is_used(tmp_path, record, monkeypatch):
    """Another study makes the same store after this one has seen that there is none, and keeps a
    run before this one is ready. This one uses it.
    """
    path = tmp_path / "studies.db"
    other = []
    made = Store._made

    def late(self):
        monkeypatch.setattr(Store, "_made", made)
        other.append(Store(path))
        other[0].keep(record)
        return made(self)

    monkeypatch.setattr(Store, "_made", late)
    with Store(path) as this, other[0]:
        assert this.known([record.key])
    assert [file.name for file in tmp_path.iterdir()] == ["studies.db"]


# A change of a row of the store, by another program, and what is told of it.
DAMAGES = [
    ("bins_per_hour = 'many'", "Expected `float`, got `str` - at `$.bins_per_hour`"),
    ("bins_per_hour = 9e999", "Expected `float` < 1000000000000.0 - at `$.bins_per_hour`"),
    ("bins_per_hour = -1.0", "Expected `float` >= 0.0 - at `$.bins_per_hour`"),
    ("bins_per_hour = 1e-300", "bins_per_hour = 1e-300 of a run that has not jammed"),
    ("bound_bins_per_hour = 0", "Expected `float` >= 1e-06 - at `$.bound_bins_per_hour`"),
    ("bins = 2.5", "Expected `int`, got `float` - at `$.bins`"),
    ("sim_seconds = x'00ff'", "Expected `float`, got `bytes` - at `$.sim_seconds`"),
    ("policy = cast(x'ff' AS TEXT)", "Expected `str`, got `bytes` - at `$.policy`"),
    ("ended = 'won'", "Invalid enum value 'won' - at `$.ended`"),
    ("seed = -7", "these are not the values of the run with its key"),
]


@pytest.mark.parametrize(("change", "told"), DAMAGES)
def test_a_damaged_run_is_named_and_passed_over(path, record, change, told):
    execute(path, f"UPDATE runs SET {change}")
    with Store(path) as damaged:
        assert damaged.known([record.key]) == {}
        assert damaged.damaged == {record.key: told}


def test_a_damaged_run_is_told_and_done_again(path, record):
    execute(path, "UPDATE runs SET bins_per_hour = 'many'")
    found = study(
        SCENARIO, {}, StudyOptions(model="fast", horizon="harvest", store=path, workers=1)
    )
    assert [note for note in found.notes if "studies.db: 1 of the runs in it were damaged" in note]
    with Store(path) as mended:
        assert mended.known([record.key])[record.key].bins_per_hour == record.bins_per_hour
