"""Files that are no scenario at all are refused in few words: not there, not text, not YAML, or made to do harm."""

import itertools
import time
from pathlib import Path

import pytest
from scenario_mistakes import refusal

from orchard.field.problems import ScenarioError
from orchard.field.scenario import load
from orchard.field.yaml_file import LARGEST_FILE


def unreadable(path: Path | str) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(path)
    return str(caught.value)


def test_a_missing_file(tmp_path: Path) -> None:
    assert unreadable(tmp_path / "none.yaml") == f"{tmp_path / 'none.yaml'}: no such file"


def test_an_unreadable_file(tmp_path: Path) -> None:
    assert "cannot be read: Is a directory" in unreadable(tmp_path)
    assert "cannot be read: embedded null byte" in unreadable("a\0b")
    assert "cannot be read" in unreadable("x" * 5000)


def test_not_utf8(tmp_path: Path) -> None:
    file = tmp_path / "latin.yaml"
    file.write_bytes(b"rows: 5\n# caf\xe9\n")
    assert unreadable(file) == f"{file}:2: is not UTF-8 text"
    file.write_bytes("rows: 3".encode("utf-16"))
    assert unreadable(file) == f"{file}:1: is not UTF-8 text"


@pytest.mark.parametrize(
    "text", ["rows: [1", "rows: 'x", "rows: 3: 4", "a\n b: 1\nc", "\trows: 5", "? [1]\n: 2", "@", "rows: 1\n---\nrows: 2"]
)
def test_not_yaml_tells_line_and_column(text: str) -> None:
    line = refusal(text)
    assert "is not YAML" in line
    assert "(line " in line
    assert ", column " in line


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        ("is not YAML", ["\0", "rows: 3\0", "a: \x07", "rows: \x1b[2J", 'a: "\\UFFFFFFFF"', "%YAML 1." + "9" * 5000 + "\n--- {}"]),
        ("must be a map of keys and values", ["[1, 2]", "5", "rows", "- rows: 5"]),
        ("tags (!name): not allowed", ["rows: !!python/object/apply:os.system [ls]", "!!python/name:os.system", "rows: !!int 5"]),
        ("tags (!name): not allowed", ["rows: !mine 5", "seed: !!timestamp x"]),
    ],
)
def test_what_is_no_map_of_plain_values_is_refused(words: str, texts: list[str]) -> None:
    assert [text for text in texts if words not in refusal(text)] == []


def test_aliases_are_refused_so_nothing_can_grow() -> None:
    names = "abcdefghi"
    laughs = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in itertools.pairwise(names))
    assert "my.yaml:2: aliases (*name): not allowed" in refusal(laughs)
    assert "aliases" in refusal("a: &a {b: *a}")


@pytest.mark.parametrize("text", ["[" * 60000, "- " * 30000, "a: " + "{a: " * 10000, "? " * 30000])
def test_deep_nesting_is_refused_quickly(text: str) -> None:
    begin = time.perf_counter()
    assert "nested too deeply" in refusal(text)
    assert time.perf_counter() - begin < 1.0


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    file = tmp_path / "huge.yaml"
    with file.open("wb") as sparse:
        sparse.truncate(10**10)
    assert f"is larger than {LARGEST_FILE} bytes" in unreadable(file)
    assert f"is larger than {LARGEST_FILE} bytes" in refusal("# " + "x" * LARGEST_FILE)


@pytest.mark.parametrize(
    "text", ["rows: " + "9" * 5000, "rows: '" + "x" * 50000 + "'", '"' + "k" * 500 + '": 1', "rows: [" + "1, " * 10000 + "]"]
)
def test_a_long_value_is_shortened(text: str) -> None:
    assert len(refusal(text)) < 400
