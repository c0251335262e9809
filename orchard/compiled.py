"""The trigonometry of orchard/trig.py, compiled: the same formulas, and so the same bits, for the kernels.

numba sees that a kernel's cache is stale by that kernel's own file alone. Who changes trig.py removes orchard/__pycache__.
"""

from functools import partial

from numba import njit
from numba.extending import register_jitable

from orchard import trig

jit = partial(njit, cache=True, nogil=True, error_model="numpy")  # no fastmath: it would change the bits

for _inner in (trig.sine_series, trig.cosine_series, trig.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(trig.sin_cos)
atan2 = jit(trig.atan2)
wrap = jit(trig.wrap)
log = jit(trig.log)
