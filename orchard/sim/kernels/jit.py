"""The compiler settings of the kernels, and the functions of orchard/field/repeatable.py compiled: same formulas, same bits."""

from collections.abc import Mapping
from functools import partial
from inspect import signature
from typing import Any, TypeVar

import numba
from numba import njit
from numba.extending import register_jitable

from orchard.field import repeatable
from orchard.sim.kernels.cache import kernels_folder

if (_folder := kernels_folder()) is not None:
    numba.config.CACHE_DIR = str(_folder)

jit = partial(njit, cache=True, nogil=True, error_model="numpy")  # no fastmath, which would change the bits

inlined = partial(jit, forceinline=True)  # for functions called in inner loops: saves passing their arrays, seven words each

for _inner in (repeatable.sine_series, repeatable.cosine_series, repeatable.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(repeatable.sin_cos)
atan2 = jit(repeatable.atan2)
wrap = jit(repeatable.wrap)
log = jit(repeatable.log)

T = TypeVar("T")


def in_order(kernel: Any, values: Mapping[str, T], skip: int = 0) -> list[T]:
    """Return `values`, given by name, in the order of a kernel's parameters after the first `skip`.

    Kernels take many arrays by position, because numba unpacks a named tuple slowly. By this no two of them can be swapped unseen: a name
    that is missing or unknown raises TypeError.
    """
    names = list(signature(kernel.py_func).parameters)[skip:]
    if set(names) != set(values):
        raise TypeError(f"{kernel.py_func.__name__}: the arguments {sorted(set(names) ^ set(values))} are missing or unknown")
    return [values[name] for name in names]
