"""Where a run's recording, summary and page go: what cannot be is told before the harvest, not
after it.
"""

import errno
import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest
import typer
from command_line import orchard, scenario_file, starting, summary_of
from fleet import Process
from patience import PATIENCE
from stage import empty_orchard

from orchard.folders import named, newest_path
from orchard.launch.run_folder import RunFolder
from orchard.launch.run_notes import end_orphaned_processes
from orchard.sim.snapshot import SnapshotError
from orchard.terminal.catalogue import COMMANDS
from orchard.terminal.exits import exit_on_errors, in_words
from orchard.terminal.files import check_writable, one_file
from orchard.terminal.options import NETWORK, ORCHARD, OUTPUT, RUN
from orchard.view.files import remove_half_packed

GROUPS = (ORCHARD, RUN, OUTPUT, NETWORK)
SHORT = ("--rows", 3, "--mode", "local", "--duration", 1)


@pytest.mark.parametrize("option", ["--record", "--summary"])
def test_a_directory_in_place_of_a_file_is_told_at_once(option, tmp_path):
    words = [*SHORT, option, tmp_path]
    if option != "--record":
        words += ["--record", "none"]
    done = orchard(*words, code=2)
    assert done.stdout == ""
    assert done.stderr.startswith(f"{tmp_path}: cannot be written: Is a directory")
    assert tmp_path.is_dir()


# A recording, the fault of the disk, and what is said of it after the folder's path.
READ_ONLY = [
    (
        "run.rrd",
        errno.EACCES,
        (
            "run.rrd: cannot be written: Permission denied; expected a file in a directory that"
            " exists and can be written"
        ),
    ),
    ("new/run.rrd", errno.EROFS, "new: cannot be made: Read-only file system"),
]


@pytest.mark.parametrize(("name", "fault", "words"), READ_ONLY)
def test_a_read_only_folder_is_told_with_the_way_out(
    name, fault, words, tmp_path, monkeypatch, capsys
):

    def refuse(path, *_, **__):
        raise OSError(fault, os.strerror(fault), str(path))

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "mkdir", lambda path, **options: path.is_dir() or refuse(path))
    with pytest.raises(typer.Exit), exit_on_errors(OSError):
        RunFolder(tmp_path).recording(str(tmp_path / name))
    assert (
        capsys.readouterr().err
        == f"{tmp_path}/{words}; --record FILE.rrd records elsewhere, --record none not at all\n"
    )


def test_an_error_of_the_system_is_told_without_its_number(tmp_path, capsys):
    with pytest.raises(typer.Exit), exit_on_errors(OSError):
        (tmp_path / "nowhere" / "roles").mkdir()
    assert capsys.readouterr().err == f"{tmp_path}/nowhere/roles: No such file or directory\n"


def test_a_run_without_snapshots_is_not_the_last_one(tmp_path):
    for name in ("first", "second"):
        (tmp_path / f"{name}.snapshots").mkdir()
    with pytest.raises(SnapshotError, match="no run there to resume"):
        RunFolder(tmp_path).snapshots("last")
    (tmp_path / "first.snapshots" / "tick-000000005.snapshot").touch()
    assert RunFolder(tmp_path).snapshots("last") == tmp_path / "first.snapshots"


def test_a_missing_folder_to_resume_is_told_and_not_made(tmp_path):
    with pytest.raises(
        SnapshotError, match="typo: no snapshots of such a run; expected the folder"
    ):
        RunFolder(tmp_path).snapshots(str(tmp_path / "typo"))
    assert not (tmp_path / "typo").exists()


