"""Robots that others drive: the own agent of docs/how-to.md, a client that knows only keyspace.md,
and classes that a scenario names.
"""

import re
import subprocess
import sys
import threading
from contextlib import contextmanager

import own_agents
import pytest
from code_blocks import ROOT, block
from command_line import orchard, python, scenario_file
from fleet import Client
from local_runs import SMALL, driven_by, local_hash, played
from patience import PATIENCE
from recordings import texts_in

from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import STATES, Action
from orchard.contract.messages import pack, unpack
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import parse
from orchard.launch.supervisor import free_port
from orchard.local import Local
from orchard.processes.agents import made
from orchard.wire.messages import Report


def with_picker_01(agent_class):
    """Return the hash of 40 ticks with a class as picker_01."""
    layout = lay_out(SMALL)
    return local_hash(
        SMALL, 40, make_agents(layout) | {"picker_01": agent_class(layout, "picker_01")}
    )


@pytest.mark.processes
def test_the_documents_agent_drives_a_picker(fleet):
    fleet.physics(SMALL, "--duration", "4")
    fleet.host("--without", "picker_01")
    code = block("docs/how-to.md", "own agent")
    assert len(code.splitlines()) <= 18
    python("-c", code.replace("tcp/127.0.0.1:7447", fleet.endpoint))
    assert fleet.end() != local_hash(SMALL, 40)


@pytest.mark.processes
def test_a_client_that_knows_only_keyspace_drives_a_picker(fleet):
    fleet.physics(SMALL, "--duration", "4")
    fleet.host("--without", "picker_01")
    assert (
        python("examples/foreign_client.py", fleet.endpoint, "picker_01").stdout
        == "40 ticks answered\n"
    )
    fleet.end()


