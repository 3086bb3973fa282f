"""NamedTuples that kernels take by their address in memory instead of field by field.

numba passes a NamedTuple by value: a hand's twenty arrays are some hundred and fifty arguments of every call, each line
of the compiler's text names the types of all of them, and an index into a tuple of hands copies them. By reference they
are one pointer, and a field is read where it is used. When Python calls a kernel, the tuple's fields are copied once to
the stack frame of the call; nothing changes that copy. Several tuples of one type can be copied to the rows of an array
instead (`write_rows`): kernels then take any of them by the number of its row (`declare_row`).

`Reference` is a numba type with its own data model and access to attributes, see numba's documentation of extensions.
"""

import hashlib
from collections.abc import Sequence
from itertools import accumulate, chain
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.core.typing.typeof import typeof_impl
from numba.extending import NativeValue, register_model, unbox
from numpy.typing import NDArray

T = TypeVar("T", bound=type)

ALIGNMENT = 16
"""Alignment of the fields in memory [bytes]."""
_BYTE = ir.IntType(8)


class Reference(types.Type):  # type: ignore[misc]
    """Type of a NamedTuple at an address; equal for the same class and types of fields."""

    def __init__(self, instance_class: Any, fields: tuple[types.Type, ...]) -> None:
        self.instance_class, self.types = instance_class, fields
        # The name stands in each symbol of the code that is compiled for it.
        digest = hashlib.sha256(", ".join(map(str, fields)).encode()).hexdigest()[:12]
        super().__init__(name=f"{instance_class.__qualname__}@{digest}")

    @property
    def key(self) -> Any:
        """Class and types of the fields: equal types have the same."""
        return self.instance_class, self.types

    def field(self, name: str) -> int:
        """Return the number of a field."""
        return int(self.instance_class._fields.index(name))


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BYTE.as_pointer())


_offsets: dict[Reference, tuple[int, ...]] = {}
"""Offset of each field, and the size of all [bytes]: LLVM parses a program for each size that it is asked for."""


