"""What an own class sets, prints or leaves behind counts within its own call: it changes no other
agent, not the program, and no hash.
"""

import ctypes
import decimal
import importlib
import platform
import re
import signal
import sys
from traceback import walk_stack

import numpy as np
import pytest
from command_line import PATH, python, scenario_file
from local_runs import SMALL, driven_by, local_hash, played

from orchard.contract.agent import Action
from orchard.contract.printed import MOST_LINES, Printed, printed
from orchard.contract.zone import spans
from orchard.discrete.harvest import DiscreteHarvest
from orchard.dispatch.ranking import Nearest
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.rows import balanced, rows_to_pickers
from orchard.field.scenario import with_changes
from orchard.launch.supervisor import MOST_LINES as MOST_LINES_OF_C_CODE
from orchard.local import Local
from orchard.processes.agents import made

# C's `fegetenv` gives the floating-point environment of an x86-64 as eight 32-bit words. The last
# is the control word MXCSR, in which these bits flush small numbers to zero.
MXCSR = 7
FLUSH_TO_ZERO = 0x8040
# FE_UPWARD of C's fenv.h: rounds each result up.
UPWARD = 0x800


def flush_to_zero():
    """Set the processor as a C library does that was compiled with -ffast-math."""
    environment = (ctypes.c_uint32 * 8)()
    ctypes.CDLL(None).fegetenv(environment)
    environment[MXCSR] |= FLUSH_TO_ZERO
    ctypes.CDLL(None).fesetenv(environment)


needs_x86 = pytest.mark.skipif(platform.machine() != "x86_64", reason="its flags are those of x86")
# Each changes a setting of the whole process. The limit of recursion leaves 30 calls more.
SETTINGS = [
    lambda: np.seterr(all="raise"),
    lambda: decimal.getcontext().__setattr__("prec", 3),
    lambda: sys.setrecursionlimit(len([*walk_stack(None)]) + 30),
    pytest.param(flush_to_zero, marks=needs_x86),
    pytest.param(lambda: ctypes.CDLL(None).fesetround(UPWARD), marks=needs_x86),
]


def state():
    """Return what SETTINGS change: two modes, a limit, and two results.

    Flushed to zero the smallest number times 1 is 0. Rounded up, 1 + 1e-17 is more than 1.
    """
    return (
        np.geterr(),
        decimal.getcontext().prec,
        sys.getrecursionlimit(),
        np.float64(5e-324) * 1,
        np.float64(1.0) + 1e-17,
    )


def setting():
    """Do nothing. Each test puts one of SETTINGS in place of this function."""


def rule(scenario):
    """Give rows to pickers as the built-in rule does, and change a setting."""
    setting()
    return balanced(scenario)


def factory(layout, names):
    """Make no agents, and change a setting."""
    setting()
    return dict.fromkeys(names)


class Setter:
    """Drives on, and changes a setting when it is made and at each tick."""

    Memory = dict

    def __init__(self, layout, name):
        setting()

    def tick(self, observation, mail, memory):
        setting()
        return Action(Twist(x=0.25), memory=memory)


class SettingNearest(Nearest):
    """Decides as `nearest`, and changes a setting at each decision."""

    def assign(self, now, bins, carriers, memory):
        setting()
        return super().assign(now, bins, carriers, memory)


def local(**changes):
    """Make agents, and run for three ticks."""
    played(SMALL.model_copy(update=changes), 3)


