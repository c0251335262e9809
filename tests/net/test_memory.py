"""The memory of a process that is complete: which of it goes to huge pages, and that nothing but its speed changes."""

import subprocess
import sys

from orchard.net.process import own

MAPS = """\
55d0c0000000-55d0c0400000 r-xp 00000000 fe:00 1234                       /usr/bin/python3.11
55d0c1000000-55d0c1400000 rw-p 00000000 00:00 0                          [heap]
7f0000000000-7f0000800000 rw-p 00000000 00:00 0
7f0001000000-7f0001800000 rw-p 00000000 fe:00 4321                       /usr/lib/a name with spaces.so
7f0002000000-7f0002800000 rw-s 00000000 00:01 99                         /memfd:shared (deleted)
7f0003000000-7f0003800000 ---p 00000000 00:00 0
7ffd00000000-7ffd00021000 rw-p 00000000 00:00 0                          [stack]
"""


def test_only_what_the_process_alone_has_and_writes_is_moved():
    assert [(hex(begin), hex(end)) for begin, end in own(MAPS)] == [
        ("0x55d0c1000000", "0x55d0c1400000"),
        ("0x7f0000000000", "0x7f0000800000"),
    ]


def test_what_was_there_before_a_process_settled_is_there_afterwards():
    program = """
from orchard.net.process import settle
kept = [bytes([n % 256]) * 1000 for n in range(20_000)]
settle()
assert all(each == bytes([n % 256]) * 1000 for n, each in enumerate(kept))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
