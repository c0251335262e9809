"""The compiler settings of the kernels, and the functions of orchard/field/repeatable.py compiled: same formulas, same bits."""

import hashlib
import pickle
import sys
from collections.abc import Callable, Mapping
from functools import partial
from inspect import signature
from typing import Any, TypeVar

import numba
from numba import njit
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

from orchard.field import repeatable
from orchard.sim.kernels.cache import KernelFiles, kernels_folder

numba.config.DISABLE_JIT = (
    False  # whatever NUMBA_DISABLE_JIT says: functions that are not compiled give other bits
)
_folder = kernels_folder()
_files = None if _folder is None else KernelFiles(_folder)


class _Cache(NullCache):
    """Keeps a kernel's code in files with checksums: numba's own cache loads whatever is in its files. Names say on what it depends."""

    def __init__(self, files: KernelFiles, function: Callable[..., Any]) -> None:
        self._files, self._name = (
            files,
            f"{function.__module__.rpartition('.')[2]}.{function.__name__}",
        )

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        rtsys.initialize(
            target_context
        )  # the functions that count references; all else numba needs to compile, and to load nothing
        code = self._files.load(self._file(sig, target_context.codegen()))
        return None if code is None else CompileResult._rebuild(target_context, *pickle.loads(code))

    def save_overload(self, sig: Any, cres: CompileResult) -> None:
        if not cres.library.has_dynamic_globals:  # pointers, which another process must not use
            self._files.keep(self._file(sig, cres.codegen), dumps(cres._reduce()))

    def _file(self, sig: Any, codegen: Any) -> str:
        machine = repr((numba.__version__, sys.version_info, sig, codegen.magic_tuple()))
        return f"{self._name}-{hashlib.sha256(machine.encode()).hexdigest()[:32]}.nbc"


def jit(function: Callable[..., Any], allocates: bool = False, **options: Any) -> Any:
    """Return the function compiled. Its code is kept on the disk. `allocates`: whether it makes arrays.

    In one that makes none, numba counts no references to arrays, which took a third of a step of ten robots: an array costs a call from
    Python 45 ns instead of 110, and a call of an inner function nothing. If one that makes arrays does not say so, numba refuses it.
    """
    kernel = njit(nogil=True, error_model="numpy", _nrt=allocates, **options)(
        function
    )  # no fastmath, which would change the bits
    if _files is not None:
        kernel._cache = _Cache(_files, function)
    return kernel


allocating = partial(jit, allocates=True)
inlined = partial(
    jit, forceinline=True
)  # for functions called in inner loops: saves passing their arrays, seven words each

for _inner in (repeatable.sine_series, repeatable.cosine_series, repeatable.arctan_unit):
    register_jitable(_inner)

sin_cos = jit(repeatable.sin_cos)
atan2 = jit(repeatable.atan2)
wrap = jit(repeatable.wrap)
log = jit(repeatable.log)

T = TypeVar("T")


def in_order(kernel: Any, values: Mapping[str, T], skip: int = 0) -> list[T]:
    """Return `values`, given by name, in the order of a kernel's parameters after the first `skip`, so that no two can be swapped.

    Kernels take many arrays by position, because numba unpacks a named tuple slowly. Raises TypeError for a name too few or too many.
    """
    names = list(signature(kernel.py_func).parameters)[skip:]
    if set(names) != set(values):
        raise TypeError(
            f"{kernel.py_func.__name__}: the arguments {sorted(set(names) ^ set(values))} are missing or unknown"
        )
    return [values[name] for name in names]
