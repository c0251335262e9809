"""`--check-agents` tells which own agents are not repeatable, with the tick and the difference."""

import re

import pytest
import unrepeatable
from command_line import orchard
from local_runs import SMALL, local_hash

from orchard.field.scenario import to_yaml
from orchard.local import Local

FILE = re.escape(unrepeatable.__file__)


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
        ("Clockwork", rf"tick 0: it calls time\.monotonic \({FILE}, line \d+\)"),
        ("Dated", r"tick 0: it calls datetime\.now"),
        ("Chancy", rf"tick 0: it calls random numbers without the seed, random \({FILE}, line \d+\)"),
        ("Chancy", r"its answer's twist: Twist\(x=0\.\d+, .*\), then Twist"),
        ("Dice", r"tick 0: the global state of numpy\.random"),
        ("Unseeded", r"its answer's twist"),
        ("Counting", r"tick 0: its attribute self\.count: 0, then 1"),
        ("Latch", r"tick 4: its answer's twist: Twist\(x=0\.0, .*\), then Twist\(x=0\.25"),
        ("Global", r"tick 0: the global unrepeatable\.COUNT: \d+, then \d+"),
        ("Poster", r"tick 0: the global unrepeatable\.BOARD"),
        ("Shared", r"tick 0: the class attribute Driver\.seen"),
        ("Late", r"tick 0: the class attribute Late\.count"),
        ("Enclosed", r"tick 0: the variable count around counter"),
        ("OwnDice", r"tick 0: its attribute self\.chance"),
    ],
)
def test_what_is_not_repeatable_is_told_once_with_agent_and_tick(class_, words, caplog):
    local = checked(class_)
    (first, *more) = [record.getMessage() for record in caplog.records]
    assert first.startswith("picker_01 is not repeatable, tick ")
    assert re.search(words, first)
    assert len(more) <= 1
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
    assert "picker_02 is not repeatable, tick 0: its attribute self.count" in caplog.text


@pytest.mark.parametrize(("mode", "tick", "seconds"), [("local", "0", 1), ("lockstep", "0", 1), ("realtime", r"\d+", 3)])
def test_the_command_line_checks_agents_and_exits_with_1(mode, tick, seconds, tmp_path):
    """In realtime a busy host may leave the first ticks out."""
    path = tmp_path / "own.yaml"
    path.write_text(to_yaml(SMALL.model_copy(update={"agents": {"picker_01": "tests.support.unrepeatable.Counting"}})))
    done = orchard(path, "--check-agents", "--mode", mode, "--duration", seconds, "--record", "none")
    said = done.stdout + done.stderr
    assert done.returncode == 1, said
    assert re.search(f"picker_01 is not repeatable, tick {tick}: its attribute self.count: 0, then 1", said), said
    assert re.search(f"broken: picker_01, since tick {tick}", said), said
