"""What own classes print, and the threads that they leave: shown as lines of the program, a few of them, and nobody waits for them."""

import re
import subprocess
import sys

import pytest
from code_blocks import ROOT
from command_line import SECONDS
from local_runs import SMALL

from orchard.contract.printed import MOST_LINES, Printed
from orchard.field.scenario import to_yaml
from orchard.launch.supervisor import MOST_LINES as UNNAMED


def test_the_first_lines_are_shown_and_the_rest_is_left_out():
    said = []
    stream = Printed(said.append)
    for words in ("one", " \x1b[2J\ntwo\n", "x" * 300 + "\n", "a\n" * 100, "b\n" * 10**6):
        assert stream.write(words) == len(words)
    assert said[:2] == ["printed: one ?[2J", "printed: two"]
    assert len(said[2]) == len("printed: ") + 200
    assert len(said) == MOST_LINES + 1
    assert said[-1] == "what own classes print from here on is left out; write it to a file"


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_an_agent_that_prints_much_and_leaves_a_thread_neither_floods_the_terminal_nor_holds_the_run(mode, tmp_path):
    path = tmp_path / "noisy.yaml"
    path.write_text(to_yaml(SMALL.model_copy(update={"agents": {"picker_01": "tests.support.own_agents.Noisy"}})))
    command = [sys.executable, ROOT / "run.py", path, "--mode", mode, "--duration", "1", "--record", "none"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, cwd=ROOT)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert said.count(": Injected?[2J") < MOST_LINES
    assert 0 < said.count("Written Injected?[2J") <= UNNAMED
    assert re.search(r"printed, in .*own_agents\.py, line \d+: Injected", said)
    assert "own classes have left threads that still run: Thread-" in said
    assert all(line.isprintable() for line in said.split("\n"))
