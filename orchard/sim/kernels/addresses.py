"""Calls between compiled functions of different files, by the address of the called one.

Otherwise numba compiles the code of a function again within each function of another file that
calls it. So the code of a large function is made once. `orchard.event_model.batch` calls the
compiled event model in this way.
"""

from typing import Any

from numba.extending import intrinsic

from orchard.sim.kernels.jit import INTEGER


def address_of(kernel: Any, signature: tuple[Any, ...]) -> int:
    """Return the address in memory of a kernel in this process.

    `signature`: the numba types of its arguments. Raises KeyError if the kernel was not compiled
    for them.
    """
    compiled = kernel.overloads[signature]
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return address


def caller_by_address(argument_types: tuple[Any, Any]) -> Any:
    """Return a function for compiled code: `call(address, first, second)` calls a kernel.

    `argument_types`: the types of the kernel's two arguments. Its result is a whole number.
    """

    @intrinsic
    def call(typing: Any, address: Any, first: Any, second: Any) -> Any:
        """Call the kernel at an address."""

        def generate(context: Any, builder: Any, signature: Any, operands: Any) -> Any:
            """Write the call in the code of LLVM, by numba's own convention."""
            address_operand, *argument_operands = operands
            convention = context.call_conv
            kind = convention.get_function_type(INTEGER, argument_types)
            function = builder.inttoptr(address_operand, kind.as_pointer())
            _, result = convention.call_function(
                builder, function, INTEGER, argument_types, argument_operands
            )
            return result

        return INTEGER(INTEGER, *argument_types), generate

    return call
