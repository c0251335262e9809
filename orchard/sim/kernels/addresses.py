"""Compiled functions that compiled functions of other files call by their address in memory.

So the code of a large function is made once, and not again within each function that calls it.
"""

from typing import Any

from numba.extending import intrinsic

from orchard.sim.kernels.jit import INTEGER


def address_of(kernel: Any, signature: tuple[Any, ...]) -> int:
    """Return the address of a kernel that is compiled for a signature, in this process."""
    code = kernel.overloads[signature]
    address: int = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)
    return address


def calls(arguments: tuple[Any, Any]) -> Any:
    """Return the function that calls a kernel by its address, in compiled functions.

    `arguments`: the types of the kernel's two arguments. Its result is a whole number.
    """

    @intrinsic
    def call(typing: Any, address: Any, first: Any, second: Any) -> Any:
        """Call the kernel at an address."""

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            """Write the call as numba writes its own."""
            convention = context.call_conv
            kind = convention.get_function_type(INTEGER, arguments)
            function = builder.inttoptr(values[0], kind.as_pointer())
            _, result = convention.call_function(
                builder, function, INTEGER, arguments, list(values[1:])
            )
            return result

        return INTEGER(INTEGER, *arguments), generate

    return call
