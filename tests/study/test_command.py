"""The command `orchard study`, as a person uses it: answers, mistakes, Ctrl-C, kill -9.

A study runs settings of an orchard, such as numbers of carriers, until it is sure which is best. It
keeps all runs in a store, a file of SQLite, so that it can go on.
"""

import json
import os
import re
import signal
import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from command_line import orchard, starting
from patience import PATIENCE

from orchard.commands import main as commands
from orchard.field.scenario import Scenario, load, with_changes
from orchard.study.options import StudyOptions
from orchard.study.runs import PlannedRun
from orchard.study.store import Store, StoreFailed
from orchard.study.study import study

SCENARIO = """\
rows: 3
picking_speed: 0.5
picking: {spread: {distribution: gamma}}
people: {workers: 0, visitors: 0}
animals: {dogs: 0, cats: 0}
prices: {picker_per_hour: 15, carrier_per_hour: 6}
"""
QUESTION = (
    "--vary",
    "carriers=1..3",
    "--vary",
    "dispatch=nearest,predictive",
    "--horizon",
    "harvest",
    "--goal",
    "bins_per_hour",
    "--model",
    "fast",
    "--budget",
    "2h",
    "--within",
    "4%",
    "--workers",
    "2",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("command")
    (made / "my.yaml").write_text(SCENARIO)
    return made


def words(folder: Path, store: str) -> tuple:
    """Return the words of the command for QUESTION, with a store of this name."""
    return "study", folder / "my.yaml", *QUESTION, "--out", folder / store


def found(path: Path) -> dict:
    """Return the summary of a study, without the time that it took."""
    return json.loads(path.read_text()) | {"wall_seconds": 0.0}


@pytest.fixture(scope="module")
def undisturbed(folder) -> dict:
    """Do the study of QUESTION without an interruption. Return its summary."""
    run = orchard(
        *words(folder, "quiet.db"),
        "--summary",
        folder / "quiet.json",
        "--csv",
        folder / "quiet.csv",
    )
    summary = found(folder / "quiet.json")
    assert summary["answer"] in run.stdout
    assert summary["orchard"] == (
        "3 rows of 70 m, one bin a row, 2 pickers, two-way, 5.5 m from row to row, carriers at 1"
        " m/s, pickers that drive at 1 m/s, 5 s at the bay, 0.2 s to couple a bin, 0.4 s to"
        " uncouple it"
    )
    assert f"The orchard: {summary['orchard']}" in run.stdout
    return summary


def known(store: Path) -> int:
    """Return the number of runs that a store has."""
    if not store.exists():
        return 0
    with closing(sqlite3.connect(store, timeout=PATIENCE)) as database:
        return database.execute("SELECT count(*) FROM runs").fetchone()[0]


def wait_for_runs(store: Path) -> None:
    """Wait until a store has three runs."""
    end = time.monotonic() + PATIENCE
    while known(store) < 3:
        assert time.monotonic() < end, "no run was kept"
        time.sleep(0.02)


ALONE = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}}


@pytest.mark.parametrize("prices", [{}, {"picker_per_hour": 25.0, "carrier_per_hour": 8.0}])
def test_the_library_the_command_and_the_page_give_one_answer(folder, tmp_path, prices):
    """Each gets the orchard alone, and has a store of its own, so that all do their runs."""
    scenario = Scenario(
        rows=6,
        row_length=40.0,
        pickers=3,
        picking_rate=40.0,
        bins_per_row=2,
        **ALONE,
        prices=prices,
    )
    files = pytest.importorskip("orchard.app.command").Files(tmp_path, "rent")
    study_run = pytest.importorskip("orchard.app.study_run")
    page = study_run.StudyRun(scenario, study_run.StudySettings(), files)
    page._listener.join(PATIENCE)
    orchard(
        "study",
        files.scenario,
        "--summary",
        tmp_path / "command.json",
        "--out",
        tmp_path / "command.db",
    )
    library = study(scenario, options=StudyOptions(store=tmp_path / "library.db", workers=1))
    assert page.result is not None and library.stopped_by == "certain" and library.beyond == {}
    assert page.result.answer == library.answer == found(tmp_path / "command.json")["answer"]
    assert page.result.table == library.table
    assert 1 < library.best["carriers"] < max(library.varied["carriers"]), (
        "it lies inside what was tried"
    )


def test_the_whole_answer_is_written(folder, undisturbed):
    assert {"answer", "best", "undecided", "beyond", "table", "notes", "stopped_by"} <= set(
        undisturbed
    )
    assert [row["setting"] for row in undisturbed["table"]] == [
        {"carriers": carriers, "dispatch": policy}
        for carriers in (1, 2, 3)
        for policy in ("nearest", "predictive")
    ]
    assert len((folder / "quiet.csv").read_text().splitlines()) == 1 + 6, "a head and six settings"