def _places(context: Any, kind: Reference) -> tuple[int, ...]:
    if kind not in _offsets:
        models = [context.data_model_manager[field] for field in kind.types]
        sizes = (context.get_abi_sizeof(model.get_data_type()) for model in models)
        _offsets[kind] = (0, *accumulate(-(-size // ALIGNMENT) * ALIGNMENT for size in sizes))
    return _offsets[kind]


def _field_pointer(context: Any, builder: Any, kind: Reference, address: Any, number: int) -> tuple[Any, Any]:
    model = context.data_model_manager[kind.types[number]]
    offset = ir.Constant(ir.IntType(64), _places(context, kind)[number])
    place = builder.gep(address, [offset], inbounds=True)
    return model, builder.bitcast(place, model.get_data_type().as_pointer())


@infer_getattr
class _ReferenceFields(AttributeTemplate):  # type: ignore[misc]
    key = Reference

    def generic_resolve(self, kind: Reference, name: str) -> types.Type | None:
        """Return the type of a field."""
        return kind.types[kind.field(name)] if name in kind.instance_class._fields else None


def _read_field(context: Any, builder: Any, kind: Reference, address: Any, name: str) -> Any:
    number = kind.field(name)
    model, place = _field_pointer(context, builder, kind, address, number)
    value = model.load_from_data_pointer(builder, place)
    return impl_ret_borrowed(context, builder, kind.types[number], value)


def _holds_reference(field: types.Type) -> bool:
    return isinstance(field, Reference) or any(map(_holds_reference, getattr(field, "types", ())))


def _fill(call: Any, kind: Reference, value: Any, address: Any) -> tuple[Any, list[Any]]:
    """Write a tuple down at an address; return whether that failed, and what is to be called when it is done with."""
    builder, failed, cleanups = call.builder, cgutils.false_bit, []
    for number, field in enumerate(kind.types):
        native = call.unbox(field, call.pyapi.tuple_getitem(value, number))
        model, place = _field_pointer(call.context, builder, kind, address, number)
        builder.store(model.as_data(builder, native.value), place)
        failed = builder.or_(failed, native.is_error)
        if native.cleanup is not None:
            cleanups.append(native.cleanup)
    return failed, cleanups


def _filler(call: Any, kind: Reference) -> Any:
    """Return the function that writes such a tuple down: a hand's would else be a thousand instructions each time."""
    name, module = f"write_down.{kind.name}", call.builder.module
    if name in module.globals:
        return module.globals[name]
    filler = ir.Function(module, ir.FunctionType(ir.IntType(1), [call.pyapi.pyobj, _BYTE.as_pointer()]), name)
    filler.linkage = "internal"
    filler.attributes.add("noinline")
    builder = ir.IRBuilder(filler.append_basic_block())
    inner = type(call)(call.context, builder, call.context.get_python_api(builder))
    failed, _ = _fill(inner, kind, *filler.args)
    builder.ret(failed)
    return filler


def _write_down(kind: Reference, value: Any, call: Any) -> NativeValue:
    context, builder = call.context, call.builder
    memory = cgutils.alloca_once(builder, ir.ArrayType(_BYTE, _places(context, kind)[-1]))
    memory.align = ALIGNMENT
    address = builder.bitcast(memory, _BYTE.as_pointer())
    # A tuple inside would be copied to the frame of `_filler`, and its address would be invalid when that returns.
    if any(map(_holds_reference, kind.types)):
        failed, cleanups = _fill(call, kind, value, address)
    else:
        failed, cleanups = builder.call(_filler(call, kind), [value, address]), []

    def clean() -> None:
        for cleanup in reversed(cleanups):
            cleanup()
        # Where kernels count references, numba frees those of an argument, and looks into none behind an address.
        for number, field in enumerate(kind.types if context.enable_nrt else ()):
            model, place = _field_pointer(context, builder, kind, address, number)
            context.nrt.decref(builder, field, model.load_from_data_pointer(builder, place))

    return NativeValue(address, cleanup=clean, is_error=failed)


lower_getattr_generic(Reference)(_read_field)
unbox(Reference)(_write_down)


def by_reference(kind: T) -> T:
    """Have kernels take a NamedTuple by reference when Python passes it, alone or in another one."""

    def typeof(value: Any, context: Any) -> Reference | None:
        fields = tuple(typeof_impl(field, context) for field in value)
        return None if any(field is None for field in fields) else Reference(kind, fields)

    typeof_impl.register(kind)(typeof)
    return kind


def _words(value: Any) -> list[Any]:
    # As numba lays out an array's structure, which owns nothing here; each field begins at a multiple of `ALIGNMENT`.
    if isinstance(value, tuple):
        words = [0]
    elif isinstance(value, np.ndarray):
        words = [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    else:
        assert isinstance(value, (int, float, np.int64)) and not isinstance(value, bool), f"no number: {value!r}"
        words = [int(np.asarray(value).view(np.int64))]
    return words + [0] * (len(words) % 2)


def _write(values: Any, address: int) -> list[Any]:
    """Return the words of a tuple that is to be at an address, with those of the tuples in it behind its own."""
    fields = [_words(value) for value in values]
    inner, place = list[Any](), sum(map(len, fields))
    for value, words in zip(values, fields):
        if isinstance(value, tuple):
            words[0] = address + 8 * (place + len(inner))
            inner += _write(value, words[0])
    return [*chain(*fields), *inner]


def write_rows(tuples: Sequence[Any]) -> NDArray[np.int64]:
    """Write down tuples of one type, of arrays, numbers and such tuples; returns a row for each, for `declare_row`.

    The rows hold where the arrays are, and do not keep them.
    """
    written = np.zeros((len(tuples), len(_write(tuples[0], 0)) if tuples else 0), np.int64)
    for row, values in zip(written, tuples):
        row[:] = _write(values, row.ctypes.data)
    return written


def declare_row(typing: Any, like: Any, rows: Any, number: Any) -> Any:
    """Declare an intrinsic that returns the tuple in a row of `write_rows`, of the type of its first argument."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        array = context.make_array(signature.args[1])(context, builder, given[1])
        stride = cgutils.unpack_tuple(builder, array.strides)[0]
        place = builder.mul(stride, context.cast(builder, given[2], signature.args[2], types.int64))
        return builder.gep(builder.bitcast(array.data, _BYTE.as_pointer()), [place])

    return like(like, rows, number), generate
