"""Many arrays as one argument of compiled functions: a record of their addresses.

Numba hands over each array in seven words. Between functions that take a tuple of two dozen arrays
that is most of the code: compiling it took twice as long. The event model hands over its columns
so (`orchard.event_model.columns`): Python makes the record by `addresses`, and compiled code opens
it by `opens` and then reads `record.name` as an array.
"""

import hashlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import OpaqueModel
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    register_model,
)
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import from_dtype

# The type of what `ArrayRecord.addresses` returns, for numba.
ADDRESSES = types.Array(types.int64, 1, "C")
# Words of 8 bytes of an array: its address, and its shape of at most three dimensions.
WORDS = 4


class ArraysType(types.Type):
    """The type of a record of arrays, in compiled functions. Arrays are attributes of it."""

    def __init__(self, arrays: tuple[tuple[str, types.Array], ...]) -> None:
        self.names = [name for name, _ in arrays]
        self.arrays = dict(arrays)
        # Numba makes the name of a type a part of the name of each function that takes it. With all
        # columns in it, names took most of the code, and of the time to compile it.
        columns = hashlib.sha256(repr(arrays).encode()).hexdigest()[:16]
        super().__init__(f"Arrays({columns})")


@register_model(ArraysType)
class _ArraysModel(OpaqueModel):
    """An address."""


@infer_getattr
class _ArraysAttribute(AttributeTemplate):
    key = ArraysType

    def generic_resolve(self, arrays: ArraysType, attr: str) -> types.Array | None:
        """Return the type of an array, as numba asks for it."""
        return arrays.arrays.get(attr)


@lower_getattr_generic(ArraysType)
def _array(context: Any, builder: Any, arrays: ArraysType, value: Any, attr: str) -> Any:
    """Make an array from its words. They do not change while a compiled function runs."""
    kind = arrays.arrays[attr]
    word = ir.IntType(64)
    words = builder.bitcast(value, word.as_pointer())
    first = WORDS * arrays.names.index(attr)

    def load(number: int) -> Any:
        """Read one of its words."""
        place = builder.gep(words, [ir.Constant(word, first + number)])
        loaded = builder.load(place)
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    array = make_array(kind)(context, builder)
    itemsize = ir.Constant(word, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    shape = [load(1 + dimension) for dimension in range(kind.ndim)]
    strides = [itemsize]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(load(0), context.get_data_type(kind.dtype).as_pointer())
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=itemsize, meminfo=None)
    return array._getvalue()


class ArrayRecord:
    """A record of named arrays: how many dimensions each has, and of what."""

    def __init__(self, arrays: Mapping[str, tuple[Any, int]]) -> None:
        """`arrays`: of each array its dtype, and its number of dimensions."""
        self._arrays = arrays
        # The place of each array in the record.
        self._numbers = {name: number for number, name in enumerate(arrays)}
        # Of each array the dtype object that was last compared with its dtype, and equal.
        self._dtypes: dict[str, np.dtype] = {}
        kinds = []
        for name, (dtype, dimensions) in arrays.items():
            kinds.append((name, types.Array(from_dtype(np.dtype(dtype)), dimensions, "C")))
        self.opens = _opens(ArraysType(tuple(kinds)))

    def addresses(
        self, arrays: Mapping[str, np.ndarray], before: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the addresses and shapes of arrays, which compiled functions open by `opens`.

        `before`: what this method returned for other arrays, of which `arrays` replace some; None:
        `arrays` are all. The record does not keep the arrays alive: its caller must, as long as it
        is used. Raises ValueError for arrays that are not those of this record.
        """
        names: Iterable[str] = arrays
        if before is None:
            names = self._arrays
            before = np.zeros(WORDS * len(self._arrays), np.int64)
        words = before.reshape(-1, WORDS).copy()
        for name in names:
            dtype, dimensions = self._arrays[name]
            # Each access to an attribute of a recarray costs a microsecond, so it is viewed as a
            # plain array.
            plain = arrays[name].view(np.ndarray)
            # Each comparison of two dtypes of records costs a microsecond too; that of two objects
            # by identity does not.
            is_known = plain.dtype is self._dtypes.get(name) or plain.dtype == dtype
            if not is_known or plain.ndim != dimensions or not plain.flags.c_contiguous:
                raise ValueError(f"{name}: this is no array of {dtype} in {dimensions} dimensions")
            self._dtypes[name] = plain.dtype
            row = words[self._numbers[name]]
            row[0] = plain.ctypes.data
            row[1 : 1 + dimensions] = plain.shape
        return words.ravel()


def _opens(opened: ArraysType) -> Any:
    """Return a function for compiled functions: of a record's words it makes the record.

    `opened`: numba's type of the record. No code runs for it: the address of the words is taken for
    that of the record.
    """

    @intrinsic
    def opens(typing: Any, addresses: Any) -> Any:
        """Return the signature of the function, and what generates its code, as numba asks."""

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            """Generate the code: the pointer to the words as a pointer to the record."""
            words = make_array(signature.args[0])(context, builder, arguments[0])
            return builder.bitcast(words.data, context.get_value_type(opened))

        return opened(ADDRESSES), generate

    return opens
