"""When Python's cycle collector visits the objects of a program: seldom, because what a tick makes
is freed by reference counting.
"""

import gc

YOUNG = 20_000  # objects that may be created before the collector runs; some megabytes


def collect_seldom() -> None:
    """Let the collector run seldom.

    A program calls this before its imports: their objects all stay. It saves a seventh of a start.
    """
    gc.set_threshold(YOUNG)


def settle() -> None:
    """Prepare a complete process for its ticks: the collector does not visit its present objects
    again, not even at its end.

    With two agent processes this and `collect_seldom` save a tenth of all processor time.
    """
    gc.collect()
    gc.freeze()
