"""The options of a process: a person's command line and the launcher's JSON line follow from one declaration."""

import io
import sys

import msgspec
import pytest

from orchard.net.options import FROM_STDIN, HostOptions, LoggerOptions, RouterOptions, read_options
from orchard.server.options import RunOptions

HERE = "tcp/127.0.0.1:7447"
ORDERS = [
    (RunOptions(), []),
    (RunOptions(scenario="mine.yaml", listen=HERE, speed=4.0, duration=20.0, absent=["bin", "picker_01"], recorded=True, holds="checked"),
     f"mine.yaml --listen {HERE} --speed 4 --duration 20 --absent bin --absent picker_01 --recorded --holds checked".split()),
    (HostOptions(connect=HERE, only=["picker"], share="1/2", check_agents=True),
     f"--connect {HERE} --only picker --share 1/2 --check-agents".split()),
    (LoggerOptions(connect=HERE, record="a.rrd", serve=9876), f"--connect {HERE} --record a.rrd --serve 9876".split()),
    (RouterOptions(listen=HERE, secure="roles/router"), f"--listen {HERE} --secure roles/router".split()),
]  # fmt: skip


@pytest.mark.parametrize(("options", "words"), ORDERS)
def test_a_command_line_and_a_json_line_give_the_same_options(options, words, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(msgspec.json.encode(options).decode() + "\n"))
    assert read_options(type(options), "module", words) == read_options(type(options), "module", [FROM_STDIN]) == options


@pytest.mark.parametrize(
    ("kind", "words", "told"),
    [
        (RunOptions, ["--mode", "sideways"], "--mode: sideways: expected lockstep|realtime: wait for all agents, or for none"),
        (RunOptions, ["--patience", "nan"], "--patience: nan: expected SECONDS: wall time, above 0"),
        (RunOptions, ["--listen", HERE, "--connect", HERE], "give --listen or --connect"),
        (HostOptions, [], "the following arguments are required: --connect"),
        (HostOptions, ["--connect", HERE, "--patience", "0"], "--patience: 0: expected SECONDS: time that physics may be gone, above 0"),
    ],
)
def test_what_is_wrong_in_a_command_line_is_told_with_what_would_be_right(kind, words, told, capsys):
    with pytest.raises(SystemExit, match="2"):
        read_options(kind, "module", words)
    assert told in capsys.readouterr().err
