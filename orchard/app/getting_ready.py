"""What a run has done before its first figures: the first one on a machine compiles for a while."""

from collections.abc import Sequence

from orchard.sim.kernels.cache import COMPILING, kernels_folder

# A run prints where its live picture is. The page shows that picture.
PICTURE = "Live: "


def getting_ready_words(lines: Sequence[str], compiled: int) -> str:
    """Return what a run has done so far, by its first and its last line.

    `lines`: that it has printed. `compiled`: number of parts that are compiled by now.
    """
    told = [line for line in lines if not line.startswith(PICTURE)]
    # One part if both are the same line, and none without a line.
    parts = [*dict.fromkeys([*told[:1], *told[-1:]])]
    if any(COMPILING in line for line in told):
        parts.append(f"parts that are compiled: {compiled}")
    if not parts:
        return "starting"
    return f"starting: {'; '.join(parts)}"


def compiled_count() -> int:
    """Return how many parts of the simulator are compiled for this machine."""
    folder = kernels_folder()
    if folder is None:
        return 0
    # numba keeps each compiled function in a file .nbc.
    return sum(1 for _ in folder.rglob("*.nbc"))
