"""The line over a real broker: a harvest, with the broker and the bridge killed on the way; and mistakes, told in words."""

import os
import time
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from orchard_vda5050 import __main__ as command
from orchard_vda5050.fleet import vehicles
from orchard_vda5050.line import Line, broker_at
from orchard_vda5050.network import Network
from orchards import SMALL
from standard import check

from orchard import BusError, Scenario, lay_out
from processes import BEGIN_SECONDS, Control, bridging, broker, free_port, lif, scene

CARRIERS = ("carrier_01", "carrier_02")
FLEET = (*CARRIERS, "picker_01", "picker_02")
KINDS = ("--robots", "carrier", "picker")


def test_a_fleet_control_drives_a_harvest_though_the_broker_and_the_bridge_are_killed(tmp_path):
    """The run is not as fast as it can be: without a broker nothing is done in it, and after 600 s it would be jammed."""
    port = free_port()
    with broker(tmp_path, port) as first, scene(tmp_path, SMALL, port, ("--without", "picker", "--speed", "20"), KINDS) as run:
        control = Control(lif(tmp_path), port)
        try:
            is_busy = lambda: next((name for name in CARRIERS if control.states.get(name, {}).get("nodeStates")), None)  # noqa: E731
            busy = control.until(is_busy, BEGIN_SECONDS)
            first.kill()
            first.wait()
            with broker(tmp_path, port):
                before = len(control.heard)
                control.until(lambda: len(control.heard) > before + 10 and control.states[busy]["orderId"])
                order = control.states[busy]["orderId"]
                run.bridge.kill()
                control.until(lambda: all(control.connection(name) == "CONNECTION_BROKEN" for name in FLEET))
                with bridging(run.endpoint, port, tmp_path, *KINDS):
                    control.until(lambda: all(control.connection(name) == "ONLINE" for name in FLEET), BEGIN_SECONDS)
                    control.until(lambda: control.heard[-1][1] == "state")
                    assert control.states[busy]["orderId"] in (order, *(job["order"] for job in control.jobs.values()))
                    assert run.orchard.wait(BEGIN_SECONDS) == 0
                    control.until(lambda: all(control.connection(name) == "OFFLINE" for name in FLEET))
        finally:
            control.close()
    for _, topic, message in control.heard:
        check(topic, message)
    assert {topic for _, topic, _ in control.heard} == {"state", "connection", "factsheet"}
    done = [[one["actionStatus"] for one in message["actionStates"]] for _, topic, message in control.heard if topic == "state"]
    assert ["FINISHED"] * 3 in done, "all actions of an order; the run may end before its last node, which no state tells any more"
    assert "3 of 3 rows" in (tmp_path / "orchard.log").read_text() and "Traceback" not in run.told()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--broker", "127.0.0.1"], "must be as mqtt://127.0.0.1:1883"),
        (["--manufacturer", "a/b"], "a part of a topic"),
        (["--patience", "nan"], "patience more than 0"),
        (["--state", "0"], "states need at least 0.1 s"),
    ],
)
def test_a_wrong_setting_is_told_in_words(words, told, capsys, monkeypatch):
    monkeypatch.setattr("os.environ", dict(os.environ))
    assert command.main(["drive", "tcp/127.0.0.1:7447", *words]) == 2
    assert told in capsys.readouterr().err


def test_a_broker_that_is_away_or_refuses_is_told_of_once(tmp_path, capsys):
    port, network, said = free_port(), Network(), []

    def told(words):
        end = time.monotonic() + 20.0
        while not said or words not in said[-1]:
            assert time.monotonic() < end, said
            time.sleep(0.01)
            said.extend(capsys.readouterr().err.splitlines())

    Line(network, broker_at(f"mqtt://127.0.0.1:{port}", "vda5050", "orchard", "3.0.0"), "carrier_01", [], [])
    told("the broker is not there: [Errno 111] Connection refused; trying again")
    with broker(tmp_path, port, lets_in="false"):
        told("the broker refuses: Not authorized; trying again")
    with broker(tmp_path, port):
        told("the broker is there")
    network.close()
    assert len(said) == len(set(said))


@pytest.mark.parametrize(
    ("scenario", "names", "told"),
    [
        ({"dispatch": "predictive"}, ["carrier_01"], "start the run with --without dispatch"),
        ({"dispatch": "nearest"}, ["carrier_01", "bin_01"], "bin_01: only carriers and pickers are vehicles"),
    ],
)
def test_what_cannot_be_driven_is_told_in_words(scenario, names, told):
    with pytest.raises(ValueError, match=told):
        vehicles(lay_out(Scenario(**SMALL | scenario)), names)


def test_a_bridge_waits_for_a_run(capsys, monkeypatch):
    answers = iter([BusError("no router answers there"), BusError("no router answers there"), SimpleNamespace(names=["dispatch"])])

    def connect(endpoint, secure):
        if isinstance(why := next(answers), BusError):
            raise why
        return nullcontext(why)

    monkeypatch.setattr(command, "connect", connect)
    monkeypatch.setattr(command, "AGAIN_SECONDS", 0.0)
    assert command.wait_for_a_run("tcp/127.0.0.1:7447", None) == ["dispatch"]
    assert capsys.readouterr().err == "orchard-vda5050: waiting for a run: no router answers there\n"