# Each place where code of a user is called -> a function that does it.
PLACES = {
    "agent": lambda: local(agents={"picker_01": f"{__name__}.Setter"}),
    "module": lambda: local(agents={"picker_01": "sets_it.Setter"}),
    "module of a factory": lambda: made("sets_it:factory", lay_out(SMALL), ["picker_01"]),
    "factory": lambda: made(f"{__name__}:factory", lay_out(SMALL), ["picker_01"]),
    "rule": lambda: rows_to_pickers(
        SMALL.model_copy(update={"rows_to_pickers": f"{__name__}.rule"})
    ),
    "policy": (
        lambda: DiscreteHarvest(
            lay_out(SMALL.model_copy(update={"dispatch": f"{__name__}.SettingNearest"}))
        ).run()
    ),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("set_it", SETTINGS)
def test_what_an_own_class_sets_is_as_before_afterwards(set_it, place, tmp_path, monkeypatch):
    """Each of SETTINGS is changed at each of PLACES, and has its old value after that."""
    # A module that changes a setting when it is imported.
    (tmp_path / "sets_it.py").write_text(
        f"import {__name__} as test\ntest.setting()\nfrom {__name__} import *"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "sets_it", raising=False)
    importlib.invalidate_caches()
    asked = []
    monkeypatch.setattr(sys.modules[__name__], "setting", lambda: asked.append(set_it()))
    before = state()
    flags = (ctypes.c_uint32 * 8)()
    ctypes.CDLL(None).fegetenv(flags)
    try:
        PLACES[place]()
        assert state() == before
        assert asked
    finally:
        # If it fails, no other test must suffer.
        ctypes.CDLL(None).fesetenv(flags)
        np.seterr(**before[0])
        decimal.getcontext().prec = before[1]
        sys.setrecursionlimit(before[2])


@pytest.mark.parametrize("set_it", SETTINGS)
def test_what_an_own_agent_sets_changes_no_hash(set_it, monkeypatch):
    own = SMALL.model_copy(update={"agents": {"picker_01": f"{__name__}.Setter"}})
    plain = local_hash(own, 40)
    monkeypatch.setattr(sys.modules[__name__], "setting", set_it)
    assert local_hash(own, 40) == plain


def test_what_the_users_own_program_sets_changes_no_hash():
    plain = local_hash(SMALL, 40)
    # `spans` divides by zero, and keeps its results.
    spans.cache_clear()
    with np.errstate(all="raise"):
        assert local_hash(SMALL, 40) == plain


def in_the_simulator(scenario):
    """Do a run until its policy has been asked at least once."""
    local = Local(scenario)
    for _ in range(400):
        local.tick()


def in_the_event_model(scenario):
    """Do a whole harvest."""
    DiscreteHarvest(lay_out(scenario)).run()


def test_the_first_lines_are_shown_and_the_rest_is_left_out():
    """A line may be printed in parts. Of it 200 characters are shown, and no escape sequence."""
    lines = []
    stream = Printed(lines.append)
    for words in ("one", " \x1b[2J\ntwo\n", "x" * 300 + "\n", "a\n" * 100, "b\n" * 10**6):
        assert stream.write(words) == len(words)
    assert lines[:2] == ["printed: one ?[2J", "printed: two"]
    assert len(lines[2]) == len("printed: ") + 200
    assert len(lines) == MOST_LINES + 1
    assert lines[-1] == "what own classes print from here on is left out; write it to a file"


@pytest.mark.parametrize("run", [in_the_simulator, in_the_event_model])
def test_a_line_that_a_policy_prints_has_the_policys_place(run):
    """In the simulator an agent of the program asks the policy: its place would help nobody."""
    lines = []
    with printed(lines.append):
        run(with_changes(SMALL, dispatch="own_policies.Talking"))
    assert re.fullmatch(r"printed, in .*own_policies\.py, line \d+: I decide", lines[0])


@pytest.mark.parametrize(
    ("policy", "code", "told"),
    [
        ("Ending", 1, r"your own code ended the program by os\._exit\(0\), in .*, line \d+"),
        ("Crashing", -signal.SIGABRT, r"(?s)Fatal Python error: Aborted.*, line \d+ in assign"),
    ],
)
def test_a_policy_that_ends_the_program_is_told(policy, code, told, tmp_path):
    """Local mode has one process. Without a word, and with the code 0, it would look like a good
    run.
    """
    path = scenario_file(tmp_path, with_changes(SMALL, dispatch=f"own_policies.{policy}"))
    done = python("run.py", path, "--mode", "local", "--record", "none", code=code, PYTHONPATH=PATH)
    assert re.search(told, done.stderr)
    assert "own_policies.py" in done.stderr


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_an_agent_that_prints_and_leaves_a_thread_is_contained(mode, tmp_path):
    """What it prints does not flood the terminal, and its thread does not hold the run."""
    path = scenario_file(tmp_path, driven_by(picker_01="Noisy"))
    done = python(
        "run.py", path, "--mode", mode, "--duration", 1, "--record", "none", PYTHONPATH=PATH
    )
    output = done.stdout + done.stderr
    # `Printed` leaves out what Python prints beyond its limit, and the supervisor what C code
    # writes.
    assert output.count(": Injected?[2J") < MOST_LINES
    assert 0 < output.count("Written Injected?[2J") <= MOST_LINES_OF_C_CODE
    assert re.search(r"printed, in .*own_agents\.py, line \d+: Injected", output)
    assert "own classes have left threads that still run: Thread-" in output
    assert all(line.isprintable() for line in output.split("\n"))
