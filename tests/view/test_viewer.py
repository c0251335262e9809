"""Rerun's own program is found in one way, whoever needs it: what RERUN_CLI_PATH names, or what
came with the package.
"""

import json
import re
import subprocess
import sys
from http.client import HTTPConnection
from pathlib import Path

import pytest
from command_line import ROOT, orchard, python
from page_server import wait_for
from patience import PATIENCE

from orchard.launch.supervisor import open_viewer
from orchard.view.files import HEAD, viewer_program
from orchard.view.reader import optimize
from orchard.view.web import address, command, free_pair, serve_web

RUN = ROOT / "run.py"
# A program in place of Rerun's: it writes down its arguments. If it is to pack a recording, it
# writes a file, too.
STAND_IN = f"""#!{sys.executable}
import json, pathlib, sys
words = sys.argv[1:]
pathlib.Path(__file__).with_name("words.json").write_text(json.dumps(words))
if "-o" in words:
    pathlib.Path(words[-1]).write_text("packed")
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> Path:
    """Let STAND_IN be Rerun's program, and let there be a screen. Return its file."""
    program = tmp_path / "viewer"
    program.write_text(STAND_IN)
    program.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(program))
    monkeypatch.setenv("DISPLAY", ":0")
    return program


def arguments_of(stand_in: Path) -> list[str]:
    """Return the arguments with which the stand-in was started."""
    return json.loads(stand_in.with_name("words.json").read_text())


def test_without_the_variable_it_is_the_one_of_the_package(monkeypatch):
    monkeypatch.delenv("RERUN_CLI_PATH", raising=False)
    done = subprocess.run(
        [viewer_program(), "--version"], capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0
    assert "rerun" in done.stdout


def test_a_recording_is_packed_by_the_program_of_the_variable(stand_in, tmp_path):
    recording = tmp_path / "run.rrd"
    recording.write_text("loose")
    optimize(recording)
    assert arguments_of(stand_in)[:2] == ["rrd", "optimize"]
    assert recording.read_text() == "packed"


DISK_FULL = (
    "Error: couldn't encode messages: No space left on device (os error 28): No space left on"
    " device (os error 28)"
)


# How the program ends, as Python, and why a recording is then not packed.
NOT_PACKED = [
    (f"sys.exit({DISK_FULL!r})", "No space left on device"),
    (
        "sys.exit('Error: it is no recording')",
        "Rerun's program has ended with exit code 1: it is no recording",
    ),
    ("os.kill(os.getpid(), 9)", "Rerun's program has ended with exit code -9"),
    ("time.sleep(30)", "Rerun's program takes longer than 2 s"),
]


@pytest.mark.parametrize(("ends", "why"), NOT_PACKED)
def test_why_a_recording_is_not_packed_is_said_in_words(stand_in, tmp_path, monkeypatch, ends, why):
    monkeypatch.setattr("orchard.view.reader.PACK_SECONDS", 2)
    stand_in.write_text(
        f"#!{sys.executable}\nimport os, sys, time\nif os.environ.get('RUST_LOG') != 'error':"
        f" sys.exit('INFO')\n{ends}\n"
    )
    with pytest.raises(
        OSError,
        match=re.escape(f"run.rrd: it stays as it was recorded, neither packed nor repaired: {why}")
        + "$",
    ):
        optimize(tmp_path / "run.rrd")


def test_a_recording_is_opened_by_it_with_all_its_parts(stand_in, tmp_path):
    parts = [tmp_path / "run.rrd", tmp_path / "run.part2.rrd"]
    for part in parts:
        part.write_bytes(HEAD)
    orchard("view", parts[0])
    assert arguments_of(stand_in) == [
        "--bind",
        "127.0.0.1",
        *map(str, parts),
    ], "and no other machine can send it data"


def test_a_live_run_is_shown_by_it_in_a_window_and_to_browsers(stand_in):
    open_viewer("rerun+http://127.0.0.1:9/proxy").wait(PATIENCE)
    assert arguments_of(stand_in) == [
        "--bind",
        "127.0.0.1",
        "rerun+http://127.0.0.1:9/proxy",
    ], "and no other machine can send it data"
    assert command(9090, "what")[0] == str(stand_in)


@pytest.mark.parametrize(
    "words", [("view",), ("--mode", "local", "--duration", 1, "--record")], ids=["view", "a run"]
)
def test_a_variable_that_names_no_program_is_told_at_once(monkeypatch, tmp_path, words):
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "nothing"))
    recording = tmp_path / "run.rrd"
    recording.write_bytes(HEAD)
    done = orchard(*words, recording, code=2)
    assert f"RERUN_CLI_PATH={tmp_path}/nothing: no such program" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    "words",
    [("view",), ("--mode", "local", "--duration", 1, "--view", "--record")],
    ids=["view", "a run"],
)
def test_without_a_screen_a_browser_is_offered_at_once(stand_in, monkeypatch, tmp_path, words):
    monkeypatch.delenv("DISPLAY")
    recording = tmp_path / "run.rrd"
    recording.write_bytes(HEAD)
    done = orchard(*words, recording, code=2)
    assert "no screen" in done.stderr
    assert "--web 9090" in done.stderr
    assert not stand_in.with_name("words.json").exists(), "nothing was opened"


