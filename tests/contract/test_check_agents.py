"""`--check-agents` tells which own agents are not repeatable, with the tick and the difference."""

import re

import pytest
import unrepeatable
from command_line import orchard
from local_runs import SMALL, local_hash

from orchard.field.scenario import to_yaml
from orchard.local import Local


def with_picker(class_):
    return SMALL.model_copy(update={"agents": {"picker_01": f"unrepeatable.{class_}"}})


def checked(class_, ticks=6):
    local = Local(with_picker(class_), check_agents=True)
    for _ in range(ticks):
        local.tick()
    return local


@pytest.mark.parametrize(
    ("class_", "words"),
    [
        ("Clockwork", r"tick \d: its answer\.twist: Twist"),
        ("Chancy", r"tick 0: its answer\.twist: Twist\(x=0\.\d+, .*\), then Twist"),
        ("Unseeded", r"tick 0: its answer\.twist"),
        ("Counting", r"tick 1: its answer\.twist: Twist\(x=0\.02, .*\), then Twist\(x=0\.01"),
        ("Latch", r"tick 4: its answer\.twist: Twist\(x=0\.0, .*\), then Twist\(x=0\.25"),
        ("Shared", r"tick 0: its answer\.twist"),
        ("Diary", r"tick 1: its answer\.memory\['asked'\]\[0\]: 2, then 1"),
        ("Tired", r"tick 0: its answer: an action, then, asked again, RuntimeError: asked again"),
    ],
)
def test_what_is_not_repeatable_is_logged_once_with_agent_tick_and_place(class_, words, caplog, monkeypatch):
    monkeypatch.setattr(unrepeatable, "SHARED", {"count": 0})
    local = checked(class_)
    (record,) = caplog.records
    assert re.match(f"picker_01 is not repeatable, {words}", record.getMessage())
    assert local.actions["picker_01"].state == "broken"


@pytest.mark.parametrize("class_", ["Tidy", "OwnPicker"])
def test_what_is_repeatable_is_not_told_and_runs_as_without_the_check(class_, caplog):
    local = checked(class_, 40)
    assert not caplog.records
    assert local.engine.hash == local_hash(with_picker(class_), 40)


def test_an_agent_that_local_mode_is_given_is_checked_too(caplog):
    local = Local(SMALL, check_agents=True)
    local.play("picker_02", unrepeatable.Counting(None, "picker_02"))
    local.tick()
    local.tick()
    assert "picker_02 is not repeatable, tick 1: its answer.twist" in caplog.text


@pytest.mark.parametrize(("mode", "tick", "seconds"), [("local", "1", 1), ("lockstep", "1", 1), ("realtime", r"\d+", 3)])
def test_the_command_line_checks_agents_and_exits_with_1(mode, tick, seconds, tmp_path):
    """In realtime a busy host may leave the first ticks out."""
    path = tmp_path / "own.yaml"
    path.write_text(to_yaml(SMALL.model_copy(update={"agents": {"picker_01": "tests.support.unrepeatable.Counting"}})))
    done = orchard(path, "--check-agents", "--mode", mode, "--duration", seconds, "--record", "none")
    said = done.stdout + done.stderr
    assert done.returncode == 1, said
    assert re.search(f"picker_01 is not repeatable, tick {tick}: its answer.twist: ", said), said
    assert re.search(f"broken: picker_01, since tick {tick}", said), said
