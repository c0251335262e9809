"""A process settles before its ticks begin: nothing but its speed changes."""

import subprocess
import sys


def test_what_was_there_before_a_process_settled_is_there_afterwards():
    program = """
from orchard.memory import settle
kept = [bytes([n % 256]) * 1000 for n in range(20_000)]
settle()
assert all(each == bytes([n % 256]) * 1000 for n, each in enumerate(kept))
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_the_collector_runs_seldom_from_the_first_import_of_a_process_on():
    program = "import orchard.processes, gc, orchard.memory; assert gc.get_threshold()[0] == orchard.memory.YOUNG"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
