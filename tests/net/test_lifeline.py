"""A process ends when the one that started it is gone, and says when it ends by itself; an agent
that never ends its tick is named.
"""

import logging
import os
import re
import subprocess
import sys
import threading
from types import SimpleNamespace

import psutil
import pytest
from fleet import ROOT
from patience import PATIENCE

from orchard.contract.agent import Action, Mail, without_body
from orchard.contract.guard import Guard
from orchard.launch.supervisor import ProcessSpec, Supervisor
from orchard.net import process

# A process that holds on to the one that started it, writes its number into the file `pid`, and
# waits for ever. Once the other one is gone it has 0.2 s to end, and then is ended by force.
CHILD = """\
import os, signal, sys
from pathlib import Path
from orchard.net import lifeline
lifeline.ALONE_SECONDS = 0.2
lifeline.hold_on(lambda: None)
assert sys.stdin.read() == "", "an agent that reads its input does not wait"
Path("pid.new").write_text(str(os.getpid()))
Path("pid.new").rename("pid")
while True:
    signal.pause()
"""
# A process that starts the child as run.py starts its processes, and then ends at once, without
# ending the child.
PARENT = """\
import os, sys, time
from pathlib import Path
from orchard.launch import supervisor
supervisor.Supervisor(print).start(supervisor.ProcessSpec("child", "child", []))
while not Path("pid").exists():
    time.sleep(0.05)
os._exit(0)
"""


def test_a_process_ends_when_its_parent_is_gone(tmp_path):
    (tmp_path / "child.py").write_text(CHILD)
    there = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    subprocess.run(
        [sys.executable, "-c", PARENT], cwd=tmp_path, env=there, timeout=PATIENCE, check=True
    )
    child = int((tmp_path / "pid").read_text())
    if psutil.pid_exists(child):
        process = psutil.Process(child)
        # The wait raises an error if the child does not end.
        try:
            process.wait(PATIENCE)
        finally:
            if process.is_running():
                process.kill()


@pytest.mark.parametrize(
    ("body", "exit_code", "said_code"),
    [
        ("return 0", 0, 0),
        ("return 2", 2, 2),
        ("os._exit(0)", 0, None),
        ("os._exit(100)", 100, None),
        ("os._exit(2)", 2, None),
    ],
)
def test_only_a_process_that_ends_by_itself_says_so(
    body, exit_code, said_code, tmp_path, monkeypatch
):
    """`run_process` says the exit code on the line to run.py: 0 is a good end, 2 a user's mistake.

    A process that is torn away says nothing (None), whatever its exit code is.
    """
    program = f"""\
import os, sys
from orchard.net.options import RouterOptions
from orchard.net.process import run_process
def body(inbox, options):
    {body}
sys.exit(run_process("child", RouterOptions, None, body))
"""
    (tmp_path / "child.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with Supervisor(print) as supervisor:
        # Only a program that is started again is not over once it has failed.
        supervisor.start(ProcessSpec("child", "child", [], again=True))
        supervisor.wait(PATIENCE)
        assert supervisor.exit_code("child") == exit_code
        assert supervisor.running["child"].line.code == said_code
        assert supervisor.is_over("child") == (said_code == 0)
        assert supervisor.has_refused() == (said_code == 2)


@pytest.fixture
def complaint():
    """Collect lines of the log. `there` is set when the first one has come."""
    ear = SimpleNamespace(words=[], there=threading.Event())

    class Handler(logging.Handler):
        def emit(self, record):
            ear.words.append(record.getMessage())
            ear.there.set()

    handler = Handler()
    logging.getLogger("orchard").addHandler(handler)
    yield ear
    logging.getLogger("orchard").removeHandler(handler)


def test_an_agent_that_thinks_too_long_is_named_with_the_place(complaint):
    """A thread that watches the host names the agent, and the line at which it is."""

    class Brooding:
        """Ends its tick only when the complaint has come."""

        def tick(self, observation, mail, memory):
            assert complaint.there.wait(PATIENCE)
            return Action(memory=memory)

    host = SimpleNamespace(
        thinking="picker_01", latest=SimpleNamespace(tick=7), runners=["bin_02", "picker_01"]
    )
    process.monitor(host, seconds=0.05)
    Guard("picker_01", Brooding(), ["picker_01"]).tick(without_body("picker_01", 7), Mail(), None)
    host.thinking = ""
    assert re.fullmatch(
        rf"picker_01 still thinks about tick 7, in {re.escape(__file__)}, line \d+; until .* stand:"
        r" bin_02",
        complaint.words[0],
    )
