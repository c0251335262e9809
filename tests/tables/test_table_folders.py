"""Folders of tables: what is refused there, and what is kept.

A table that grows with a run (bodies, events, messages) is a folder, NAME.parquet, with numbered
files of rows. The others (calls, exchanges, summary) are a file each. `run` and `tick` let a run
write its tables (tests/support).
"""

import errno
import os

import pytest
import typer
from command_line import orchard, python
from local_runs import SMALL
from table_runs import run, tick

from orchard.local import Local
from orchard.tables import folder as folders
from orchard.tables.folder import check_folder, complete, last_tick
from orchard.terminal.exits import exit_on_errors

SHORT = ("--rows", 3, "--mode", "local", "--duration", 1, "--record", "none")


def test_a_folder_with_tables_is_refused_and_kept(tmp_path):
    orchard(*SHORT, "--table", tmp_path / "tables")
    before = (tmp_path / "tables" / "bodies.parquet" / "000001.parquet").read_bytes()
    done = orchard(*SHORT, "--table", tmp_path / "tables", code=2)
    assert done.stdout == ""
    assert (
        done.stderr
        == f"{tmp_path}/tables: tables of a run are there, and are not replaced; --table DIR names"
        " another folder\n"
    )
    assert (tmp_path / "tables" / "bodies.parquet" / "000001.parquet").read_bytes() == before


@pytest.mark.parametrize("name", ["events", "messages", "calls", "exchanges", "summary"])
def test_a_file_with_the_name_of_a_table_is_refused_and_kept(name, tmp_path):
    own = tmp_path / f"{name}.parquet"
    own.write_text("a year's work")
    with pytest.raises(ValueError, match=rf"{name}.parquet: it has the name of a table"):
        check_folder(tmp_path, SMALL)
    with pytest.raises(ValueError, match="--table DIR names another folder"):
        check_folder(tmp_path, SMALL, 5)
    assert own.read_text() == "a year's work"


def test_files_of_a_user_beside_the_rows_of_a_table_stay(tmp_path):
    table = tmp_path / "bodies.parquet"
    local = Local(SMALL)
    run(local, tmp_path, 20).close()
    names = ("notes.new", ".notes.txt.12.new", "notes.parquet")
    for name in names:
        (table / name).write_text("a year's work")
    run(Local.resume(local.snapshot()), tmp_path, 30).close()
    assert [(table / name).read_text() for name in names] == ["a year's work"] * 3
    assert last_tick(tmp_path) == 30


def test_physics_started_by_hand_replaces_no_tables(tmp_path):
    run(Local(SMALL), tmp_path, 5).close()
    done = python("-m", "orchard.processes.physics", "--table", tmp_path, code=2)
    assert "tables of a run are there, and are not replaced" in done.stderr
    assert last_tick(tmp_path) == 5


def test_a_file_in_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "tables").write_text("")
    with pytest.raises(
        OSError,
        match=(
            "tables: tables cannot be written there: File exists; --table DIR names another folder"
        ),
    ):
        check_folder(tmp_path / "tables", SMALL)


@pytest.mark.parametrize("fault", [errno.EACCES, errno.EROFS], ids=["no right", "read-only"])
def test_a_folder_that_can_only_be_read_is_told_in_words(tmp_path, monkeypatch, capsys, fault):
    def refuse(path, *_, **__):
        raise OSError(fault, os.strerror(fault), str(path))

    monkeypatch.setattr(type(tmp_path), "touch", refuse)
    with pytest.raises(typer.Exit) as end, exit_on_errors(OSError):
        check_folder(tmp_path / "new", SMALL)
    assert end.value.exit_code == 2
    why = f"tables cannot be written there: {os.strerror(fault)}; --table DIR names another folder"
    assert capsys.readouterr().err == f"{tmp_path}/new: {why}\n"


def test_tables_that_do_not_fit_a_resumed_run_are_refused(tmp_path):
    """The tables end at tick 5. A run that goes on later would leave a gap; and if they are those
    of a run that has ended, one that goes on earlier would remove rows.
    """
    run(Local(SMALL), tmp_path, 5).close()
    check_folder(tmp_path, SMALL, 5)
    with pytest.raises(
        ValueError,
        match=(
            "the tables there end at tick 5, and the run goes on at tick 6: rows would be missing"
        ),
    ):
        check_folder(tmp_path, SMALL, 6)
    with pytest.raises(ValueError, match="the tables there are of another scenario"):
        check_folder(tmp_path, SMALL.model_copy(update={"seed": 7}), 5)
    complete(tmp_path, {"ticks": 5, "scenario": {}})
    check_folder(tmp_path, SMALL, 5)
    with pytest.raises(
        ValueError,
        match=(
            "are of a run that ended at tick 5, and this one goes on at tick 4: its rows would be"
            " lost"
        ),
    ):
        check_folder(tmp_path, SMALL, 4)
    (tmp_path / "bodies.parquet" / "000001.parquet").write_text("no table")
    with pytest.raises(ValueError, match="the tables there cannot be read"):
        check_folder(tmp_path, SMALL, 5)


def test_a_full_disk_is_logged_once_and_told_at_the_end(tmp_path, monkeypatch, caplog):
    local = Local(SMALL)
    tables = run(local, tmp_path, 5)
    tables.flush()

    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(folders, "write_whole", refuse)
    tick(local, tables)
    tables.flush()
    tick(local, tables)
    tables.close()
    monkeypatch.undo()
    (line,) = [record.getMessage() for record in caplog.records]
    assert (
        line
        == f"the tables in {tmp_path} cannot be written: No space left on device; the run goes on"
        " without them"
    )
    assert complete(tmp_path, {"ticks": 7, "scenario": {}}) == [
        f"{tmp_path}: the tables end at tick 5, and the run at tick 7"
    ]
    assert last_tick(tmp_path) == 5