def test_two_sentences_come_first_and_the_table_fits(folder):
    """A study that gets the orchard alone answers how many carriers are best in the long run.

    The answer and the orchard come first, on one line; the table fits 80 columns; and the library
    gives the same answer.
    """
    (folder / "plain.yaml").write_text(SCENARIO.replace("gamma", "none") + "tractor: false\n")
    run = orchard(
        "study",
        folder / "plain.yaml",
        "--workers",
        "2",
        "--budget",
        "2h",
        "--out",
        folder / "plain.db",
    )
    assert run.returncode == 0, run.stderr
    sentences, *table = run.stdout.splitlines()
    said = (
        r"\d carriers?: .* a bin, .* bins an hour in the long run.*\. The orchard: 3 rows .*, one"
        r" bin a row, 2 pickers, two-way, .*\."
    )
    assert re.fullmatch(said, sentences)
    assert table[0].split()[0] == "behind," or "carriers" in table[1]
    assert max(map(len, table)) <= 80
    options = StudyOptions(workers=2, budget_seconds=7200.0, store=folder / "plain.db")
    assert study(load(folder / "plain.yaml"), options=options).answer == sentences


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_study_that_ends_early_goes_on_to_the_same_table(folder, undisturbed, number):
    """Ctrl-C at a terminal (SIGINT) reaches all processes of the study, and SIGKILL only the first.

    No process of it is left. The same command goes on, and does only the runs that are missing.
    """
    store = f"{number}.db"
    summary = folder / f"{number}.json"
    with starting(*words(folder, store)) as first:
        wait_for_runs(folder / store)
        children = psutil.Process(first.pid).children(recursive=True)
        os.killpg(first.pid, number) if number == signal.SIGINT else first.kill()
        code = first.wait(PATIENCE)
        said = first.stdout.read() if number == signal.SIGINT else ""
    assert code in (0, -signal.SIGKILL)
    assert number == signal.SIGKILL or "stopped; the runs so far are kept" in said
    assert "Traceback" not in said
    psutil.wait_procs(children, PATIENCE)
    assert not [
        child for child in children if child.is_running() and child.status() != psutil.STATUS_ZOMBIE
    ]
    before = known(folder / store)
    run = orchard(*words(folder, store), "--summary", summary, "--progress", "json")
    assert found(summary) == undisturbed
    last = json.loads(run.stdout.splitlines()[-1])["study"]
    assert last | {"wall_seconds": 0.0} == undisturbed, "a program reads the same"
    assert before < known(folder / store) == known(folder / "quiet.db")


# Options of a study, and words of the answer.
MISTAKES = [
    (["--vary", "dispach=x"], ["did you mean dispatch?"]),
    (["--goal", "cost_per_bin"], ["--goal cost_per_bin: prices: needs a price"]),
    (["--out", "README.md"], ["README.md: is no store of a study; it stays as it is"]),
    (["--out", "nodir/"], ["nodir/: a folder; expected a file, such as nodir/studies.db"]),
    (["--out", "nodir/my.db"], ["nodir/my.db: there is no folder nodir"]),
    (["--within", "3"], ["3: expected a share above 0 and below 1"]),
    (["--confidence", "10%"], ["10%: expected a share from 0.5 to 0.9999"]),
    (["--budget", "soon"], ["soon: expected a time of at least 1 s"]),
    (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], ["the scheduler has its own workers"]),
    (["--scheduler", "nowhere"], ["nowhere: expected an address with its port, such as tcp://"]),
    (["--model", "full"], ["only the fast model can tell the long run; choose --horizon harvest"]),
    (["--finish-within", "soon"], ["soon: expected 1min to 10000h of work, such as 8h or 90min"]),
    (["--finish-by", "2"], ["--finish-by: 2: expected days from 1d to 1000d, such as 2d"]),
    (["--finish-by", "2d"], ["--finish-by 2d: shift: days need a shift"]),
    (["--finish-by", "2d", "--finish-within", "8h"], ["one deadline is enough"]),
    (["--finish-within", "8h", "--horizon", "long"], ["a deadline is that of one harvest"]),
    (["--finish-within", "8h"], ["only pickers and carriers vary, and not rows"]),
    (["--picture", "study.doc"], ["study.doc: a picture's name ends in .svg or .png"]),
    (["--summary", "same.x", "--csv", "same.x"], ["same.x, same.x: two of these are one file"]),
    (["--summary", "same.x", "--out", "./same.x"], ["same.x, same.x: two of these are one file"]),
    (["--summary", "{runs}/studies.db"], ["studies.db: two of these are one file"]),
    (["--summary", "/no/such/folder/file.json"], ["/no/such/folder/file.json: cannot be written"]),
]


