"""Machines for tests: network namespaces with cables between them, on this one.

Needs root and iproute2.
"""

import json
import os
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import line_with
from patience import PATIENCE


def tool(name: str) -> str:
    """Return the path of a program of iproute2; its name if it is not here.

    Debian keeps `tc` in a folder that is not in the PATH of all users.
    """
    folders = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
    return shutil.which(name, path=folders) or name


def why_not() -> str:
    """Return why there can be no machines here; '' if there can. In CI there must be."""
    if os.environ.get("CI") == "true":
        return ""
    if tool("ip") == "ip" or tool("tc") == "tc":
        return "iproute2 is not installed"
    return "" if os.geteuid() == 0 else "network namespaces need root"


needs_machines = pytest.mark.skipif(bool(why_not()), reason=why_not() or "never")


def _ip(*words: str) -> None:
    """Run `ip`. Raises CalledProcessError if it fails."""
    subprocess.run([tool("ip"), *words], check=True, timeout=PATIENCE)


@contextmanager
def machines(*guests: str):
    """Make a host and its guests. Return their names, the host first.

    The host is 192.168.<n>.10 to its n-th guest, which is .11 there.
    """
    base = f"o{os.getpid()}"
    names = [f"{base}h", *(f"{base}{guest}" for guest in guests)]
    try:
        for name in names:
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        for n, guest in enumerate(names[1:], 1):
            _plug(names[0], guest, n)
        yield names
    finally:
        for name in names:
            subprocess.run(
                [tool("ip"), "netns", "del", name], timeout=PATIENCE, stderr=subprocess.DEVNULL
            )


def _plug(host: str, guest: str, n: int) -> None:
    """Put the n-th cable between the host and a guest, with an address at both ends."""
    peer = f"type veth peer name eth0 netns {guest}"
    _ip("link", "add", f"v{n}", "netns", host, *peer.split())
    for name, end, address in ((host, f"v{n}", 10), (guest, "eth0", 11)):
        _ip("-n", name, "address", "add", f"192.168.{n}.{address}/24", "dev", end)
        _ip("-n", name, "link", "set", end, "up")


def within(name: str) -> list[str]:
    return [tool("ip"), "netns", "exec", name]


def run_both(
    host: str,
    first: list[str],
    guest: str,
    second: list[str],
    here: Path | None = None,
    there: Path | None = None,
) -> None:
    """Run a command on the host that leaves carriers to others, and then the guest's.

    `first`, `second`: the commands of the host and of the guest, which begins when the first one
    waits for it. `here`, `there`: the folders in which they run. Both must end well.
    """
    on_host = subprocess.Popen(
        [*within(host), *first],
        cwd=here,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        first_lines = line_with("carrier: left to other processes", on_host)
        on_guest = subprocess.run(
            [*within(guest), *second],
            cwd=there,
            capture_output=True,
            text=True,
            timeout=3 * PATIENCE,
        )
        rest, _ = on_host.communicate(timeout=PATIENCE)
    finally:
        on_host.kill()
    assert on_host.returncode == 0, first_lines + rest
    assert on_guest.returncode == 0, on_guest.stdout + on_guest.stderr


@contextmanager
def unplugged(host: str, *guests: int):
    """Unplug the cables between the host and these guests, counted from 1, within this context."""
    for n in guests:
        _ip("-n", host, "link", "set", f"v{n}", "down")
    try:
        yield
    finally:
        for n in guests:
            _ip("-n", host, "link", "set", f"v{n}", "up")


def slowed(host: str, guest: int, *bucket: str) -> None:
    """Slow a cable by a token bucket at the host's end: `rate 1mbit burst 16kb latency 50ms`."""
    subprocess.run(
        [tool("tc"), "-n", host, "qdisc", "add", "dev", f"v{guest}", "root", "tbf", *bucket],
        check=True,
        timeout=PATIENCE,
    )


# A quarter of the packets is sent at once. The others are 2 ms late, so it overtakes them.
BAD_RADIO = ["loss", "5%", "duplicate", "1%", "delay", "2ms", "reorder", "25%"]
# What tc says if the kernel has no netem: newer and older ones.
NO_NETEM = ("qdisc kind is unknown", "qdisc not found", "No such file or directory")


def harm(name: str, *ends: str) -> None:
    """Lose, double and reorder what a machine sends from these ends of cables.

    Skip the test if the kernel cannot.
    """
    for end in ends:
        done = subprocess.run(
            [tool("tc"), "-n", name, "qdisc", "add", "dev", end, "root", "netem", *BAD_RADIO],
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        if done.returncode and any(words in done.stderr for words in NO_NETEM):
            pytest.skip(f"the kernel has no netem (sch_netem): {done.stderr.strip()}")
        assert done.returncode == 0, done.stderr


def harms(name: str, end: str) -> dict[str, int]:
    """Return how many packets were sent, and how many were lost, at one end that `harm` has met."""
    output = subprocess.run(
        [tool("tc"), "-s", "-j", "-n", name, "qdisc", "show", "dev", end],
        check=True,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    ).stdout
    (queue,) = [queue for queue in json.loads(output) if queue["kind"] == "netem"]
    return {"sent": queue["packets"], "lost": queue["drops"]}
