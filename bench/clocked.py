"""How every simulator is timed: the same few lines in each process. Needs nothing but the standard library.

In processor time, which on an idle machine is wall time, since each is one thread; and on a busy one still is what it would be there.
"""

import json
import time
from collections.abc import Callable

WARM_UP = 3  # steps that do not count: what is lazy has happened in them
MOST_STEPS = 3000  # for which velocities are ready; beyond them it begins anew


def run(step: Callable[[int], object], seconds: float) -> None:
    """Call step(0), step(1), ... for so many seconds, but once at least, and print how fast it went."""
    for k in range(WARM_UP):
        step(k)
    begun, used, steps = time.perf_counter(), time.process_time(), 0
    while steps == 0 or time.perf_counter() - begun < seconds:
        step(steps % MOST_STEPS)
        steps += 1
    print(json.dumps({"steps_per_second": steps / (time.process_time() - used)}))
