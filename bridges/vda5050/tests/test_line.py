"""The line of a vehicle over a real broker, and mistakes, which are told in words.

Among them is a harvest with the broker and the bridge killed on the way.
"""

import os
import socket
import time
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from threading import Thread
from types import SimpleNamespace

import pytest
from orchard_vda5050 import __main__ as command
from orchard_vda5050 import network as lines_to_broker
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


def test_a_harvest_survives_kills_of_broker_and_bridge(tmp_path):
    """A fleet control drives a harvest though the broker and the bridge are killed.

    The run is not as fast as it can be: without a broker nothing is done in it, and after 600 s
    it would be jammed.
    """
    port = free_port()
    with (
        broker(tmp_path, port) as first,
        scene(tmp_path, SMALL, port, ("--without", "picker", "--speed", "20"), KINDS) as run,
    ):
        control = Control(lif(tmp_path), port)
        try:

            def first_with_an_order() -> str | None:
                for name in CARRIERS:
                    if control.states.get(name, {}).get("nodeStates"):
                        return name
                return None

            def connections_are(state: str) -> bool:
                return all(control.connection(name) == state for name in FLEET)

            busy = control.until(first_with_an_order, BEGIN_SECONDS)
            with bridging(run.endpoint, port, tmp_path, *KINDS) as second:
                assert second.wait(BEGIN_SECONDS) == 2, "its robots are taken"
            assert {
                message["connectionState"]
                for _, topic, message in control.heard
                if topic == "connection"
            } == {"ONLINE"}
            first.kill()
            first.wait()
            with broker(tmp_path, port):
                before = len(control.heard)
                control.until(
                    lambda: len(control.heard) > before + 10 and control.states[busy]["orderId"]
                )
                order = control.states[busy]["orderId"]
                run.bridge.kill()
                control.until(lambda: connections_are("CONNECTION_BROKEN"))
                with bridging(run.endpoint, port, tmp_path, *KINDS):
                    control.until(lambda: connections_are("ONLINE"), BEGIN_SECONDS)
                    control.until(lambda: control.heard[-1][1] == "state")
                    # The vehicle still has its order, or has got its next one.
                    orders = [order, *(job["order"] for job in control.jobs.values())]
                    assert control.states[busy]["orderId"] in orders
                    assert run.orchard.wait(BEGIN_SECONDS) == 0
                    control.until(lambda: connections_are("OFFLINE"))
        finally:
            control.close()
    for _, topic, message in control.heard:
        check(topic, message)
    assert {topic for _, topic, _ in control.heard} == {"state", "connection", "factsheet"}
    # All three actions of an order. Whether its last node was reached may be in no state: the run
    # may end before.
    statuses = [
        [action["actionStatus"] for action in message["actionStates"]]
        for _, topic, message in control.heard
        if topic == "state"
    ]
    assert ["FINISHED"] * 3 in statuses
    assert "3 of 3 rows" in (tmp_path / "orchard.log").read_text()
    assert "Traceback" not in run.bridge_log()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--broker", "127.0.0.1"], "must be as mqtt://127.0.0.1:1883"),
        (["--manufacturer", "a/b"], "a part of a topic"),
        (["--patience", "nan"], "patience more than 0"),
        (["--state", "0"], "states need at least 0.1 s"),
    ],
)
def test_a_wrong_setting_is_told_in_words(words, message, capsys, monkeypatch):
    monkeypatch.setattr("os.environ", dict(os.environ))
    assert command.main(["drive", "tcp/127.0.0.1:7447", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("endpoint", "message"),
    [
        ("nowhere", "nowhere: not an endpoint; use one such as tcp/127.0.0.1:7447"),
        ("tls/127.0.0.1:7447", "tls needs certificates"),
    ],
)
def test_a_bridge_does_not_wait_where_no_run_can_be(endpoint, message, capsys, monkeypatch):
    """A bridge does not wait at an endpoint at which no run can be."""
    monkeypatch.setattr("os.environ", dict(os.environ))
    monkeypatch.setattr(command.time, "sleep", lambda _: pytest.fail("it waits"))
    assert command.main(["drive", endpoint]) == 2
    assert message in capsys.readouterr().err


def opened(network, address, serial="carrier_01", topics=()):
    """Open a vehicle's line to a broker at an address. Return the line."""
    broker = broker_at(f"mqtt://{address}", "vda5050", "orchard", "3.0.0")
    line = Line(network, broker, serial, topics, [])
    assert line.take() == []
    return line


def hears(line):
    """Send orders to a vehicle until one comes."""

    def send_and_take():
        line.send("order", {})
        return line.take()

    until(send_and_take, "nothing came")


@pytest.fixture
def told(capsys):
    """A function that waits until words are on stderr, and returns all lines until then."""
    lines = []

    def wait(words):
        def are_told():
            lines.extend(capsys.readouterr().err.splitlines())
            return any(words in line for line in lines)

        until(are_told, lines)
        return lines

    return wait


def until(condition, trouble):
    """Wait until a condition is true, for 20 s at most; then fail with the trouble."""
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end, trouble
        time.sleep(0.01)


@contextmanager
def server(answer):
    """A server that is no broker: it answers each caller with these bytes, and says no more.

    It is given as its address, HOST:PORT.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve():
            with suppress(OSError), ExitStack() as callers:  # until the listener is closed
                while True:
                    caller = callers.enter_context(listener.accept()[0])
                    caller.sendall(answer)

        thread = Thread(target=serve)
        thread.start()
        yield f"127.0.0.1:{listener.getsockname()[1]}"
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()


def test_a_broker_that_is_away_or_refuses_is_told_of_once(tmp_path, told):
    port = free_port()
    network = Network()
    opened(network, f"127.0.0.1:{port}")
    told("the broker is not there: [Errno 111] Connection refused; trying again")
    with broker(tmp_path, port, lets_in="false"):
        told("the broker refuses: Not authorized; trying again")
    with broker(tmp_path, port):
        lines = told("the broker is there")
    network.close()
    assert len(lines) == len(set(lines))


def test_a_host_that_cannot_be_is_told_of(told):
    network = Network()
    opened(network, "orchard..example")
    told("the broker is not there: encoding with 'idna' codec failed")
    network.close()


def test_a_broker_that_does_not_answer_is_told_of(told, monkeypatch):
    monkeypatch.setattr(lines_to_broker, "KEEPALIVE_SECONDS", 1)
    network = Network()
    with server(b"") as address:
        opened(network, address)
        told(
            "the broker gives no answer to vehicles that connect: Keep alive timeout; trying again"
        )
        network.close()


def test_a_false_broker_keeps_no_other_line_from_fleet_control(tmp_path, told):
    """What is no broker keeps no other line from fleet control.

    It lets the vehicle in, and sends an order whose topic is no text.
    """
    port = free_port()
    network = Network()
    # Packets of MQTT, section 3 of its standard: what it is, its length, and its content.
    accepted = b"\x20\x02" + b"\x00\x00"
    message = b"\x30\x05" + b"\x00\x02\xff\xfe" + b"{"  # the topic has two bytes, no UTF-8
    with server(accepted + message) as address, broker(tmp_path, port):
        opened(network, address)
        told("the broker is not one of MQTT: UnicodeDecodeError")
        hears(opened(network, f"127.0.0.1:{port}", "carrier_02", ["order"]))
        network.close()


def test_a_bridge_to_another_run_with_the_same_vehicles_is_told(tmp_path, told, monkeypatch):
    """A bridge to another run with the same vehicles is told of."""
    monkeypatch.setattr(lines_to_broker, "AGAIN_SECONDS", 0.1)
    port = free_port()
    first, second = Network(), Network()
    with broker(tmp_path, port):
        for network in (first, second):
            opened(network, f"127.0.0.1:{port}")
        told("drops vehicles that it has just let in: does another bridge have their names")
        first.close()
        assert "is there" in told("is there")[-1]
        second.close()


def test_the_bridges_of_two_interfaces_share_a_broker(tmp_path):
    port = free_port()
    network = Network()
    with broker(tmp_path, port):
        address = f"mqtt://127.0.0.1:{port}"
        lines = []
        for interface in ("one", "two"):
            at = broker_at(address, interface, "orchard", "3.0.0")
            lines.append(Line(network, at, "carrier_01", ["order"], []))
        for line in lines:
            hears(line)
        network.close()
    assert "already connected" not in (tmp_path / "broker.log").read_text()


def test_connecting_many_vehicles_lets_the_others_be_read(monkeypatch):
    """Only two connect before the others are read again.

    A connection with TLS to a broker far away takes long; a broker takes a vehicle that says
    nothing for 7.5 s for lost.
    """
    clock = SimpleNamespace(now=0.0)
    network = Network()
    tried = set()
    monkeypatch.setattr(lines_to_broker, "monotonic", lambda: clock.now)

    class Slow:
        """A line that takes 0.3 s to connect."""

        socket = None
        is_there = False
        trouble = ""
        next_try = 0.0

        def connect(self):
            clock.now += 0.3
            self.next_try = clock.now + 100.0
            tried.add(self)

    for _ in range(9):
        network.keep(Slow())
    for count in (2, 4, 6, 8, 9):
        network._care(clock.now)
        assert len(tried) == count


def test_a_password_may_hold_any_character():
    address = "mqtt://the%20fleet:p%40ss%2Fw%3Ard@127.0.0.1:1883"
    at = broker_at(address, "vda5050", "orchard", "3.0.0")
    assert (at.user, at.password, at.host) == ("the fleet", "p@ss/w:rd", "127.0.0.1")


@pytest.mark.parametrize(
    ("scenario", "names", "message"),
    [
        ({"dispatch": "predictive"}, ["carrier_01"], "start the run with --without dispatch"),
        (
            {"dispatch": "nearest"},
            ["carrier_01", "bin_01"],
            "bin_01: only carriers and pickers are vehicles",
        ),
        ({"row_width": 4.0}, ["picker_01"], "row_width 4: fleet control drives pickers in rows"),
    ],
)
def test_what_cannot_be_driven_is_told_in_words(scenario, names, message):
    with pytest.raises(ValueError, match=message):
        vehicles(lay_out(Scenario(**SMALL | scenario)), names)


def test_a_bridge_waits_for_a_run(capsys, monkeypatch):
    """It tries again until there is one, and says so once."""
    nothing = BusError("no router answers there")
    answers = iter([nothing, nothing, SimpleNamespace(names=["dispatch"])])

    def connect(endpoint, secure):
        answer = next(answers)
        if isinstance(answer, BusError):
            raise answer
        return nullcontext(answer)

    monkeypatch.setattr(command, "connect", connect)
    monkeypatch.setattr(command, "AGAIN_SECONDS", 0.0)
    assert command.wait_for_a_run("tcp/127.0.0.1:7447", None) == ["dispatch"]
    assert (
        capsys.readouterr().err == "orchard-vda5050: waiting for a run: no router answers there\n"
    )