# A path and headers that a browser asks with; the status of the answer, and from which page it may
# be read.
ASKED = [
    ("/a%20run.rrd", {}, (200, None)),
    ("/a%20run.rrd", {"Origin": "http://127.0.0.1:9"}, (200, "http://127.0.0.1:9")),
    ("/a%20run.rrd", {"Origin": "http://attacker.example"}, (200, None)),
    ("/a%20run.rrd", {"Host": "attacker.example:9"}, (404, None)),
    ("/other.rrd", {}, (404, None)),
    ("/", {}, (404, None)),
]


@pytest.mark.parametrize(("path", "headers", "answers"), ASKED)
def test_a_recording_is_read_on_this_machine_only(stand_in, tmp_path, path, headers, answers):
    """It is read whole, and nothing beside it is."""
    stand_in.write_text(f"#!{sys.executable}\nimport time\ntime.sleep({PATIENCE})\n")
    for name in ("a run.rrd", "a run.part2.rrd", "other.rrd"):
        (tmp_path / name).write_text(name)
    port = free_pair()
    with serve_web(port, str(tmp_path / "a run.rrd"), str(tmp_path / "a run.part2.rrd")) as server:
        wait_for(server, address(port, "a run.rrd"))
        link = HTTPConnection("127.0.0.1", port + 1, timeout=PATIENCE)
        link.request("GET", path, headers=headers)
        answer = link.getresponse()
        assert (answer.status, answer.getheader("Access-Control-Allow-Origin")) == answers
        assert answer.status != 200 or answer.read() == b"a run.rrda run.part2.rrd"
        link.close()
        server.terminate()


def test_a_recording_is_served_over_ssh_too(stand_in, monkeypatch, tmp_path):
    """On a machine without a screen that is reached by ssh, the command to forward the ports is
    told. A server that fails is named.
    """
    monkeypatch.setenv("SSH_CONNECTION", "192.0.2.1 50000 192.0.2.2 22")
    monkeypatch.delenv("DISPLAY")
    port = free_pair()
    (tmp_path / "run.rrd").write_bytes(HEAD)
    done = python(RUN, "view", "run.rrd", "--web", port, cwd=tmp_path)
    assert arguments_of(stand_in) == command(port, "run.rrd")[1:]
    assert arguments_of(stand_in)[-1] == f"http://127.0.0.1:{port + 1}/run.rrd"
    assert f"http://127.0.0.1:{port}/" in done.stdout
    assert f"-L {port}:127.0.0.1:{port} -L {port + 1}:127.0.0.1:{port + 1} 192.0.2.2" in done.stdout
    stand_in.write_text(f"#!{sys.executable}\nraise SystemExit(3)\n")
    done = python(RUN, "view", "run.rrd", "--web", port, code=3, cwd=tmp_path)
    assert "the web viewer has ended with exit code 3" in done.stderr


@pytest.mark.parametrize("mode", ["local", "lockstep"])
@pytest.mark.parametrize("how", ["--view", "--web"])
def test_a_viewer_that_dies_is_named_with_its_exit_code(stand_in, mode, how):
    stand_in.write_text(f"#!{sys.executable}\nraise SystemExit(3)\n")
    port = [free_pair()] if how == "--web" else []
    done = orchard(
        "--rows",
        3,
        "--mode",
        mode,
        "--hosts",
        1,
        "--duration",
        20,
        "--speed",
        10,
        "--record",
        "none",
        how,
        *port,
    )
    assert re.search(r"viewer (has )?ended with (exit )?code 3", done.stdout + done.stderr)
