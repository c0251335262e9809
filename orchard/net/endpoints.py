"""Endpoints, such as tcp/127.0.0.1:7447: checks and conversions.

A router listens at an endpoint, and clients connect to it.
"""

import errno
import ipaddress
import socket
from contextlib import suppress

# At any free port of this machine.
LOOPBACK = "tcp/127.0.0.1:0"
SECURE_LOOPBACK = "tls/127.0.0.1:0"
# Environment variable: how Zenoh shares its work among threads.
RUNTIME = "ZENOH_RUNTIME"
# The thread that waits for a message handles it, instead of two more threads that it would wake.
ONE_THREAD = "(rx: (handover: app), acc: (handover: app))"
# s that a connection to this machine may take.
LOOPBACK_SECONDS = 5.0
NO_ENDPOINT = "not an endpoint; use one such as tcp/127.0.0.1:7447"
# The address that stands for all addresses of a machine (IPv4 and IPv6) -> an address outside, to
# which no machine answers: one of those for documents, RFC 5737 and 3849.
OUTSIDE = {
    "0.0.0.0": "192.0.2.1",
    "[::]": "2001:db8::1",
}
IN_USE = "cannot listen there; the port is in use, or the address is not of this machine"


class BusError(Exception):
    """A fault of the network or its settings that the user can correct."""


def check_security(endpoint: str, is_secured: bool) -> None:
    """Raise BusError if the protocol of an endpoint does not fit a secured or an open run."""
    if is_secured and not endpoint.startswith("tls/"):
        raise BusError(
            f"{endpoint}: not secure; with --secure use an endpoint such as tls/127.0.0.1:7447"
        )
    if not is_secured and endpoint.startswith("tls/"):
        raise BusError(
            f"{endpoint}: tls needs certificates; --secure DIR names their directory, "
            "and `orchard secure DIR` creates them"
        )


def is_public(endpoint: str) -> bool:
    """Whether other machines can reach an endpoint.

    >>> is_public("tcp/0.0.0.0:7447"), is_public("tcp/127.0.0.1:7447")
    (True, False)
    """
    protocol, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0].strip("[]")
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return protocol in ("tcp", "udp", "tls", "quic", "ws") and host != "localhost"


def check_free(endpoint: str) -> None:
    """Raise BusError if a router cannot listen at an endpoint.

    Only TCP ports (tcp and tls) are checked. Raises OSError if this process may open no more files.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if not (protocol and host and port):
        raise BusError(f"{endpoint}: {NO_ENDPOINT}")
    # Settings for Zenoh follow #.
    if protocol not in ("tcp", "tls") or "#" in port:
        return
    if not port.isdecimal() or int(port) > 65535:
        raise BusError(f"{endpoint}: {port} is not a port; use a number from 0 to 65535")
    try:
        with socket.socket(_family(host)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host.strip("[]"), int(port)))
            probe.listen()
    except OSError as error:
        if error.errno == errno.EMFILE:
            raise
        raise BusError(f"{endpoint}: {IN_USE}") from error


def check_loopback() -> None:
    """Raise BusError if this machine cannot connect to itself.

    It cannot in a namespace without a loopback.
    """
    try:
        with (
            socket.create_server(("127.0.0.1", 0)) as server,
            socket.create_connection(server.getsockname(), LOOPBACK_SECONDS),
        ):
            pass
    except OSError as error:
        fault = "processes of this machine cannot reach each other there"
        why = f"127.0.0.1: {fault}: {error.strerror or error}"
        raise BusError(
            f"{why}; `ip link set lo up` makes it work, and --mode local does without"
        ) from error


def reachable(endpoint: str) -> str:
    """Return the endpoint for clients on this machine.

    All addresses become the loopback address.

    >>> reachable("tcp/0.0.0.0:7447")
    'tcp/127.0.0.1:7447'
    """
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def from_elsewhere(endpoint: str) -> str:
    """Return the endpoint for other machines.

    All addresses become this machine's address, or its name.
    """
    for every, outside in OUTSIDE.items():
        endpoint = endpoint.replace(f"/{every}:", f"/{_own_address(every, outside)}:")
    return endpoint


def _own_address(every: str, outside: str) -> str:
    """Return the address from which this machine would send to the address `outside`.

    Without a way there it is the machine's name. `every`: gives the family, IPv4 or IPv6.
    """
    try:
        with socket.socket(_family(every), socket.SOCK_DGRAM) as probe:
            # To connect a datagram socket chooses a way, and sends nothing. Any port will do; 9 is
            # that of the discard protocol.
            probe.connect((outside, 9))
            own = str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname()
    if ":" in own:
        return f"[{own}]"
    return own


def with_port(endpoint: str) -> str:
    """Return the endpoint; port 0 becomes a port that was free a moment ago.

    Zenoh does not report which port it took.
    """
    if not endpoint.endswith(":0"):
        return endpoint
    protocol, _, host = endpoint.removesuffix(":0").partition("/")
    with suppress(OSError), socket.socket(_family(host)) as probe:
        probe.bind((host.strip("[]"), 0))
        return f"{protocol}/{host}:{probe.getsockname()[1]}"
    return endpoint


def _family(host: str) -> socket.AddressFamily:
    """Return the family of an address: IPv6 stands in brackets."""
    if host.startswith("["):
        return socket.AF_INET6
    return socket.AF_INET
