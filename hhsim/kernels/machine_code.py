"""Machine code that kernels call by its address: made once, it serves all of them, where each would have its own.

A kernel that another one calls by its name becomes part of that one's machine code, which for a whole tick takes half a
minute to make. By its address it is the very code that Python calls.
"""

from collections.abc import Callable
from typing import Any, cast

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hhsim.kernels.jit import JIT_ENABLED


def code_of(kernel: Any, *arguments: Any) -> Any:
    """Return what `call_code` takes: the address of a kernel's machine code for arguments of these types.

    It is compiled or loaded if need be. Where nothing is compiled it is the kernel itself.
    """
    return kernel.address(*arguments) if JIT_ENABLED else kernel


def _call(typing: Any, address: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        kinds = signature.args[1].types
        values = cgutils.unpack_tuple(builder, given[1])
        kind = context.call_conv.get_function_type(types.int64, kinds)
        function = builder.inttoptr(given[0], kind.as_pointer())
        _, found = context.call_conv.call_function(builder, function, types.int64, kinds, values)
        return found

    return types.int64(types.int64, arguments), generate


if JIT_ENABLED:
    call_code = cast(Callable[[Any, Any], int], intrinsic(_call))
    """Call machine code with a tuple of arguments of the types that it was compiled for; it returns an integer."""

else:

    def call_code(code: Any, arguments: Any) -> int:
        """Call a kernel that is not compiled."""
        return int(code(*arguments))
