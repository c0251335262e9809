"""The timing loop of all simulators: the same code runs in the process of each.

It needs only the standard library.

The rate is measured in processor time. Each simulator has one thread, so on an idle machine that is
wall time; on a busy machine it is still the time that an idle one would take.
"""

import json
import time
from collections.abc import Callable

WARM_UP = 3  # steps that are not timed: lazy initialisation happens in them
MOST_STEPS = 3000  # for which velocities are prepared; after them the sequence repeats


def run(step: Callable[[int], object], seconds: float) -> None:
    """Call step(0), step(1), ... for `seconds`, at least once.

    Print one line of JSON: {"steps_per_second": ...}.
    """
    for k in range(WARM_UP):
        step(k)
    begun = time.perf_counter()
    used = time.process_time()
    steps = 0
    while steps == 0 or time.perf_counter() - begun < seconds:
        step(steps % MOST_STEPS)
        steps += 1
    print(json.dumps({"steps_per_second": steps / (time.process_time() - used)}))
