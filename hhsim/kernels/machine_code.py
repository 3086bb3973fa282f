"""Machine code that kernels call by its address: made once, it serves all of them, where each would have its own.

A kernel that another one calls by its name becomes part of that one's machine code, which for a whole tick takes half a
minute to make. By its address it is the very code that Python calls.
"""

from collections.abc import Callable
from typing import Any, cast

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def code_of(kernel: Any, *arguments: Any) -> int:
    """Return what `call_code` takes: the address of a kernel's machine code for arguments of these types.

    It is compiled or loaded if need be.
    """
    return int(kernel.address(*arguments))


def _calls(returned: types.Type) -> Callable[..., Any]:
    """Return the declaration of an intrinsic that calls machine code which returns such a value."""

    def call(typing: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            kinds = signature.args[1].types
            values = cgutils.unpack_tuple(builder, given[1])
            kind = context.call_conv.get_function_type(returned, kinds)
            function = builder.inttoptr(given[0], kind.as_pointer())
            _, found = context.call_conv.call_function(builder, function, returned, kinds, values)
            return context.get_dummy_value() if returned == types.none else found

        return returned(types.int64, arguments), generate

    return call


call_code = cast(Callable[[Any, Any], int], intrinsic(_calls(types.int64)))
"""Call machine code with a tuple of arguments of the types that it was compiled for; it returns an integer."""
run_code = cast(Callable[[Any, Any], None], intrinsic(_calls(types.none)))
"""Call machine code that returns nothing."""
ask_code = cast(Callable[[Any, Any], bool], intrinsic(_calls(types.boolean)))
"""Call machine code that returns a truth."""
number_of_code = cast(Callable[[Any, Any], float], intrinsic(_calls(types.float64)))
"""Call machine code that returns a number."""
