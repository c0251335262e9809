"""Python's collector of reference cycles, told what a run is like."""

import gc

YOUNG = 20_000  # objects that may be made before it looks through them; some megabytes


def settle() -> None:
    """A process is complete, and its ticks begin: whatever is there stays to the end and is not looked through again.

    What a tick makes goes as it comes, by its count of references. Measured with two agent processes: a tenth of all processor time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(YOUNG)
