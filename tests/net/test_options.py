"""Options and endpoints: a command line and the launcher's JSON line are one; which port a router
takes, and where others reach it.

run.py gives a process its options as one line of JSON on its standard input, and a person gives
them on the command line.
"""

import io
import socket
import sys

import msgspec
import pytest

from orchard.net.endpoints import OUTSIDE, check_free, from_elsewhere, with_port
from orchard.net.options import FROM_STDIN, HostOptions, LoggerOptions, RouterOptions, read_options
from orchard.server.options import RunOptions

HERE = "tcp/127.0.0.1:7447"
# The options of a process, and the words by which a person gives them.
ORDERS = [
    (RunOptions(), []),
    (
        RunOptions(
            scenario="mine.yaml",
            listen=HERE,
            speed=4.0,
            duration=20.0,
            absent=["bin", "picker_01"],
            recorded=True,
            holds="checked",
        ),
        f"mine.yaml --listen {HERE} --speed 4 --duration 20 --absent bin --absent picker_01"
        " --recorded --holds checked".split(),
    ),
    (
        HostOptions(connect=HERE, only=["picker"], share="1/2", check_agents=True),
        f"--connect {HERE} --only picker --share 1/2 --check-agents".split(),
    ),
    (
        LoggerOptions(connect=HERE, record="a.rrd", serve=9876),
        f"--connect {HERE} --record a.rrd --serve 9876".split(),
    ),
    (
        RouterOptions(listen=HERE, secure="roles/router"),
        f"--listen {HERE} --secure roles/router".split(),
    ),
]


@pytest.mark.parametrize(("options", "words"), ORDERS)
def test_a_command_line_and_a_json_line_give_the_same_options(options, words, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(msgspec.json.encode(options).decode() + "\n"))
    assert (
        read_options(type(options), "module", words)
        == read_options(type(options), "module", [FROM_STDIN])
        == options
    )


# The process, what is typed, and words of the refusal.
MISTAKES = [
    (
        RunOptions,
        ["--mode", "sideways"],
        "--mode: sideways: expected lockstep|realtime: wait for all agents, or for none",
    ),
    (RunOptions, ["--patience", "nan"], "--patience: nan: expected SECONDS: wall time, above 0"),
    (RunOptions, ["--listen", HERE, "--connect", HERE], "give --listen or --connect"),
    (HostOptions, [], "the following arguments are required: --connect"),
    (
        HostOptions,
        ["--connect", HERE, "--patience", "0"],
        "--patience: 0: expected SECONDS: time that physics may be gone, above 0",
    ),
]


@pytest.mark.parametrize(("kind", "words", "message"), MISTAKES)
def test_a_wrong_command_line_is_told_with_what_would_be_right(kind, words, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        read_options(kind, "module", words)
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("host", "family"), [("127.0.0.1", socket.AF_INET), ("[::1]", socket.AF_INET6)]
)
def test_port_0_becomes_a_port_that_is_free(host, family):
    try:
        with socket.socket(family) as probe:
            probe.bind((host.strip("[]"), 0))
    except OSError:
        pytest.skip(f"this machine has no {host}")
    endpoint = with_port(f"tcp/{host}:0")
    assert endpoint.startswith(f"tcp/{host}:")
    assert not endpoint.endswith(":0")
    check_free(endpoint)


def test_a_port_that_is_given_is_taken_as_it_is():
    assert with_port("tcp/127.0.0.1:7447") == "tcp/127.0.0.1:7447"


def test_other_machines_reach_all_addresses_at_one(monkeypatch):
    """A router that listens at 0.0.0.0 listens at all addresses of its machine. Others are told
    the one from which a way to the outside begins.
    """
    assert from_elsewhere("tcp/192.168.1.10:7447") == "tcp/192.168.1.10:7447"
    # The way to this address begins at 127.0.0.1 on any machine.
    monkeypatch.setitem(OUTSIDE, "0.0.0.0", "127.0.0.9")
    assert from_elsewhere("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"


def test_a_machine_without_a_network_is_named(monkeypatch):
    def no_way(*_):
        raise OSError("no way there")

    monkeypatch.setattr(socket.socket, "connect", no_way)
    assert from_elsewhere("tls/0.0.0.0:7447") == f"tls/{socket.gethostname()}:7447"
    assert from_elsewhere("tls/[::]:7447") == f"tls/{socket.gethostname()}:7447"
