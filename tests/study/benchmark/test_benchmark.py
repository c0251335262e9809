"""The benchmark of dispatch policies: its orchards, its scores, and what its command says."""

import json
import os
import re
from dataclasses import asdict
from pathlib import Path

import pytest
from code_blocks import block
from command_line import orchard

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, with_changes
from orchard.study.benchmark import command as benchmark_command
from orchard.study.benchmark.scores import ORCHARDS, Benchmark, BenchmarkResult, Harvests, orchards
from orchard.study.command_options import BenchmarkOptions
from orchard.study.store import Store
from orchard.study.study_command import LOST
from orchard.study.workers import Workers
from orchard.terminal.output import console

SMALL = ("--orchard", "small-fast", "--orchard", "small-slow", "--workers", "1")
POLICY = "own_policies.FarthestOfMine"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """The harvests of the built-in policies and the bounds, which each of these tests needs: all
    workers of the tests share them.
    """
    folder = tmp_path_factory.getbasetemp()
    return (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "benchmark.db"


def carried_out(command, folder, store):
    """Carry out a command of the document, with an orchard or two in place of twenty.

    Return what it said.
    """
    _, *words = (
        command.replace("my_policy.MyPolicy", POLICY)
        .replace("found.json", f"{folder}/found.json")
        .split()
    )
    small = [] if "--orchard" in words else ["--orchard", "small-fast"]
    return orchard(*words, *small, "--workers", "1", "--out", store).stdout


def test_the_twenty_orchards_say_their_roads_and_row_rules():
    """The orchards are twenty and each says its roads and its rule for rows."""
    known = orchards()
    assert len(known) == 20
    wanted = {"route", "rows_to_pickers", "people", "animals", "carriers", "seed"}
    assert all(one.model_fields_set >= wanted for one in known.values()), ORCHARDS
    for key in ("route", "rows_to_pickers"):
        assert len({getattr(one, key) for one in known.values()}) == 2


def test_the_commands_of_the_document_compare_a_policy(tmp_path, store):
    """The commands of the document set a policy beside the built-in ones and the simulator."""
    every, some, check = block("docs/benchmark.md", "benchmark").splitlines()
    assert "of what is proven possible" in carried_out(every, tmp_path, store)

    said = carried_out(f"{some} --summary found.json", tmp_path, store)
    found = json.loads((tmp_path / "found.json").read_text())
    assert list(found["scores"]) == sorted(
        found["scores"], key=lambda policy: -found["scores"][policy]
    )
    assert {*found["scores"]} == {*DISPATCH_POLICIES, POLICY}
    assert all(
        0.3 < proven / took <= 1.0
        for one in found["harvests"]
        for proven, took in zip(one["proven"], one["seconds"], strict=True)
    )
    score = f"{100.0 * found['scores'][POLICY]:.1f}"
    (best, *_) = found["scores"]
    assert re.search(
        rf"{POLICY} has {score} % of what is proven possible; the best is {best}", said
    )
    assert re.search(rf"^ *small-slow( +\d+\.\d){{{1 + len(found['scores'])}}}$", said, re.M)
    known = {name: orchards()[name] for name in ("small-fast", "small-slow")}
    with Store(store) as opened:
        again = Benchmark(
            POLICY, known, opened, Workers(lambda: None, 1)
        ).run()  # none of these workers can work
    assert again is not None and asdict(again) == found

    checked = carried_out(check, tmp_path, store)
    assert "of what is proven possible" in checked
    assert re.search(r"^ *small-fast +\d+\.\d +\d+\.\d +[+-]\d\.\d$", checked, re.M)
    harvests = json.loads((tmp_path / "found.json").read_text())["harvests"]
    (own,) = [one for one in harvests if one["policy"] == POLICY]
    assert len(own["seconds"]) == len(own["checked"]) == 1
    assert own["seconds"] == pytest.approx(own["checked"], rel=0.02)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (
            ("own_policies.Missing",),
            2,
            (
                r"command line: POLICY = own_policies.Missing: cannot be used: .* no attribute"
                r" 'Missing'"
            ),
        ),
        (
            ("missing.Policy",),
            2,
            r"POLICY = missing.Policy: cannot be used: .* modules are imported from the directory",
        ),
        (
            ("own_policies.BinReport",),
            2,
            r"POLICY = own_policies.BinReport: cannot be used: TypeError",
        ),
        (("predictve",), 2, r"POLICY = 'predictve': must be .*; did you mean predictive\?"),
        (
            ("--summary", "{store}"),
            2,
            r"--summary: .*benchmark.db, .*benchmark.db: two of these are one file",
        ),
        (("--orchard", "tiny"), 2, r"--orchard: tiny: no such orchard; there are small-fast, "),
        (
            ("own_policies.Raising", *SMALL),
            1,
            r"Raising, tick \d+: LookupError: no such bin here \(.*own_policies.py, line \d+\)",
        ),
        (
            ("own_policies.Idle", *SMALL),
            0,
            r"never finished, .* carrier that was not sent: 1 of small-fast, 1 of small-slow",
        ),
    ],
)
def test_what_a_user_gets_wrong_is_said_in_words(store, words, code, said):
    done = orchard(
        "benchmark", *[word.format(store=store) for word in words], "--out", store, code=code
    )
    assert re.search(said, done.stdout + done.stderr), done.stdout + done.stderr
    assert "Traceback" not in done.stderr


RESULT = BenchmarkResult(
    policy="nearest",
    scores={"nearest": 0.9},
    harvests=[
        Harvests(orchard="small-fast", policy="nearest", proven=[9.0], seconds=[10.0], checked=[])
    ],
    notes=[],
    version="1",
)


def benchmark_of(monkeypatch, **options) -> int:
    """Return the exit code of the command, whose harvests gave `RESULT`."""
    monkeypatch.setattr(benchmark_command, "_result", lambda chosen, known: RESULT)
    chosen = BenchmarkOptions(policy="nearest", orchard=None, check=False, workers=1, **options)
    return benchmark_command.run_benchmark(chosen)


def test_a_benchmark_whose_scores_stdout_loses_fails(monkeypatch, capsys):
    """It says so at its end, too: the warning of the first loss may be hours old."""
    monkeypatch.setattr(console, "has_lost", True)
    assert benchmark_of(monkeypatch, out=None, anew=False, summary=None) == 1
    assert capsys.readouterr().err == f"{LOST}\n"


def test_a_benchmark_names_the_file_that_fits_on_no_disk(monkeypatch, capfd, tmp_path):
    full = Path("/dev/full")
    assert benchmark_of(monkeypatch, out=tmp_path / "b.db", anew=False, summary=full) == 1
    told = capfd.readouterr()
    assert told.err == "/dev/full: not written: No space left on device\n"
    assert "90.0 % of what is proven possible" in told.out


def test_a_carrier_that_failed_beside_its_line_leaves_it():
    layout = lay_out(with_changes(orchards()["large-failures"], dispatch="assignment"))
    assert DiscreteHarvest(layout).run().is_over  # those behind it waited for it for ever
