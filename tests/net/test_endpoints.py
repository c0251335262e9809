"""Endpoints: which port a router takes."""

import socket

import pytest

from orchard.net.endpoints import check_free, with_port


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
