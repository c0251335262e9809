"""What the page says of a run before its first figures."""

from orchard.app.getting_ready import compiled_count, getting_ready_words
from orchard.sim.kernels.cache import COMPILING


def test_the_first_run_of_a_machine_says_what_is_compiled():
    """Of the lines that the run has printed, the first and the newest are shown."""
    lines = [COMPILING, "getting ready: 0:10 so far", "getting ready: 0:20 so far"]
    words = getting_ready_words(lines, 17)
    assert (
        words == f"starting: {COMPILING}; getting ready: 0:20 so far; parts that are compiled: 17"
    )


def test_any_other_run_says_what_it_does():
    assert getting_ready_words([], 40) == "starting"
    assert getting_ready_words(["physics is up"], 40) == "starting: physics is up"
    assert getting_ready_words([*"abc"], 40) == "starting: a; c"


def test_the_address_of_a_picture_is_no_news():
    """The page shows the picture, so its address is nothing to read."""
    lines = ["physics is up", "Live: http://127.0.0.1:54521/?url=rerun%2Bhttp"]
    assert getting_ready_words(lines, 40) == "starting: physics is up"


def test_parts_are_counted_while_they_are_compiled(tmp_path, monkeypatch):
    monkeypatch.setattr("orchard.app.getting_ready.kernels_folder", lambda: tmp_path / "kernels")
    assert compiled_count() == 0, "there is no folder yet"
    (tmp_path / "kernels" / "laser").mkdir(parents=True)
    for number in range(3):
        (tmp_path / "kernels" / "laser" / f"{number}.nbc").touch()
    assert compiled_count() == 3
    monkeypatch.setattr("orchard.app.getting_ready.kernels_folder", lambda: None)
    assert compiled_count() == 0, "nothing can be kept on this disk"
