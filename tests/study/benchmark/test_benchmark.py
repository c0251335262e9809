"""The benchmark of dispatch policies: its orchards, its scores, and what its command says.

The benchmark is a set of public orchards. A score is the time that is proven possible, as a share
of the time that a policy takes. A submission is a file with the decisions of a policy, which others
replay. docs/benchmark.md explains all of it.
"""

import json
import os
import re
from dataclasses import asdict
from pathlib import Path

import pytest
from code_blocks import block
from command_line import orchard
from msgspec.structs import replace
from typer import BadParameter

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, Scenario, with_changes
from orchard.study.benchmark import command as benchmark_command
from orchard.study.benchmark import submission
from orchard.study.benchmark.instances import instances
from orchard.study.benchmark.play import Played
from orchard.study.benchmark.scores import Benchmark, BenchmarkResult, Harvests
from orchard.study.command_options import BenchmarkOptions
from orchard.study.ending import LOST
from orchard.study.store import Store
from orchard.study.workers import Workers, processes
from orchard.terminal.output import console

# Options that choose two small orchards, and a policy of tests/support/own_policies.py.
SMALL = ("--orchard", "small-fast-test", "--orchard", "small-slow-test", "--workers", "1")
POLICY = "own_policies.FarthestOfMine"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Return the file of the harvests of the built-in policies, and of the bounds.

    Each of these tests needs them. All processes of pytest share the file: each has a folder of its
    own in a common one.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    return folder / "benchmark.db"


def carried_out(command, folder, store):
    """Carry out a command of the document, with a policy of the tests, and one orchard in place of
    all unless the command names some. Return what it prints.
    """
    _, *words = (
        command.replace("my_policy.MyPolicy", POLICY)
        .replace("found.json", f"{folder}/found.json")
        .split()
    )
    small = [] if "--orchard" in words else ["--orchard", "small-fast-test"]
    return orchard(*words, *small, "--workers", "1", "--out", store).stdout


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
    assert re.search(rf"^ *small-slow-test( +\d+\.\d){{{1 + len(found['scores'])}}}$", said, re.M)
    # The store has all harvests now, so the same result comes from workers that cannot work.
    known = {name: instances()[name] for name in ("small-fast-test", "small-slow-test")}
    with Store(store) as opened:
        again = Benchmark(POLICY, known, opened, Workers(lambda: None, 1)).run()
    assert again is not None and asdict(again) == found

    checked = carried_out(check, tmp_path, store)
    assert "of what is proven possible" in checked
    assert re.search(r"^ *small-fast-test +\d+\.\d +\d+\.\d +[+-]\d\.\d$", checked, re.M)
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
                r" 'Missing' \(.*own_policies\.py\)"
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
        (
            ("--orchard", "tiny"),
            2,
            r"--orchard: tiny: no such orchard; there are .*small-fast-test, ",
        ),
        (
            ("own_policies.Raising", *SMALL),
            1,
            r"Raising, tick \d+: LookupError: no such bin here \(.*own_policies.py, line \d+\)",
        ),
        (
            ("own_policies.Idle", *SMALL),
            0,
            r"never finished, .* that was not sent: 1 of small-fast-test, 1 of small-slow-test",
        ),
    ],
)
def test_what_a_user_gets_wrong_is_said_in_words(store, words, code, said):
    done = orchard(
        "benchmark", *[word.format(store=store) for word in words], "--out", store, code=code
    )
    assert re.search(said, done.stdout + done.stderr), done.stdout + done.stderr
    assert "Traceback" not in done.stderr


# Options of the command that name no file and no split.
NO_FILES = dict.fromkeys(("summary", "submission", "verify", "secret", "split", "beside"))
RESULT = BenchmarkResult(
    policy="nearest",
    scores={"nearest": 0.9},
    harvests=[
        Harvests(
            orchard="small-fast-test", policy="nearest", proven=[9.0], seconds=[10.0], checked=[]
        )
    ],
    notes=[],
    version="1",
)


def benchmark_of(monkeypatch, **options) -> int:
    """Return the exit code of the command, whose harvests gave `RESULT`."""
    monkeypatch.setattr(benchmark_command, "_done", lambda *chosen: (RESULT, None))
    chosen = BenchmarkOptions(
        policy="nearest", orchard=["small-fast-test"], check=False, workers=1, **options
    )
    return benchmark_command.run_benchmark(chosen)


def test_a_benchmark_whose_scores_stdout_loses_fails(monkeypatch, capsys):
    """It says so at its end, too: the warning of the first loss may be hours old."""
    monkeypatch.setattr(console, "has_lost", True)
    assert benchmark_of(monkeypatch, out=None, anew=False, **NO_FILES) == 1
    assert capsys.readouterr().err == f"{LOST}\n"


