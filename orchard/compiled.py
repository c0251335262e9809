"""How the kernels are compiled, and the trigonometry of orchard/trig.py for them: the same formulas, and so the same bits."""

from functools import partial

import numba
from numba import njit
from numba.extending import register_jitable

from orchard import trig
from orchard.kept import kernels_folder

if (_folder := kernels_folder()) is not None:
    numba.config.CACHE_DIR = str(_folder)

jit = partial(njit, cache=True, nogil=True, error_model="numpy")  # no fastmath: it would change the bits

inlined = partial(jit, forceinline=True)  # for what inner loops call: its arrays, seven words each, need not be passed

for _inner in (trig.sine_series, trig.cosine_series, trig.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(trig.sin_cos)
atan2 = jit(trig.atan2)
wrap = jit(trig.wrap)
log = jit(trig.log)