def test_a_run_that_is_refused_leaves_what_was_there(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("of an earlier run")
    orchard(*SHORT, "--record", tmp_path, "--summary", summary, code=2)
    assert summary.read_text() == "of an earlier run"


@pytest.mark.parametrize(
    ("name", "words"), [("notes.txt", "ends in .rrd"), ("notes.rrd", "this file is no recording")]
)
def test_a_recording_replaces_no_file_that_is_none(name, words, tmp_path):
    notes = tmp_path / name
    notes.write_text("a year's work")
    with pytest.raises(ValueError, match=words):
        RunFolder(tmp_path).recording(str(notes))
    assert notes.read_text() == "a year's work"


@pytest.mark.parametrize("name", ["run.part2.rrd", "run.rrd.packing", "run.part2.rrd.packing"])
def test_a_recording_replaces_no_file_with_the_name_of_a_part(name, recording, tmp_path):
    """A recording may have parts, and while it is packed there is a file `.packing`. A user's file
    of such a name stays.
    """
    for part in ("run.rrd", "run.part2.rrd"):
        (tmp_path / part).write_bytes(recording.read_bytes())
    (tmp_path / name).write_text("a year's work")
    with pytest.raises(ValueError, match=f"{name}: this file is no recording, and is not replaced"):
        RunFolder(tmp_path).recording(str(tmp_path / "run.rrd"))
    remove_half_packed(tmp_path / "run.rrd")
    assert (tmp_path / name).read_text() == "a year's work"


def test_a_half_packed_recording_goes(recording, tmp_path):
    (tmp_path / "run.rrd").write_bytes(recording.read_bytes())
    half = tmp_path / "run.rrd.packing"
    half.write_bytes(recording.read_bytes()[:100])
    assert RunFolder(tmp_path).recording(str(tmp_path / "run.rrd")) == tmp_path / "run.rrd"
    remove_half_packed(tmp_path / "run.rrd")
    assert not half.exists()


# Files of a user that are named as the notes of runs that go on. The second one is the note of
# another run than its file's name says.
OF_OTHERS = {
    "trip.going": "Monday: to the orchard",
    "walk.going": '{"run": "another", "endpoint": "tcp/127.0.0.1:9"}',
    "list.going": "[]",
}


def test_only_notes_of_runs_are_cleared_away(tmp_path):
    for name, text in OF_OTHERS.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "gone.going").write_text('{"run": "gone", "endpoint": "tcp/127.0.0.1:9"}')
    assert not end_orphaned_processes(tmp_path, print)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == OF_OTHERS


def test_a_recording_replaces_one_and_an_empty_file(recording, tmp_path):
    old = tmp_path / "run.rrd"
    for content in (recording.read_bytes(), b""):
        old.write_bytes(content)
        assert RunFolder(tmp_path).recording(str(old)) == old


def test_a_logger_replaces_no_file_that_is_no_recording(tmp_path):
    notes = tmp_path / "notes.txt"
    notes.write_text("a year's work")
    code, _, said = Process(
        "orchard.processes.logger", "--connect", "tcp/127.0.0.1:9", "--record", str(notes)
    ).end()
    assert code == 2
    assert notes.read_text() == "a year's work"
    assert "ends in .rrd" in said


def test_a_named_pipe_is_refused_and_stdout_is_taken(tmp_path):
    """A run would wait at a named pipe until it is read. Only a summary may go to stdout."""
    pipe = tmp_path / "pipe.rrd"
    os.mkfifo(pipe)
    for option in ("--summary", "--record"):
        done = orchard(*SHORT, option, pipe, code=2)
        assert done.stdout == ""
        assert done.stderr.startswith(f"{pipe}: is a named pipe; expected a file")
    done = orchard(*SHORT, "--record", "none", "--summary", "/dev/stdout")
    assert '  "rows_picked": 0,' in done.stdout.splitlines()


def test_a_link_stays_a_link_and_a_broken_one_is_no_recording(tmp_path):
    (tmp_path / "gone.rrd").symlink_to("nowhere")
    assert newest_path(tmp_path.glob("*.rrd")) is None
    check_writable(tmp_path / "gone.rrd")
    assert (tmp_path / "gone.rrd").is_symlink()
    assert not (tmp_path / "gone.rrd").exists()


# Commands that read a FILE, and would write to LINK, which leads to it.
READERS = [
    "FILE --mode local --record none --duration 1 --summary LINK",
    "bound FILE --work 0.1 --summary LINK",
    "trace FILE --out LINK",
    "study FILE --vary carriers=1 --budget 1s --workers 1 --csv LINK --out STORE",
    "layout export FILE --lif LINK",
]


@pytest.mark.parametrize("command", READERS)
def test_the_scenario_that_is_read_is_not_written(command, tmp_path):
    """It is not written through a link either."""
    file = scenario_file(tmp_path, empty_orchard(rows=3, pickers=2, carriers=1))
    content = file.read_bytes()
    link = tmp_path / "link"
    link.symlink_to(file)
    places = {"FILE": file, "LINK": link, "STORE": tmp_path / "studies.db"}
    done = orchard(*[places.get(word, word) for word in command.split()], code=2)
    assert f"{link}" in done.stderr
    assert "cannot be written: it is the file that is read; expected another" in done.stderr
    assert file.read_bytes() == content


