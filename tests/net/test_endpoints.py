"""Endpoints: which port a router takes, and at which address other machines reach it."""

import socket

import pytest

from orchard.net.endpoints import OUTSIDE, check_free, from_elsewhere, with_port


@pytest.mark.parametrize(("host", "family"), [("127.0.0.1", socket.AF_INET), ("[::1]", socket.AF_INET6)])
def test_port_0_becomes_a_port_that_is_free(host, family):
    try:
        with socket.socket(family) as probe:
            probe.bind((host.strip("[]"), 0))
    except OSError:
        pytest.skip(f"this machine has no {host}")
    endpoint = with_port(f"tcp/{host}:0")
    assert endpoint.startswith(f"tcp/{host}:") and not endpoint.endswith(":0")
    check_free(endpoint)


def test_a_port_that_is_given_is_taken_as_it_is():
    assert with_port("tcp/127.0.0.1:7447") == "tcp/127.0.0.1:7447"


def test_other_machines_reach_all_addresses_at_one_of_this_machine(monkeypatch):
    assert from_elsewhere("tcp/192.168.1.10:7447") == "tcp/192.168.1.10:7447"
    monkeypatch.setitem(OUTSIDE, "0.0.0.0", "127.0.0.9")  # the way to this address begins at 127.0.0.1 on any machine
    assert from_elsewhere("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"


def test_a_machine_without_a_network_is_named(monkeypatch):
    def no_way(*_):
        raise OSError("no way there")

    monkeypatch.setattr(socket.socket, "connect", no_way)
    assert from_elsewhere("tls/0.0.0.0:7447") == f"tls/{socket.gethostname()}:7447"
    assert from_elsewhere("tls/[::]:7447") == f"tls/{socket.gethostname()}:7447"
