"""Endpoints, such as tcp/127.0.0.1:7447: where a router listens and others find it, who can reach it, and what may be wrong with it."""

import ipaddress
import socket
from contextlib import suppress

LOOPBACK, SECURE_LOOPBACK = "tcp/127.0.0.1:0", "tls/127.0.0.1:0"
NO_ENDPOINT = "not an endpoint; an endpoint is like tcp/127.0.0.1:7447"
IN_USE = "cannot listen there; the port is in use, or the address is not this machine's"


class BusError(Exception):
    """Something about the network that a person can mend."""


def check_security(endpoint: str, is_secured: bool) -> None:
    """BusError where an endpoint and the wish for security contradict each other."""
    if is_secured and not endpoint.startswith("tls/"):
        raise BusError(f"{endpoint}: not secure; with --secure an endpoint is like tls/127.0.0.1:7447")
    if not is_secured and endpoint.startswith("tls/"):
        raise BusError(f"{endpoint}: tls needs certificates; --secure DIR tells where they are, and `run.py secure DIR` makes them")


def is_public(endpoint: str) -> bool:
    """Whether other machines can reach it."""
    protocol, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0].strip("[]")
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return protocol in ("tcp", "udp", "tls", "quic", "ws") and host != "localhost"


def check_free(endpoint: str) -> None:
    """BusError where a router could not listen. Only TCP is looked at."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if not (protocol and host and port):
        raise BusError(f"{endpoint}: {NO_ENDPOINT}")
    if protocol not in ("tcp", "tls") or "#" in port:  # behind # are wishes that only Zenoh knows
        return
    if not port.isdecimal() or int(port) > 65535:
        raise BusError(f"{endpoint}: {port} is no port; one is a number from 0 to 65535")
    try:
        with socket.socket(_family(host)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host.strip("[]"), int(port)))
            probe.listen()
    except OSError as error:
        raise BusError(f"{endpoint}: {IN_USE}") from error


def reachable(endpoint: str) -> str:
    """The endpoint by which this machine reaches itself, where a router listens on all of its addresses."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def with_port(endpoint: str) -> str:
    """The endpoint itself, or with a port that was free a moment ago in the place of port 0: zenoh does not tell which one it took."""
    if not endpoint.endswith(":0"):
        return endpoint
    protocol, _, host = endpoint.removesuffix(":0").partition("/")
    with suppress(OSError), socket.socket(_family(host)) as probe:
        probe.bind((host.strip("[]"), 0))
        return f"{protocol}/{host}:{probe.getsockname()[1]}"
    return endpoint


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if host.startswith("[") else socket.AF_INET
