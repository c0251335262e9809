"""Where a run's recording, summary and page go: what cannot be is told before the harvest, not after it."""

import socket

import pytest
from command_line import orchard
from fleet import Process

from orchard.launch.runs import Runs

SHORT = ("--rows", 3, "--mode", "local", "--duration", 1)


@pytest.mark.parametrize("option", ["--record", "--summary"])
def test_a_directory_in_place_of_a_file_is_told_before_the_harvest(option, tmp_path):
    done = orchard(*SHORT, *(() if option == "--record" else ("--record", "none")), option, tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{tmp_path}: cannot be written: Is a directory")
    assert tmp_path.is_dir()


def test_a_summary_in_no_directory_is_told_before_the_harvest(tmp_path):
    done = orchard(*SHORT, "--record", "none", "--summary", tmp_path / "nowhere" / "summary.json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "No such file or directory" in done.stderr


def test_a_run_that_is_refused_leaves_what_was_there(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("of an earlier run")
    assert orchard(*SHORT, "--record", tmp_path, "--summary", summary).returncode == 2
    assert summary.read_text() == "of an earlier run"


@pytest.mark.parametrize(("name", "told"), [("notes.txt", "ends in .rrd"), ("notes.rrd", "this file is no recording")])
def test_a_recording_replaces_no_file_that_is_none(name, told, tmp_path):
    notes = tmp_path / name
    notes.write_text("a year's work")
    with pytest.raises(ValueError, match=told):
        Runs(tmp_path).recording(str(notes))
    assert notes.read_text() == "a year's work"


def test_a_recording_replaces_one_and_an_empty_file(recording, tmp_path):
    old = tmp_path / "run.rrd"
    for content in (recording.read_bytes(), b""):
        old.write_bytes(content)
        assert Runs(tmp_path).recording(str(old)) == old


def test_a_logger_replaces_no_file_that_is_no_recording(tmp_path):
    notes = tmp_path / "notes.txt"
    notes.write_text("a year's work")
    code, _, said = Process("processes.logger", "--connect", "tcp/127.0.0.1:9", "--record", str(notes)).end()
    assert (code, notes.read_text()) == (2, "a year's work")
    assert "ends in .rrd" in said


def test_a_full_disk_loses_the_summary_but_not_what_is_printed():
    done = orchard(*SHORT, "--record", "none", "--summary", "/dev/full")
    assert done.returncode == 1
    assert "The harvest" in done.stdout
    assert done.stderr == "/dev/full: not written: No space left on device\n"


@pytest.mark.parametrize("offset", [0, 1], ids=["page", "data"])
def test_a_page_at_a_port_in_use_is_told_before_the_harvest(offset):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = orchard(*SHORT, "--record", "none", "--web", port - offset)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"tcp/127.0.0.1:{port}: cannot listen there; the port is in use" in done.stderr


def test_the_help_names_the_other_commands():
    assert "view, app, stop, reset, secure" in orchard("--help").stdout