def test_a_benchmark_names_the_file_that_fits_on_no_disk(monkeypatch, capfd, tmp_path):
    full = Path("/dev/full")
    assert (
        benchmark_of(monkeypatch, out=tmp_path / "b.db", anew=False, **NO_FILES | {"summary": full})
        == 1
    )
    told = capfd.readouterr()
    assert told.err == "/dev/full: not written: No space left on device\n"
    assert "90.0 % of what is proven possible" in told.out


def test_a_carrier_that_failed_beside_its_line_leaves_it():
    """Carriers behind it once waited for it for ever, in this orchard."""
    failing = {"failure": {"mean_between": 600.0, "mean_repair": 120.0}}
    scenario = Scenario(
        rows=20,
        pickers=10,
        carriers=7,
        picking_speed=0.5,
        route="one-way",
        rows_to_pickers="balanced",
        dispatch="assignment",
        tractor=False,
        weeds=0,
        carrying=failing,
        picking={
            "spread": {"distribution": "gamma", "cv": 0.2},
            "failure": {"mean_between": 1200.0, "mean_repair": 120.0},
        },
    )
    nobody = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}}
    layout = lay_out(with_changes(scenario, **nobody))
    assert DiscreteHarvest(layout).run().is_over


def test_a_submission_is_verified_without_its_policy(store, tmp_path):
    """It has the decisions, which are replayed. So a reader needs no policy, and each figure that
    was changed is found.
    """
    file = tmp_path / "mine.json"
    names = ("tiny-test", "small-fast-test")
    small = ("--orchard", names[0], "--orchard", names[1])
    rest = ("--workers", "1", "--out", store)

    def refusal_of(forged: dict, code: int = 1) -> str:
        """Return what the command says of a submission with this content."""
        file.write_text(json.dumps(forged))
        return orchard("benchmark", "--verify", file, *small, *rest, code=code).stderr

    done = orchard("benchmark", POLICY, *small, *rest, "--submission", file)
    written = json.loads(file.read_text())
    assert {harvest["instance"] for harvest in written["harvests"]} == {*names}
    score = f"{100.0 * written['score']:.1f}"
    assert f"{POLICY} has {score} % of what is proven possible" in done.stdout
    verified = orchard("benchmark", "--verify", file, *small, *rest)
    assert re.search(rf"{POLICY} has {score} % in 2 orchards: 2 harvests were", verified.stdout)

    assert re.search(
        r"2 of the 38 public orchards\..*not who found them.*public, with all",
        verified.stdout,
        re.S,
    )

    # What is wrong in a forged submission, and the fields of its first harvest that are changed. An
    # order is (tick, bin, carrier, picker).
    first = written["harvests"][0]
    faults = {
        "its hash is not that of its content": {},
        "it says 1.0 s; its orders take": {"seconds": 1.0},
        "which is not available": {
            "orders": [[*first["orders"][0][:2], "carrier_77", "picker_01"]]
        },
        "its orders never finish the harvest": {"orders": first["orders"][:1]},
        "its bound is 1 s; expected": {"proven_seconds": 1.0},
        "no such instance and seed": {"seed": 1},
        "is that of picker_": {"orders": [[*first["orders"][0][:3], "picker_99"]]},
        "it says that it is never finished; its orders take": {"seconds": None},
        f"it says {first['seconds'] - 0.1:.1f} s;": {"seconds": first["seconds"] - 0.1},
    }
    for said, change in faults.items():
        forged = written | {"harvests": [first | change, *written["harvests"][1:]]}
        assert said in refusal_of(forged | {"policy": "better.Policy"})
    better_score = written | {"scores": written["scores"] | {"tiny-test": 1.0}}
    assert "the score of tiny-test is not that of its harvests" in refusal_of(better_score)
    assert "the score of tiny-test is missing" in refusal_of(written | {"scores": {}})
    of_hidden = written | {"splits": ["hidden"]}
    assert "it is of the splits ['hidden']; expected ['test']" in refusal_of(of_hidden)
    # A name that would control the terminal is shown with a question mark.
    controlling = written | {"harvests": [first | {"instance": "\x1b[2J"}]}
    assert "?[2J, seed" in refusal_of(controlling)
    unknown = written | {"found_by": "nobody"}
    assert "unknown field `found_by`" in refusal_of(unknown, code=2)
    file.write_text(json.dumps(written))
    missing = orchard("benchmark", "--verify", file, *small, "--orchard", "tiny-train", code=1)
    assert re.search(r"tiny-train, seed \d+: this harvest is missing", missing.stderr)


