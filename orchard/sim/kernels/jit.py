"""The compiler settings of the kernels, and the functions of orchard/field/repeatable.py compiled.

These have the same formulas as in Python, and so the same bits. A kernel is a function that numba
compiles: `jit` for most, `allocating` for those that make arrays, `inlined` for small functions
within others.
"""

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

# NUMBA_DISABLE_JIT has no effect here, because a user may have set it for other programs. As plain
# Python a run would be very slow, and no test compares its bits.
numba.config.DISABLE_JIT = False
_folder = kernels_folder()
_files = None if _folder is None else KernelFiles(_folder)


class _Cache(NullCache):
    """Keeps the code of one kernel in files with checksums.

    Numba's own cache loads whatever is in its files.
    """

    def __init__(self, files: KernelFiles, function: Callable[..., Any], sources: str) -> None:
        self._files = files
        self._name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        self._sources = sources

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the code for a signature, as numba asks for it; None if it must be compiled."""
        # Code that is loaded calls functions that count references. Numba initializes them only
        # where it compiles.
        rtsys.initialize(target_context)
        code = self._files.load(self._file_name(sig, target_context.codegen()))
        if code is None:
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(code))

    def save_overload(self, sig: Any, cres: CompileResult) -> None:
        """Keep the code for a signature, as numba hands it over."""
        # Dynamic globals are pointers, which another process must not use.
        if not cres.library.has_dynamic_globals:
            self._files.keep(self._file_name(sig, cres.codegen), dumps(cres._reduce()))

    def is_kept(self, sig: Any, codegen: Any) -> bool:
        """Whether there is code for a signature, sound or not."""
        return (self._files.folder / self._file_name(sig, codegen)).exists()

    def _file_name(self, sig: Any, codegen: Any) -> str:
        """Return the name of the file of a signature. It names all on which the code depends."""
        machine = repr((numba.__version__, sys.version_info, sig, codegen.magic_tuple()))
        machine += self._sources
        return f"{self._name}-{hashlib.sha256(machine.encode()).hexdigest()[:32]}.nbc"


def jit(
    function: Callable[..., Any],
    allocates: bool = False,
    sources: str | None = "",
    **options: Any,
) -> Any:
    """Return the function compiled. Its code is kept on the disk.

    `allocates`: whether it makes arrays. If a function makes arrays and does not say so, numba
    refuses it. In a function that makes none, numba counts no references to arrays. That counting
    took a third of a step of ten robots: without it an array costs a call from Python 45 ns instead
    of 110, and a call of an inner function nothing.

    `sources`: a digest of the files beside those of this package on which its code depends; None:
    its code is not kept, because it is part of that of others.
    """
    # There is no `fastmath`, which would change the bits.
    compiler = njit(nogil=True, error_model="numpy", _nrt=allocates, **options)
    kernel = compiler(function)
    if _files is not None and sources is not None:
        kernel._cache = _Cache(_files, function, sources)
    return kernel


def is_kept(kernel: Any, signature: tuple[Any, ...]) -> bool:
    """Whether code of a kernel is kept on the disk. If not, its first call compiles it."""
    cache = kernel._cache
    return isinstance(cache, _Cache) and cache.is_kept(signature, kernel.targetctx.codegen())


allocating = partial(jit, allocates=True)
# For functions that inner loops call. It saves passing their arrays, seven words each.
inlined = partial(jit, forceinline=True)

for _inner in (
    repeatable.sine_series,
    repeatable.cosine_series,
    repeatable.arctan_unit,
    repeatable.log,
    repeatable.exponential,
):
    register_jitable(_inner)

sin_cos = jit(repeatable.sin_cos)
atan2 = jit(repeatable.atan2)
wrap = jit(repeatable.wrap)
log = jit(repeatable.log)

INTEGER = numba.int64

T = TypeVar("T")


def in_order(kernel: Any, values: Mapping[str, T], skip: int = 0) -> list[T]:
    """Return `values`, given by name, in the order of a kernel's parameters after the first `skip`.

    Kernels take many arrays by position, because numba unpacks a named tuple slowly. With this
    function no two of them can be swapped. Raises TypeError if the names are not those of the
    parameters.
    """
    names = list(signature(kernel.py_func).parameters)[skip:]
    wrong = sorted(set(names) ^ set(values))
    if wrong:
        name = kernel.py_func.__name__
        raise TypeError(f"{name}: the arguments {wrong} are missing or unknown")
    return [values[name] for name in names]
