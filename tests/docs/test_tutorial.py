"""The tutorial, done step by step as it stands: its files, its commands, and the output that it shows."""

import subprocess
import sys

import pytest
from code_blocks import ROOT, block, blocks, commands
from command_line import SECONDS, line_with, summary_of
from local_runs import local_hash

from orchard.field.scenario import Scenario
from orchard.launch.supervisor import free_port

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()
STEPS = {step.splitlines()[0]: blocks(step) for step in TUTORIAL.split("\n## ")[1:]}


def run_in(folder, command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("step", [step for step in STEPS if "machine" not in step])
def test_a_step_of_the_tutorial(step, tmp_path):
    said = ""
    for part in STEPS[step]:
        if part.name:
            (tmp_path / part.name).write_text(part.text)
        elif part.language == "python":
            said = run_in(tmp_path, [sys.executable, "-c", part.text])
        elif part.language == "text":
            assert said == part.text, "the tutorial shows another output"
        else:
            for command in commands(part.text):
                run_in(tmp_path, [*command, "--duration", "60", *([] if "--record" in command else ["--record", "run.rrd"])])


def test_the_two_terminals_of_the_tutorial(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    terminals = [block("docs/tutorial.md", f"{number} terminal") for number in ("first", "second")]
    (first,), (second,) = (commands(text.replace("tcp/127.0.0.1:7447", endpoint)) for text in terminals)
    first += ["--duration", "30", "--record", "none", "--summary", str(tmp_path / "summary.json")]
    with subprocess.Popen(first, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as one:
        try:
            line_with("carrier: left to other processes", one)
            run_in(tmp_path, second)
            one.communicate(timeout=SECONDS)
        finally:
            one.kill()
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 300)
