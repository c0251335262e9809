"""What `orchard` says of a mistake: in words, where it is, what would be right; and nothing that
controls a terminal.
"""

import errno
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from code_blocks import ROOT
from patience import PATIENCE
from run_endings import harvested

from orchard.commands import main as commands
from orchard.launch.run_folder import alone
from orchard.report.summary import sentence
from orchard.terminal.typed import typed

# A name with an escape sequence, which would make a terminal write in red.
ESCAPE = "\x1b[31mX"
# What no message may have: a control character, or words of Python and of libraries.
RAW = (
    "\x1b",
    "Traceback",
    "Input should be",
    "Value error",
    "Invalid value",
    "<bool>",
    "codec",
    "Errno",
)
# Files with mistakes, in the working folder of the commands below.
FILES = {
    "agents.yaml": "agents: {piker: my_package.MyPicker}\n",
    "nobody.yaml": "agents: {picker_99: my_package.MyPicker}\n",
    "bad.yaml": "rows: 999\npikers: 3\npeople:\n  workers: many\n",
}
NOWHERE = ("--connect", "tcp/127.0.0.1:9")
NO_RECORD = ("--record", "none")
SHORT = ("--mode", "local", "--rows", "3", "--duration", "0.1", *NO_RECORD)


def output_of(arguments, monkeypatch, capfd) -> tuple[int, str]:
    """Run a command. Return its exit code, and all that it prints, in one line."""
    monkeypatch.setattr("sys.argv", ["orchard", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        commands.main()
    out, err = capfd.readouterr()
    return ended.value.code or 0, " ".join((out + err).split())


OPTIONS_WITH_A_VALUE = (
    "--rows",
    "--row-width",
    "--mode",
    "--speed",
    "--hosts",
    "--duration",
    "--web",
    "--progress",
    "--patience",
    "--seed",
    "--dispatch",
    "--route",
    "--rows-to-pickers",
    "--resume",
    "--replay",
    "--secure",
    "--connect",
    "--listen",
    "--without",
)
# Command lines in which a user, or a program, has left an escape sequence.
CONTROLLING = [
    *([option, ESCAPE] for option in OPTIONS_WITH_A_VALUE),
    [ESCAPE],
    [f"{ESCAPE}.yaml"],
    [f"{ESCAPE}.rrd"],
    [f"--{ESCAPE}"],
    ["--only", ESCAPE, *NOWHERE],
    ["--record", f"{ESCAPE}.txt"],
    ["--record", f"/dev/null/{ESCAPE}.rrd"],
    [*SHORT, "--summary", f"/dev/null/{ESCAPE}"],
    [*SHORT, "--table", f"/dev/null/{ESCAPE}"],
    ["view", ESCAPE],
    ["export", ESCAPE, "--mcap", "a.mcap"],
    ["export", "--mcap", ESCAPE],
    ["replay", ESCAPE],
    ["stop", "--connect", ESCAPE],
    ["stop", ESCAPE, *NOWHERE],
    ["stop", "--secure", ESCAPE, *NOWHERE],
    ["step", ESCAPE],
    ["secure", "roles", ESCAPE],
    ["secure", "roles", "--role", f"{ESCAPE}=picker"],
    ["secure", "roles", "--bridge", ESCAPE],
    ["secure", "roles", "--address", ESCAPE],
    ["layout", ESCAPE],
    ["layout", "import", ESCAPE],
    ["app", "--port", ESCAPE],
    ["app", "--host", ESCAPE],
    ["app", ESCAPE],
    ["study", ESCAPE],
    ["study", "--vary", ESCAPE],
    ["study", "--goal", ESCAPE],
    ["study", "--csv", f"/dev/null/{ESCAPE}"],
]


@pytest.mark.parametrize("arguments", CONTROLLING)
def test_no_option_and_no_path_can_control_the_terminal(arguments, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    code, words = output_of(arguments, monkeypatch, capfd)
    assert (code, [raw for raw in RAW if raw in words]) == (2, []), words


# What a user types, and words of the answer.
MISTAKES = [
    (["--rows", "x"], "--rows: x: expected a whole number"),
    (["--row-width", "wide"], "--row-width: wide: expected a number"),
    (["--web", "80"], "--web: 80: expected a number from 1024 on"),
    (["--mode", "sideways"], "--mode: 'sideways' is not one of 'local', 'lockstep', 'realtime'."),
    (["replay"], "FILE.mcap is missing; see --help"),
    (["view", "a", "b"], "b: one word too many; see --help"),
    (["export"], "--mcap is missing; see --help"),
    (["--rosw", "3"], "--rosw: no such option; did you mean --rows"),
    (["stop", "--nothing"], "--nothing: no such option; see --help"),
    (["--rows"], "--rows: a value is missing; see --help"),
    (["--view=yes"], "--view: it has no value"),
    (["app", "--port", "x"], "--port: x: expected a whole number"),
    (["app", "--port", "65536"], "--port: 65536: expected a number up to 65535"),
    (
        ["study", "--vary", "carriers=130..150"],
        (
            "--vary carriers=130..150: carriers = 130, 131, 132 and 18 more: must be null or a"
            " whole number"
        ),
    ),
    (["--rows", "101"], "command line: --rows = 101"),
    (
        ["--rows", "3", "--pickers", "4"],
        "command line: --pickers = 4, --rows = 3: must be at most one picker a row",
    ),
    (["--row-width", "4.9", "--carriers", "0"], "carriers = 0"),
    (["nothing.yaml"], "nothing.yaml: no such file"),
    (["veiw", "runs/harvest.rrd"], "veiw: no such file; did you mean the command view?"),
    (["--dispatch", "nearst"], "did you mean nearest?"),
    (["runs/harvest.rrd"], "a recording, not a scenario; did you mean the command view?"),
    (["--speed", "0"], "--speed"),
    (["--hosts", "0"], "--hosts"),
    (["--duration", "-1"], "--duration"),
    (["--duration", "1e308"], "at most 6871947674"),
    (
        [
            "--only",
            "picker",
            "--connect",
            "tcp/127.0.0.1:9",
            "--seed",
            "0",
            "--resume",
            "last",
            "--mode",
            "realtime",
        ],
        "--seed, --mode",
    ),
    (["--patience", "1"], "--patience"),
    (["--patience", "1e13"], "--patience: 10000000000000.0: expected 3 to 6871947674"),
    (["--keyframes", "1e13"], "--keyframes: 1e13: expected a number up to"),
    (["--speed", "1e13"], "--speed: 1e13: expected a number above 0"),
    (
        ["--record", "runs/a.part2.rrd"],
        "a.part2.rrd: a further part of another recording has such a name",
    ),
    (["--summary", "/nowhere/at/all.json"], "/nowhere/at"),
    (["view", "nothing.rrd"], "nothing.rrd"),
    (
        ["view", "bad.yaml"],
        "bad.yaml: it cannot be read: it is no recording; expected a file NAME.rrd",
    ),
    (["step", "-3"], "-3: neither a number of steps, from 1 on, nor an option"),
    (["step", "0"], "0: neither a number of steps"),
    (["step", "2.5"], "2.5: neither a number of steps"),
    (["step", "--conect"], "--conect: neither a number of steps, from 1 on, nor an option"),
    (
        ["run", "--resume", "last"],
        (
            "run: no such file, and no such command (see --help); expected a scenario's file, or"
            " one of apple"
        ),
    ),
    (["hand_piking"], "hand_piking: no such file; did you mean the scenario hand_picking?"),
    # Rows are named as a value of the scenario, because the user has not typed --rows.
    (
        ["--pickers", "9"],
        "command line: --pickers = 9, rows = 5: must be at most one picker a row",
    ),
    (["--resume", "."], ".: no usable snapshot"),
    (
        ["--mode", "realtime", "--speed", "max"],
        "--speed: max: in realtime the wall clock sets the pace",
    ),
    (["stop"], "no run is active here"),
    (["stop", *NOWHERE], "tcp/127.0.0.1:9: no router answers there"),
    (
        ["--resume", "last", "mine.yaml", "--rows", "3"],
        "--resume: leave out mine.yaml, --rows: the snapshot has its scenario",
    ),
    (
        ["mine.yaml", "--only", "picker", "--connect", "tcp/127.0.0.1:9"],
        "leave out mine.yaml: the run itself defines that",
    ),
    (["agents.yaml"], "agents.yaml:1: agents.piker: not a kind (picker"),
    (["nobody.yaml"], "agents.picker_99: no such agent or kind"),
    (["bad.yaml"], "bad.yaml:1: rows = 999: "),
    (["bad.yaml"], "did you mean pickers"),
    (["bad.yaml"], "bad.yaml:4: people.workers = 'many'"),
    (
        [*SHORT, "--table", b"\xff"],
        "?: this name is no text in UTF-8, which a run needs; expected another folder or file",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), MISTAKES)
def test_a_mistake_is_told_once_with_what_would_be_right(
    arguments, message, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    code, words = output_of(
        [os.fsdecode(word) if isinstance(word, bytes) else word for word in arguments],
        monkeypatch,
        capfd,
    )
    assert (code, words.count(message)) == (2, 1), words
    assert [raw for raw in RAW if raw in words] == []


def test_a_file_whose_name_begins_with_a_dash_is_shown_as_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert typed("study", Path("./-dash.yaml")).endswith(" study ./-dash.yaml")


USAGES = [
    (["--help"], "orchard [OPTIONS] [SCENARIO.yaml]"),
    (["hand_picking", "--help"], "orchard [OPTIONS] [SCENARIO.yaml]"),
    (["layout", "--help"], "orchard layout [OPTIONS] COMMAND [ARGS]..."),
    (["harvest", "--help"], "orchard harvest [OPTIONS] [SCENARIO.yaml]"),
    (
        ["replay", "--help"],
        "orchard replay [OPTIONS] {FILE.mcap} [SCENARIO.yaml] Let the velocities in a bag",
    ),
]


@pytest.mark.parametrize(("arguments", "usage"), USAGES)
def test_help_is_that_of_the_command_that_was_typed(arguments, usage, monkeypatch, capfd):
    code, words = output_of(arguments, monkeypatch, capfd)
    assert (code, usage in words, "<bool>" in words) == (0, True, False), words


def test_the_version_is_that_of_the_package(monkeypatch, capfd):
    assert output_of(["--version"], monkeypatch, capfd) == (
        0,
        f"orchard {metadata.version('orchard-sim')}",
    )


def test_the_sentence_counts_rows_as_the_table_does():
    """10 rows are picked to their ends, and others in part: 15 rows' metres of 20."""
    half = harvested(
        finished=False,
        ended="stopped",
        rows=20,
        rows_picked=10,
        metres_picked=15.0 * 70.0,
        row_length=70.0,
    )
    assert "10 of 20 rows and 75 % of their metres picked" in sentence(half)


def test_a_full_disk_is_told_and_leaves_no_empty_file(tmp_path, monkeypatch, capfd):
    pytest.importorskip("pyproj")

    def full(file):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    out = tmp_path / "mine"
    for words in (
        ["import", ROOT / "examples" / "te_puke.geojson", "--out", out],
        ["export", "--lif", out],
    ):
        assert output_of(["layout", *words], monkeypatch, capfd) == (
            2,
            f"{out}: No space left on device",
        )
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("before", "variable", "arguments", "code", "words"),
    [
        ([], {"COLUMNS": "0"}, ["--help"], 0, "Usage: run.py"),
        ([], {"NUMBA_DISABLE_JIT": "1"}, SHORT, 0, "Ended by --duration"),
        (
            ["unshare", "-rn"],
            {},
            [*SHORT, "--mode", "lockstep"],
            2,
            "`ip link set lo up` makes it work, and --mode local does without",
        ),
    ],
    ids=["no width", "no compiler", "no loopback"],
)
def test_a_strange_place_ends_in_words_at_once(before, variable, arguments, code, words, tmp_path):
    if before and subprocess.run([*before, "true"], capture_output=True).returncode:
        pytest.skip("this machine makes no network namespaces")
    there = os.environ | {"ORCHARD_RUNS": str(tmp_path)} | variable
    command = [*before, sys.executable, str(ROOT / "run.py"), *arguments]
    done = subprocess.run(command, env=there, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, words in done.stdout + done.stderr) == (code, True), (
        done.stdout + done.stderr
    )
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("option", ["--record", "--table"])
def test_the_second_run_that_writes_to_one_place_is_refused(option, tmp_path, monkeypatch, capfd):
    if option == "--record":
        place = tmp_path / "run.rrd"
        place.touch()
        arguments = [word for word in SHORT if word not in NO_RECORD]
    else:
        place = tmp_path / "tables"
        place.mkdir()
        arguments = [*SHORT]
    with alone(place):
        code, words = output_of([*arguments, option, place], monkeypatch, capfd)
    assert code == 2
    assert (
        words
        == f"{place}: another run writes there now; name another one, or wait until it has ended"
    )
    assert place.exists() == (option == "--table"), "an empty file is not left"
