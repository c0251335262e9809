"""How the kernels are compiled, and the trigonometry of orchard/trig.py for them: the same formulas, and so the same bits."""

import hashlib
import os
from functools import partial
from pathlib import Path

import numba
from numba import njit
from numba.extending import register_jitable

from orchard import trig

_HERE = Path(__file__).parent
_SOURCES = (  # all that kernels are made from
    "boxes", "compiled", "config", "kinds", "laser_kernel", "layout", "move_kernel", "trig", "watch_kernel",
)  # fmt: skip


def _keep_kernels_by_source() -> None:
    """Keep what is compiled in a folder that is named for the sources.

    numba looks only at a kernel's own file to see whether it is stale, not at the constants and functions that it takes from others.
    """
    folder = Path(numba.config.CACHE_DIR or _HERE / "__pycache__")
    if numba.config.CACHE_DIR or os.access(_HERE, os.W_OK):
        sources = b"".join((_HERE / f"{module}.py").read_bytes() for module in _SOURCES)
        numba.config.CACHE_DIR = str(folder / f"kernels-{hashlib.sha256(sources).hexdigest()[:16]}")


_keep_kernels_by_source()

jit = partial(njit, cache=True, nogil=True, error_model="numpy")  # no fastmath: it would change the bits

inlined = partial(jit, forceinline=True)  # for what inner loops call: its arrays, seven words each, need not be passed

for _inner in (trig.sine_series, trig.cosine_series, trig.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(trig.sin_cos)
atan2 = jit(trig.atan2)
wrap = jit(trig.wrap)
log = jit(trig.log)
