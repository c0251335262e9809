"""The ports with which a run or a recording is shown in a browser."""

from orchard.net.endpoints import check_free


def check_ports(port: int) -> None:
    """Raise BusError if the web viewer cannot have its port and that of its data, the next one."""
    for number in (port, port + 1):
        check_free(f"tcp/127.0.0.1:{number}")
