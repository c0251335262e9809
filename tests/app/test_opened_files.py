"""Files that are opened on the page: what is refused, and which classes of a file may run."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest

from orchard.app.own_classes import from_elsewhere
from orchard.app.page import Page
from orchard.field.scenario import Scenario


class Upload:
    """A file that is sent to the page. `was_read`: whether the page has asked for its content."""

    def __init__(self, name, content):
        self.name = name
        self._content = content
        self.was_read = False

    def size(self):
        return len(self._content)

    async def read(self):
        self.was_read = True
        return self._content


@pytest.fixture
def upload(monkeypatch):
    """Return a function that sends a file to a page without a browser.

    It returns the lines of the complaint, and whether the page has read the file.
    """
    complaint = []
    monkeypatch.setattr("orchard.app.page.complain", lambda title, lines: complaint.extend(lines))
    # A page without its elements: `__init__` would need a browser.
    page = Page.__new__(Page)
    page._upload = SimpleNamespace(reset=lambda: None)

    def send(name, content):
        file = Upload(name, content)
        asyncio.run(page._open(SimpleNamespace(file=file)))
        return complaint, file.was_read

    return send


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"rows: 5\0", "is not YAML: unacceptable character #x0000"),
        ("rows: 5".encode("utf-16"), "not UTF-8 text"),
        (b"\x89PNG\r\n\x1a\n", "not UTF-8 text"),
        (b"#" * 70_000, "is larger than 65536 bytes"),
        (b"a: &a [*a]", "aliases (*name): not allowed in a scenario"),
        (b"!!python/object/apply:os.system ['true']", "tags (!name): not allowed"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused_in_a_line(upload, content, words):
    (line,), _ = upload("orchard.yaml", content)
    assert line.startswith("orchard.yaml")
    assert words in line


def test_a_file_that_is_far_too_large_is_not_read(upload):
    """A browser refuses such a file before it is sent. Another program sends it all the same."""
    (line,), was_read = upload("orchard.yaml", b"#" * 1_000_000)
    assert "too large" in line
    assert not was_read


def test_the_name_of_a_file_is_shown_short_and_harmless(upload):
    """The name has an escape sequence, a mark that turns the direction of text, and 5,000 letters.

    A complaint of under 300 characters fits into the dialog.
    """
    (line,), _ = upload("\x1b[31m\u202e" + "x" * 5000, b"\0")
    assert line.isprintable()
    assert len(line) < 300


def test_of_many_mistakes_in_a_file_some_are_named(upload):
    """The first 50 are, and a line says how many more there are."""
    unknown_keys = "".join(f"k{number}: 1\n" for number in range(200))
    lines, _ = upload("orchard.yaml", unknown_keys.encode())
    assert len(lines) == 51
    assert lines[-1] == "and 150 more problems"


def test_own_classes_are_of_the_start_directory_and_do_not_run(tmp_path, monkeypatch):
    """A class counts as the user's own if its module is in the directory of the start.

    To look for a module does not run it.
    """
    (tmp_path / "mine.py").write_text("raise SystemExit('it ran')")
    (tmp_path / "yours").mkdir()
    (tmp_path / "yours" / "there.py").touch()
    (tmp_path / "yours" / "far").mkdir()
    (tmp_path / "yours" / "far" / "off.py").touch()
    # `lib` is in the directory and on the path, as libraries in `.venv` are: not the user's own.
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "deeper.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    inside = {
        "picker": "mine.Picker",
        "carrier": "yours.there.Carrier",
        "bin": "mine:Bin",
        "cat": "yours.far.off.Cat",
    }
    outside = {
        "tractor": "subprocess.Popen",
        "dog": "sys.exit",
        "dog_02": "numpy.load",
        "worker": "no.A",
        "weed": "tests.support.own_agents.Rude",
        "visitor": "deeper.Visitor",
    }
    refused = from_elsewhere(Scenario(agents=inside | outside).own_classes, tmp_path)
    assert [line.partition(":")[0] for line in refused] == list(outside)
    assert from_elsewhere({"weed": "bench.field.Weed"}, Path.cwd()) == []


def test_a_module_that_is_found_elsewhere_first_is_no_own_one(tmp_path, monkeypatch):
    """A module of the same name stands earlier on the path, so the folder's own would not run.

    Nor is a class allowed whose module does not exist (`plain.inner`: `plain` is no package).
    """
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "shadowed.py").touch()
    (tmp_path / "shadowed.py").touch()
    (tmp_path / "plain.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    classes = {"picker": "shadowed.Picker", "carrier": "plain.inner.Carrier", "bin": "plain.Bin"}
    refused = from_elsewhere(classes, tmp_path)
    assert [line.partition(":")[0] for line in refused] == ["picker", "carrier"]
