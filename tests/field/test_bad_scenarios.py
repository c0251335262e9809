"""Scenario files of malice and of chance: each is a scenario, or refused in few words."""

import itertools
import random
from contextlib import suppress

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import load
from orchard.field.yaml_file import LARGEST_FILE

BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{c}: &{c} [{','.join('*' + p for _ in range(9))}]\n" for p, c in itertools.pairwise("abcdefghi")
)
SCENARIOS = {
    "bomb": BOMB.encode(),
    "deep": b"a: " + b"[" * 60_000,
    "deep maps": b"{a: " * 15_000,
    "huge": b"rows: " + b"9" * 60_000,
    "exponent": b"picking_speed: 1e999999999",
    "twice": b"rows: 3\n" * 8000,
    "tab": b"people:\n\tworkers: 1",
    "nul": b"rows: 3\0",
    "no text": b"rows: \xff\xfe",
    "utf 16": "rows: 3".encode("utf-16"),
    "a megabyte": b"#" * (1 << 20),
    "unknown": b"{" + b"a," * 30_000 + b"}",
    "tag": b"rows: !!python/object/apply:os.system [true]",
    "surrogate": b'rows: "\\ud800"',
    "control": b"rows: \x1b[2J",
    "nan": b"row_width: .nan",
    "list": b"- 1",
    "text": b"rows",
    "merge": b"<<: {rows: 3}",
    "keys": b"? [1, 2]\n: 3",
    "two": b"rows: 3\n---\nrows: 4",
    "agents": b"agents: {1: 2}",
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_bad_scenario_is_refused_in_few_words(tmp_path, name):
    path = tmp_path / "bad.yaml"
    path.write_bytes(SCENARIOS[name])
    with pytest.raises(ScenarioError) as refused:
        load(path)
    assert len(str(refused.value)) < 20_000


@pytest.mark.parametrize("form", [b"\xef\xbb\xbf%s", b"%s"])
def test_marks_and_line_ends_of_other_systems_are_no_harm(tmp_path, form):
    path = tmp_path / "good.yaml"
    path.write_bytes(form % b"rows: 4\r\npickers: 2\r\n")
    assert load(path).rows == 4


def test_a_damaged_scenario_is_one_or_refused(tmp_path):
    path, chance = tmp_path / "damaged.yaml", random.Random(5)
    sources = [
        b"rows: 4\npeople: {workers: 3, visitors: 0}\nlaser: {noise: 0.01}\nagents: {picker: my.Picker}\n",
        b"weeds: 3\ntractor: false\n",
    ]
    pieces = [
        b"&a ", b"*a", b"!!int ", b"\t", b"\0", b"\xff", b"{", b"[", b"]", b": ", b"- ", b"'", b'"', b"\n", b"\r", b"|", b"%", b"---\n",
        b"1e99", b"-",
    ]  # fmt: skip
    for _ in range(1000):
        text = chance.choice(sources)
        for _ in range(chance.randrange(1, 4)):
            at = chance.randrange(len(text))
            text = text[:at] + chance.choice(pieces) * chance.choice([1, 1, 30]) + text[at + chance.randrange(3) :]
        path.write_bytes(text[:LARGEST_FILE])
        with suppress(ScenarioError):
            load(path)
