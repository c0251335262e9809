"""Rerun's own program is found in one way, whoever needs it: what RERUN_CLI_PATH names, or what came with the package."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from orchard.launch.supervisor import open_viewer
from orchard.view.files import viewer_program
from orchard.view.reader import optimize
from orchard.view.web import command, free_pair

ROOT = Path(__file__).parents[2]
SECONDS = 30.0  # that anything here may take on a busy machine
STAND_IN = f"""#!{sys.executable}
import json, pathlib, sys
words = sys.argv[1:]
pathlib.Path(__file__).with_name("words.json").write_text(json.dumps(words))
if "-o" in words:
    pathlib.Path(words[-1]).write_text("packed")
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> Path:
    """A program that only writes down what it is told, and a screen."""
    program = tmp_path / "viewer"
    program.write_text(STAND_IN)
    program.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(program))
    monkeypatch.setenv("DISPLAY", ":0")
    return program


def told(stand_in: Path) -> list[str]:
    return json.loads(stand_in.with_name("words.json").read_text())


def run_py(*words: object) -> subprocess.CompletedProcess:
    line = [sys.executable, str(ROOT / "run.py"), *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, timeout=SECONDS, env=os.environ | {"COLUMNS": "200"})


def test_without_the_variable_it_is_the_one_of_the_package(monkeypatch):
    monkeypatch.delenv("RERUN_CLI_PATH", raising=False)
    done = subprocess.run([viewer_program(), "--version"], capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0
    assert "rerun" in done.stdout


def test_a_recording_is_packed_by_the_one_that_the_variable_names(stand_in, tmp_path):
    recording = tmp_path / "run.rrd"
    recording.write_text("loose")
    optimize(recording)
    assert told(stand_in)[:2] == ["rrd", "optimize"]
    assert recording.read_text() == "packed"


def test_a_recording_is_opened_by_it_with_all_its_parts(stand_in, tmp_path):
    parts = [tmp_path / "run.rrd", tmp_path / "run.part2.rrd"]
    for part in parts:
        part.touch()
    done = run_py("view", parts[0])
    assert done.returncode == 0, done.stderr
    assert told(stand_in) == ["--bind", "127.0.0.1", *map(str, parts)], "and no other machine can send it data"


def test_a_live_run_is_shown_by_it_in_a_window_and_to_browsers(stand_in):
    open_viewer("rerun+http://127.0.0.1:9/proxy").wait(SECONDS)
    assert told(stand_in) == ["--bind", "127.0.0.1", "rerun+http://127.0.0.1:9/proxy"], "and no other machine can send it data"
    assert command(9090, "what")[0] == str(stand_in)


@pytest.mark.parametrize("words", [("view",), ("--mode", "local", "--duration", 1, "--record")], ids=["view", "a run"])
def test_a_variable_that_names_no_program_is_told_at_once(monkeypatch, tmp_path, words):
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "nothing"))
    recording = tmp_path / "run.rrd"
    recording.touch()
    done = run_py(*words, recording)
    assert done.returncode == 2
    assert f"RERUN_CLI_PATH={tmp_path}/nothing: no such program" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("words", [("view",), ("--mode", "local", "--duration", 1, "--view", "--record")], ids=["view", "a run"])
def test_without_a_screen_it_says_so_at_once_and_offers_a_browser(stand_in, monkeypatch, tmp_path, words):
    monkeypatch.delenv("DISPLAY")
    recording = tmp_path / "run.rrd"
    recording.touch()
    done = run_py(*words, recording)
    assert done.returncode == 2
    assert "no screen" in done.stderr and "--web 9090" in done.stderr
    assert "Traceback" not in done.stderr
    assert not stand_in.with_name("words.json").exists(), "nothing was opened"


def test_a_recording_is_served_to_browsers_with_all_its_parts(stand_in, monkeypatch, tmp_path):
    monkeypatch.delenv("DISPLAY")
    parts = [tmp_path / "run.rrd", tmp_path / "run.part2.rrd"]
    for part in parts:
        part.touch()
    port = free_pair()
    done = run_py("view", parts[0], "--web", port)
    assert done.returncode == 0, done.stderr
    assert f"http://127.0.0.1:{port}/" in done.stdout
    assert told(stand_in) == command(port, *map(str, parts))[1:]


def test_a_recording_beside_the_user_is_served_over_ssh_too_and_a_server_that_fails_is_told(stand_in, monkeypatch, tmp_path):
    monkeypatch.setenv("SSH_CONNECTION", "192.0.2.1 50000 192.0.2.2 22")
    (tmp_path / "run.rrd").touch()
    monkeypatch.chdir(tmp_path)
    port = free_pair()
    done = run_py("view", "run.rrd", "--web", port)
    assert told(stand_in) == command(port, str(tmp_path / "run.rrd"))[1:], "the server has another working directory"
    assert f"-L {port}:127.0.0.1:{port} -L {port + 1}:127.0.0.1:{port + 1} 192.0.2.2" in done.stdout
    stand_in.write_text(f"#!{sys.executable}\nraise SystemExit(3)\n")
    done = run_py("view", "run.rrd", "--web", port)
    assert (done.returncode, "the web viewer has ended with exit code 3" in done.stderr) == (3, True)