def test_an_error_of_a_full_disk_has_the_path_of_what_is_written(tmp_path):
    """Bags and certificates are written so. An error that has a path keeps it."""
    with pytest.raises(OSError, match="No space left") as full, named(tmp_path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert in_words(full.value) == f"{tmp_path}: No space left on device"
    with pytest.raises(FileNotFoundError) as missing, named(tmp_path):
        (tmp_path / "nowhere" / "file").write_text("")
    assert in_words(missing.value) == f"{tmp_path}/nowhere/file: No such file or directory"


def test_links_in_a_circle_are_told_in_words(tmp_path):
    circle = tmp_path / "circle.json"
    circle.symlink_to(circle)
    assert [*one_file([circle, tmp_path / "other.json"])] == []
    with pytest.raises(OSError, match=f"{circle}: cannot be written: Too many levels"):
        check_writable(circle)
    with pytest.raises(OSError, match=f"{circle}: cannot be written: .*--record none"):
        RunFolder(tmp_path).recording(str(circle.with_suffix(".json")))


def test_a_full_disk_loses_the_summary_but_not_what_is_printed():
    done = orchard(*SHORT, "--record", "none", "--summary", "/dev/full", code=1)
    assert "Ended by --duration after 0:01 min" in done.stdout
    assert done.stderr == "/dev/full: not written: No space left on device\n"


@pytest.mark.parametrize(
    "command", ["bound FILE --work 0.1 --summary /dev/full", "trace FILE --out /dev/full"]
)
def test_an_answer_that_fits_on_no_disk_is_told_with_its_path(command, tmp_path):
    """A full disk is no mistake of the user, so the exit code is 1."""
    scenario = empty_orchard(rows=3, pickers=2, carriers=1)
    file = scenario_file(tmp_path, scenario)
    done = orchard(*[file if word == "FILE" else word for word in command.split()], code=1)
    assert done.stderr == "/dev/full: not written: No space left on device\n"


def test_the_summary_is_there_before_the_recording_is_packed(tmp_path, monkeypatch):
    """The packer writes the begin of a file, and then takes ten minutes. Ctrl-C ends it, and half
    of a packed file goes.
    """
    packer = tmp_path / "packer"
    summary = tmp_path / "summary.json"
    runs = tmp_path / "runs"
    packer.write_text(
        f"#!/bin/sh\nfor last; do :; done\necho RRF2 and half of it > $last\nexec {sys.executable}"
        " -c 'import time; time.sleep(600)'\n"
    )
    packer.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(packer))
    with starting(
        "--rows",
        3,
        "--duration",
        5,
        "--hosts",
        1,
        "--record",
        runs / "run.rrd",
        "--summary",
        summary,
    ) as run:
        deadline = time.monotonic() + PATIENCE
        while not (summary.exists() and list(runs.glob("*.packing"))):
            assert run.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert summary_of(summary)["sim_seconds"] == 5.0
        run.send_signal(signal.SIGINT)
        run.wait(PATIENCE)
    assert [path.name for path in runs.iterdir()] == ["run.rrd"]
    assert summary_of(summary)["recording_parts"] == ["run.rrd"]


@pytest.mark.parametrize("offset", [0, 1], ids=["page", "data"])
def test_a_page_at_a_port_in_use_is_told_before_the_harvest(offset):
    """The data of a page are served at the port after that of the page."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = orchard(*SHORT, "--record", "none", "--web", port - offset, code=2)
    assert done.stdout == ""
    assert f"tcp/127.0.0.1:{port}: cannot listen there; the port is in use" in done.stderr


def test_the_help_names_the_other_commands_first():
    """The options follow in their groups."""
    shown = orchard("--help").stdout
    commands = [f"  {name:10}{entry.summary}" for name, entry in COMMANDS.items()]
    places = [shown.index(words) for words in (*commands, "Options", *GROUPS, "Exit code")]
    assert places == sorted(places)
    assert "--ignore-holds" not in shown, "it is for benchmarks"