@pytest.mark.parametrize(("options", "told"), MISTAKES)
def test_mistakes_are_told_with_exit_code_2(options, told, mistakes, tmp_path):
    said = mistakes(
        "--vary",
        "rows=3,4",
        "--model",
        "fast",
        *[option.format(runs=tmp_path) for option in options],
    )
    assert all(words in said for words in told), said
    assert "Traceback" not in said


@pytest.fixture
def mistakes(capfd, monkeypatch, tmp_path):
    """Return a function that starts a study, which must be refused. It returns the words."""

    def said(*words):
        monkeypatch.setattr("sys.argv", ["orchard", "study", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            commands.main()
        assert ended.value.code == 2
        return capfd.readouterr().err

    monkeypatch.setenv("ORCHARD_RUNS", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "200")
    return said


def test_faults_of_file_options_and_ranges_are_told_at_once(mistakes, tmp_path):
    """The faults of options, of ranges and of the file are told together.

    Nothing is told that may only follow from a fault of the file: here that a goal needs a price,
    and that 20 pickers need 20 rows.
    """
    (tmp_path / "bad.yaml").write_text("rows: 999\nprices: {per_bin: -1}\n")
    options = (
        "--goal cost_per_bin --model slow --within 3 --workers 0 --csv /no/such/folder/file.csv"
        " --out README.md"
    )
    said = mistakes(
        tmp_path / "bad.yaml", "--vary", "carriers=0..5", "--vary", "pickers=20", *options.split()
    )
    assert [line.removeprefix(str(tmp_path))[:22] for line in said.splitlines()] == [
        "--within: 3: expected ",
        "--model: slow: expecte",
        "--workers: 0: expected",
        "/no/such/folder/file.c",
        "README.md: is no store",
        "--vary carriers=0..5: ",
        "/bad.yaml:1: rows = 99",
        "/bad.yaml:2: prices.pe",
    ]


def test_an_unreadable_file_hides_only_what_depends_on_it(mistakes):
    """Of a file that cannot be read only what is wrong anyway is told."""
    said = mistakes(
        "no_such.yaml", "--vary", "seed=1,2", "--vary", "pickers=20", "--goal", "cost_per_bin"
    )
    assert [line.split(": ")[:2] for line in said.splitlines()] == [
        ["--vary seed=1,2", "seed"],
        ["no_such.yaml", "no such file"],
    ]


def test_a_budget_too_short_for_one_run_is_exit_code_1(folder):
    options = "--model", "full", "--horizon", "harvest", "--budget", "1s", "--vary", "rows=20"
    run = orchard("study", "undisturbed", *options, "--out", folder / "short.db", code=1)
    assert "the budget is too short for one run" in run.stderr
    assert "No setting has been run yet." in run.stdout


def test_a_violated_invariant_is_exit_code_1_and_named(folder):
    """Five runs of the full model are in the store already, as runs that broke an invariant."""
    scenario = with_changes(load(folder / "my.yaml"), carriers=2)
    sound = PlannedRun(scenario, "fast").do(time.time() + 100.0)
    with Store(folder / "violated.db") as store:
        for seed in range(scenario.seed, scenario.seed + 5):
            planned = PlannedRun.of(scenario, seed, "full", "harvest")
            store.keep(
                replace(
                    sound,
                    key=planned.key,
                    seed=seed,
                    model="full",
                    ended="violated",
                    violations="bin_01: is in two places",
                )
            )
    options = (
        "--model",
        "full",
        "--horizon",
        "harvest",
        "--vary",
        "carriers=2",
        "--workers",
        "1",
        "--budget",
        "1s",
    )
    run = orchard("study", folder / "my.yaml", *options, "--out", folder / "violated.db", code=1)
    assert "bin_01: is in two places" in run.stderr


def test_a_store_that_fails_is_a_failure_and_no_bad_input(folder, monkeypatch, capfd):
    def fail(*_):
        raise StoreFailed("full.db: a run cannot be kept: disk I/O error")

    monkeypatch.setattr("orchard.study.study_command.study", fail)
    code = commands.app(
        ["study", "--vary", "carriers=1,2", "--out", str(folder / "full.db")], standalone_mode=False
    )
    assert (code, capfd.readouterr().err) == (1, "full.db: a run cannot be kept: disk I/O error\n")


def test_a_study_says_which_of_its_policies_leave(tmp_path):
    """Version 2.0 will not have two of these policies. The exit code depends on the budget."""
    varied = ("--vary", "dispatch=assignment,nearest,longest-waiting", "--vary", "carriers=2")
    done = orchard(
        *("study", *varied, "--model", "fast", "--budget", "1", "--workers", "1"),
        *("--out", tmp_path / "studies.db"),
        code=None,
    )
    notes = [line for line in done.stderr.splitlines() if "version 2.0" in line]
    assert [note.split(":")[0] for note in notes] == [
        "dispatch = assignment",
        "dispatch = longest-waiting",
    ]
