"""How the kernels are compiled, and the trigonometry of orchard/field/repeatable.py for them: the same formulas, and so the same bits."""

from functools import partial

import numba
from numba import njit
from numba.extending import register_jitable

from orchard.field import repeatable
from orchard.sim.kernels.cache import kernels_folder

if (_folder := kernels_folder()) is not None:
    numba.config.CACHE_DIR = str(_folder)

jit = partial(njit, cache=True, nogil=True, error_model="numpy")  # no fastmath: it would change the bits

inlined = partial(jit, forceinline=True)  # for what inner loops call: its arrays, seven words each, need not be passed

for _inner in (repeatable.sine_series, repeatable.cosine_series, repeatable.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(repeatable.sin_cos)
atan2 = jit(repeatable.atan2)
wrap = jit(repeatable.wrap)
log = jit(repeatable.log)