def test_two_policies_of_ones_own_are_compared_by_seeds(store, tmp_path):
    """One is asked, the other one comes from its submission: the differences are paired."""
    first = tmp_path / "first.json"
    found = tmp_path / "found.json"
    rest = ("--orchard", "small-failures-test", "--workers", "2", "--out", store)
    orchard("benchmark", "own_policies.AtOnce", *rest, "--submission", first)
    done = orchard("benchmark", POLICY, *rest, "--beside", first, "--summary", found)
    scores = json.loads(found.read_text())["scores"]
    assert scores["own_policies.AtOnce"] == json.loads(first.read_text())["score"]
    assert [*scores.values()] == sorted(scores.values(), reverse=True)
    assert "AtOnce" in done.stdout

    same = orchard("benchmark", "own_policies.AtOnce", *rest, "--beside", first, code=2)
    assert "its policy own_policies.AtOnce is in the table already" in same.stderr
    first.write_text(first.read_text().replace('"own_policies.AtOnce"', '"mine.Better"'))
    changed = orchard("benchmark", POLICY, *rest, "--beside", first, code=1)
    assert "its hash is not that of its content" in changed.stderr


def test_harvests_that_a_submission_repeats_are_not_replayed(monkeypatch):
    """To replay a file of a thousand repetitions would take hours. So none is replayed here."""
    monkeypatch.setattr(submission, "replayed", None)
    known = {"tiny-test": instances()["tiny-test"]}
    (draw,) = known["tiny-test"].draws
    played = Played(seconds=draw.best.seconds, is_early=draw.best.is_early)
    once = submission.submission_of("mine.Policy", "1", known, {"tiny-test": [played]})
    many = replace(once, harvests=once.harvests * 1000)
    told = submission.problems_of(replace(many, sha256=many.digest), known)
    assert told == [f"tiny-test, seed {draw.seed}: it is there 1000 times"]


def test_a_builtin_policy_is_submitted_as_it_is_scored(tmp_path):
    """A standard error is that of the difference to the policy that was asked about: to itself it
    has none.
    """
    known = {name: instances()[name] for name in ("small-fast-test", "small-failures-test")}
    with Store(tmp_path / "built-in.db") as opened, processes(1) as workers:
        benchmark = Benchmark("predictive", known, opened, workers)
        result = benchmark.run()
    submitted = benchmark.submission()
    assert submitted.score == pytest.approx(result.scores["predictive"], abs=1e-4)
    assert submitted.sha256 == submitted.digest
    assert submitted.splits == result.splits == ["test"]
    assert result.standard_error("predictive") == 0.0
    assert 0.0 < result.standard_error("nearest") < 0.05


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nearest", "--submission", "x.json"), "with nearest bins call carriers themselves"),
        (("--submission", "x.json", "--check"), "a policy is trusted in the simulator"),
        (("--secret", "no.txt", "--split", "test"), "the secret draws a split of its own"),
        (("--secret", "no.txt"), "no.txt: No such file or directory"),
        (("predictive", "--verify", "no.json"), "POLICY has no effect: leave it out"),
        (("--verify", "no.json"), "no.json: No such file or directory"),
        (("--verify", "README.md"), "README.md: is no submission to the benchmark"),
        (("--split", "hidden"), "hidden: expected train or test"),
        (("--orchard", "tiny-test", "--split", "train"), "tiny-test: no such orchard; there are"),
    ],
)
def test_options_that_cannot_be_are_refused(words, said):
    assert said in orchard("benchmark", *words, code=2).stderr


def test_an_orchard_that_no_secret_draws_is_refused(tmp_path, monkeypatch):
    """It is refused before a bound is proven: bounds are proven only of orchards that are wanted.

    A secret of an organiser draws orchards that nobody knows, whose names end in -hidden.
    """
    secret = tmp_path / "secret.txt"
    secret.write_text("0123456789abcdef0123456789abcdef")
    monkeypatch.setattr(benchmark_command, "hidden_instances", None)
    options = NO_FILES | {"secret": secret}
    with pytest.raises(BadParameter, match=r"small-fast-test: no such orchard; there are tiny-hid"):
        benchmark_of(monkeypatch, out=None, anew=False, **options)


def test_the_documented_options_are_those_of_the_command():
    known = orchard("benchmark", "--help").stdout
    for name in ("benchmark secret", "benchmark submission", "benchmark beside"):
        options = re.findall(r" (--\w+)", block("docs/benchmark.md", name))
        assert options
        assert [option for option in options if option not in known] == []
