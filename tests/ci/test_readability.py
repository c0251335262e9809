"""The measure of how the code reads: it sees each thing that it is about, and leaves alone what is
like it.
"""

import importlib.util
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / ".ci" / "readability.py"

# Measure -> code that it counts once, code that it does not count. A comment behind code only
# continues the code if it begins with a small letter that is no unit.
SEEN = {
    "tuple_assignments": ("names, count = [], 0", "first, last = last, first\nx, y = 0.0, 1.0"),
    "conditionals": ("(low, high)[is_full]", "if is_full:\n    fill = high"),
    "nested_conditionals": ("a if b else c if d else e", "a if b else c"),
    "comprehensions": ("[row for row in rows]", "for row in rows:\n    row.pick()"),
    "nested_comprehensions": ("[bin for row in rows for bin in row]", "[row for row in rows]"),
    "positional_arguments": ("f(1, 2, 3, 4, 5, 6)", "f(1, 2, 3, 4, 5, six=6)"),
    "long_lambdas": (
        "key = lambda carrier: carrier.seconds_until_free + 2.0",
        "key = lambda carrier: carrier.name",
    ),
    "long_chains": ("self.run.layout.queue.head", "self.layout.queue.head"),
    "mixed_and_or": ("a or b and c", "a or (b and c)"),
    "continued_comments": ("x = 1  # which nobody reads", "x = 1  # m, of the row\n# A sentence."),
    "vague_names": ("one = rows[0]", "first_row = rows[0]"),
    "bare_functions": ("def f():\n    pass", 'def f():\n    """Do it."""'),
    "long_test_names": (
        "def test_a_robot_that_has_worked_for_longer_than_was_drawn_goes_on(): ...",
        "def test_an_overdue_failure_strikes_on_the_next_drive(): ...",
    ),
    "double_classes": ("class Run:\n    pass\nclass Run:\n    pass", "class Run:\n    pass"),
}


@pytest.fixture(scope="module")
def readability():
    spec = importlib.util.spec_from_file_location("readability", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["readability"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["readability"]


def counts(readability, monkeypatch, tmp_path: Path, code: str) -> dict[str, int]:
    """Return how often each measure counts something in a piece of code."""
    monkeypatch.setattr(readability, "ROOT", tmp_path)
    (tmp_path / "code.py").write_text(code + "\n")
    area = readability.measured("code", [tmp_path / "code.py"])
    return {measure: len(area.places[measure]) for measure in readability.MEASURES}


@pytest.mark.parametrize("measure", SEEN)
def test_a_measure_counts_what_it_is_about(readability, monkeypatch, tmp_path, measure):
    bad, good = SEEN[measure]
    expected = 2 if measure == "double_classes" else 1
    assert counts(readability, monkeypatch, tmp_path, bad)[measure] == expected
    assert counts(readability, monkeypatch, tmp_path, good)[measure] == 0


def test_two_files_of_tests_with_one_name_are_counted(readability, monkeypatch, tmp_path):
    monkeypatch.setattr(readability, "ROOT", tmp_path)
    files = [tmp_path / "app" / "test_page.py", tmp_path / "view" / "test_page.py"]
    for file in files:
        file.parent.mkdir()
        file.write_text("")
    area = readability.measured("tests", files)
    assert area.places["double_files"] == ["app/test_page.py", "view/test_page.py"]


def test_each_measure_has_an_example(readability):
    assert {*SEEN, "double_files"} == set(readability.MEASURES)


LIMITS = """# A comment stays.
[product]
folders = ["."]

[product.limits]
conditionals = 0.5
vague_names = 1500
"""


def test_a_limit_falls_to_the_figure_of_today_and_never_rises(readability, monkeypatch, tmp_path):
    monkeypatch.setattr(readability, "ROOT", tmp_path)
    monkeypatch.setattr(readability, "LIMITS", tmp_path / "limits.toml")
    (tmp_path / "limits.toml").write_text(LIMITS)
    (tmp_path / "code.py").write_text("one = rows[0]\nrow = first if early else last\n")
    monkeypatch.setattr(sys, "argv", ["readability.py", "--lower"])
    assert readability.main() == 1, "a conditional in two statements is 500 for 1,000, not 0.5"
    lowered = (tmp_path / "limits.toml").read_text()
    assert lowered == LIMITS.replace("1500", "500")