@pytest.mark.processes
def test_a_client_before_the_run_asks_until_it_answers(fleet):
    """A queryable that gives no reply tells when the client has asked in vain."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fleet.router(endpoint)
    asked = threading.Event()
    with Client.open(endpoint, "") as someone, asking(endpoint, "picker_01") as client:
        silent = someone.session.declare_queryable("orchard/scenario", lambda query: asked.set())
        assert asked.wait(PATIENCE)
        silent.undeclare()
        fleet.physics(SMALL, "--duration", "4", "--connect", endpoint)
        fleet.host("--without", "picker_01")
        out, errors = client.communicate(timeout=PATIENCE)
    assert out == "40 ticks answered\n"
    assert errors == ""
    fleet.end()


@pytest.mark.processes
def test_a_client_whose_robot_is_taken_ends_with_the_reason(fleet):
    fleet.physics(SMALL, "--speed", "10")
    fleet.host()
    fleet.client().hear("orchard/clock").get(timeout=PATIENCE)
    done = python("examples/foreign_client.py", fleet.endpoint, "picker_01", code=1)
    assert "refused: {'picker_01': 'it is taken" in done.stderr
    fleet.stop()


@contextmanager
def asking(endpoint, name):
    """Start the client of keyspace.md, and do not wait for it."""
    command = [sys.executable, "examples/foreign_client.py", endpoint, name]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=ROOT, **pipes) as client:
        yield client
        client.kill()


def test_a_client_that_only_drives_begins_at_tick_0(fleet):
    """A client that only publishes velocities need not join. Until the first one physics waits."""
    fleet.physics(SMALL, "--duration", "2")
    fleet.host("--without", "picker_01")
    assert any(
        fleet.world.error() == "physics: waiting for 1 agents: picker_01\n" for _ in range(10)
    )
    fleet.client().drive("picker_01", 0, 0.5)
    fleet.end()


@pytest.mark.processes
def test_a_name_that_is_taken_is_refused_to_an_own_agent_as_well(fleet):
    fleet.physics(SMALL, "--speed", "10")
    fleet.host()
    code = block("docs/how-to.md", "own agent").replace("tcp/127.0.0.1:7447", fleet.endpoint)
    fleet.client().hear("orchard/clock").get(timeout=PATIENCE)
    assert "picker_01: it is taken" in python("-c", code, code=1).stderr


def test_an_agent_given_to_local_mode_drives_as_a_named_class():
    given = played(SMALL, 40, picker_01=own_agents.Eastward(None, "picker_01"))
    named = played(driven_by(picker_01="Eastward"), 40)
    assert list(given.agents) == list(named.agents)
    assert given.engine.hash == named.engine.hash
    assert named.engine.hash == with_picker_01(own_agents.Eastward)


def test_an_agent_that_takes_over_gets_no_foreign_memory():
    """It takes over at tick 2 from an agent of another class, and at tick 4 from one of its own."""
    local = Local(SMALL)
    memories = []

    class Counter:
        Memory = list[int]

        def tick(self, observation, mail, memory):
            memories.append(memory)
            return Action(memory=[*(memory or ()), observation.tick])

    for tick in range(6):
        if tick in (2, 4):
            local.play("picker_01", Counter())
        local.tick()
    assert memories == [None, [2], [2, 3], [2, 3, 4]]


def test_only_an_agent_that_is_there_can_be_replaced():
    with pytest.raises(ValueError, match=r"picker_99: no such agent; there are .*picker_01"):
        Local(SMALL).play("picker_99", own_agents.Eastward(None, "picker_99"))


def test_a_class_of_the_scenario_drives_alike_in_every_mode(fleet):
    own = driven_by(picker="Eastward")
    local = played(own, 40)
    assert local.actions["picker_01"].doing == local.actions["picker_02"].doing
    assert local.actions["picker_02"].doing == "driving on"
    fleet.physics(own, "--duration", "4")
    fleet.share(2)
    assert fleet.end() == local.engine.hash != local_hash(SMALL, 40)


def test_a_mistake_of_one_agent_changes_no_other_in_any_mode(fleet):
    """`Mischief` makes another mistake every second tick, and goes on in between."""
    own = driven_by(picker_01="Mischief")
    ticks = 2 * len(own_agents.MISCHIEF)
    local = played(own, ticks)
    broken = local.engine.states.counts.ticks["picker_01"][STATES.index("broken")]
    assert broken == len(own_agents.MISCHIEF) - 1, "all but the text are refused"
    fleet.physics(own, "--duration", str(ticks / 10))
    fleet.share(2)
    code, out, err = fleet.world.end()
    assert (code, local.engine.hash in out) == (1, True), out + err
    hosts = [host.end(PATIENCE) for host in fleet.hosts]
    assert [code for code, _, _ in hosts] == [0, 0]
    assert sum(err.count("raised an error") for _, _, err in hosts) == 1, (
        "only picker_01, and logged once"
    )


def test_texts_of_agents_are_printable_for_people(tmp_path):
    """What an agent says is printable in each place where a person reads it."""
    recording = tmp_path / "run.rrd"
    done = orchard(
        scenario_file(tmp_path, driven_by(picker_01="Injector")),
        "--hosts",
        2,
        "--duration",
        3,
        "--record",
        recording,
        code=1,
    )
    output = done.stdout + done.stderr
    assert "Injected" in output
    assert all(line.isprintable() for line in output.split("\n"))
    assert not re.search("^physics: all is well", output, re.M)
    texts = texts_in(recording)
    assert {True} == {
        any(words in text for text in texts)
        for words in ("here is Injected", "Injected?[2J", "deed refused")
    }
    assert [text for text in texts if not text.replace("\n", "").isprintable()] == []


def test_texts_of_a_foreign_client_are_printable_at_physics():
    action = unpack(pack({"doing": own_agents.ESCAPE, "waits_for": own_agents.ESCAPE}), Report)
    assert action.doing.startswith("Injected?[2J")
    assert action.doing.isprintable()
    assert action.waits_for.isprintable()


def test_a_name_counts_more_than_a_kind():
    """picker_01 has the class of its name, picker_02 that of all pickers, which has no `tick`."""
    local = played(driven_by(picker_01="Eastward", picker="Forgetful"), 1)
    assert [local.actions[name].doing for name in ("picker_01", "picker_02")] == [
        "driving on",
        "broken",
    ]


# A class, and what is said of it.
MISTAKES = [
    ("own_agents.Forgetful", r"no method tick.*own_agents\.py, line \d+"),
    ("own_agents:Unmakeable", r"LookupError: no map \(.*own_agents\.py, line \d+"),
    ("own_agents.Nowhere", "has no attribute 'Nowhere'"),
    (
        "nowhere_at_all.Agent",
        (
            "No module named 'nowhere_at_all'; modules are imported from the directory in which"
            " you run"
        ),
    ),
    (
        "own_agents.Nameless",
        (
            r"takes no arguments; the program calls it with \(layout, name\) \(.*own_agents\.py,"
            r" line \d+"
        ),
    ),
    ("own_agents.Wrong", "each number must be from -100 to 100"),
    ("own_agents.Quitter", r"raised an error at tick 0(.|\n)*SystemExit: 3"),
    ("own_agents.Refuser", r"SystemExit: no licence \(.*own_agents\.py, line \d+"),
    ("own_agents.Speechless", "Messages must be a tuple of classes"),
]


@pytest.mark.parametrize(("class_", "words"), MISTAKES)
def test_a_mistake_is_told_with_its_place_and_others_go_on(class_, words, caplog):
    local = played(SMALL.model_copy(update={"agents": {"picker_01": class_}}), 10)
    (record,) = [record for record in caplog.records if "picker_01" in record.getMessage()]
    assert re.search(words, record.getMessage())
    assert local.actions["picker_01"].doing == "broken"
    assert local.engine.observe()["picker_01"].twist.x == 0.0
    assert local.actions["picker_02"].doing != "broken"


NO_MAP = "a map of kinds .* or names and the classes"
NO_CLASS = "must be the class that drives it, such as"
NO_KIND = r"not a kind \(picker, .*\) and not a name such as picker_01"


NO_CLASSES = [
    ("5", NO_MAP),
    ("{picker: 5}", NO_CLASS),
    ("{picker: MyPicker}", NO_CLASS),
    ("{picker: 'a b.C'}", NO_CLASS),
    ("{piker: a.B}", NO_KIND),
    ("{'[key]': a.B}", NO_KIND),
]


@pytest.mark.parametrize(("value", "why"), NO_CLASSES)
def test_what_is_no_class_or_no_kind_is_named(value, why):
    with pytest.raises(ScenarioError, match=why):
        parse(f"agents: {value}")


@pytest.mark.parametrize(
    ("function", "mistake"),
    [
        ("lost", r"LookupError: no map \(.*own_agents.py, line \d+\)"),
        ("nobody", "KeyError: 'picker_01'"),
        ("none", "no attribute 'none'"),
    ],
)
def test_a_function_that_makes_no_agents_is_told_with_its_place(function, mistake):
    with pytest.raises(ValueError, match=f"agents own_agents:{function}: .*{mistake}.*expected "):
        made(f"own_agents:{function}", lay_out(SMALL), ["picker_01"])
