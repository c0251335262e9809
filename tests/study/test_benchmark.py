"""The benchmark of dispatch policies: its orchards, its scores, and what its command says."""

import json
import re

import pytest
from code_blocks import block
from command_line import orchard

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, with_changes
from orchard.study.benchmark import ORCHARDS, orchards

SMALL = ("--orchard", "small-fast", "--orchard", "short-rows", "--workers", "2")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """The runs of the built-in policies, which each of these tests needs."""
    return tmp_path_factory.mktemp("benchmark") / "runs.db"


def test_the_orchards_are_twenty_and_each_says_its_roads_and_its_rule_for_rows():
    known = orchards()
    assert len(known) == 20
    assert all(one.model_fields_set >= {"route", "rows_to_pickers", "people", "animals", "carriers", "seed"} for one in known.values()), (
        ORCHARDS
    )
    for key in ("route", "rows_to_pickers"):
        assert len({getattr(one, key) for one in known.values()}) == 2


def test_a_policy_stands_beside_the_built_in_ones_and_the_simulator(tmp_path, store):
    command = ("benchmark", "own_policies.FarthestOfMine", "--out", store, "--summary", tmp_path / "found.json", *SMALL)
    said = orchard(*command).stdout
    found = json.loads((tmp_path / "found.json").read_text())
    assert list(found["scores"]) == sorted(found["scores"], key=lambda policy: -found["scores"][policy])
    assert {*found["scores"]} == {*DISPATCH_POLICIES, "own_policies.FarthestOfMine"}
    assert all(0.3 < proven / took <= 1.0 for one in found["harvests"] for proven, took in zip(one["proven"], one["seconds"], strict=True))
    score, (best, *_) = f"{100.0 * found['scores'][found['policy']]:.1f}", found["scores"]
    assert re.search(rf"own_policies.FarthestOfMine has {score} % of what is proven possible; the best is {best}", said)
    assert re.search(rf"^ *short-rows( +\d+\.\d){{{1 + len(found['scores'])}}}$", said, re.M)
    assert orchard(*command).stdout == said  # from the store

    checked = orchard(*command[:-4], "--workers", "2", "--check").stdout
    assert re.search(r"^ *small-fast +\d+\.\d +\d+\.\d +[+-]\d\.\d$", checked, re.M)
    harvests = json.loads((tmp_path / "found.json").read_text())["harvests"]
    (own,) = [one for one in harvests if one["policy"] == found["policy"]]
    assert len(own["seconds"]) == len(own["checked"]) == 3
    assert own["seconds"] == pytest.approx(own["checked"], rel=0.02)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("own_policies.Missing",), 2, r"command line: POLICY = own_policies.Missing: cannot be used: .* no attribute 'Missing'"),
        (("missing.Policy",), 2, r"POLICY = missing.Policy: cannot be used: .* modules are imported from the directory"),
        (("own_policies.BinReport",), 2, r"POLICY = own_policies.BinReport: cannot be used: TypeError"),
        (("predictve",), 2, r"POLICY = 'predictve': must be .*; did you mean predictive\?"),
        (("--orchard", "tiny"), 2, r"--orchard: tiny: no such orchard; there are small-fast, "),
        (
            ("own_policies.Raising", *SMALL),
            1,
            r"own_policies.Raising, tick \d+: LookupError: no such bin here \(.*own_policies.py, line \d+\)",
        ),
        (("own_policies.Idle", *SMALL), 0, r"never finished, .* carrier that was not sent: 3 of small-fast, 3 of short-rows"),
    ],
)
def test_what_a_user_gets_wrong_is_said_in_words(store, words, code, said):
    done = orchard("benchmark", *words, "--out", store, code=code)
    assert re.search(said, done.stdout + done.stderr), done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", block("docs/bounds.md", "benchmark").splitlines())
def test_the_commands_in_the_document_run(tmp_path, command):
    _, *words = command.replace("my_policy.MyPolicy", "own_policies.FarthestOfMine").replace("found.json", f"{tmp_path}/found.json").split()
    small = [*words, *([] if "--orchard" in words else ["--orchard", "small-fast"]), "--workers", "1", "--out", tmp_path / "runs.db"]
    assert "of what is proven possible" in orchard(*small).stdout


def test_a_carrier_that_failed_beside_its_line_leaves_it():
    layout = lay_out(with_changes(orchards()["large-failures"], dispatch="assignment"))
    assert DiscreteHarvest(layout).run().is_over  # those behind it waited for it for ever
