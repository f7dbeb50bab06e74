"""Numba typing and lowering of intrinsics and rows.

Imported where something is compiled, and only there. The intrinsics are those of :mod:`cutenv._engine.intrinsics`; rows
are records whose fields are short arrays, one element for each lane.

``row.blade[n]`` is what kernels consist of.  Numba lowers it as an access to any array, whose shape and strides may
change and whose indices may be negative, for which a kernel of some hundred accesses takes several seconds.  Here the
shape is part of the type, indices count from 0, and an access is one address and one load or store.
"""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numba.extending
from llvmlite import ir
from numba.core import cgutils, imputils, types
from numba.core.datamodel import models
from numba.np import arrayobj, numpy_support

from cutenv._engine.intrinsics import (
    CACHE_LINE,
    as_float64_view,
    atomic_add,
    atomic_load,
    bits_of,
    first_row,
    float_of,
    keep_alive,
    prefetch,
    without_refcount,
)

Function = TypeVar("Function", bound=Callable[..., Any])

_llvm: Any = cgutils  # these libraries have no type annotations
_lower: Any = numba.extending.lower_builtin
_type: Any = numba.extending.type_callable
_arrays: Any = arrayobj
_results: Any = imputils


def type_callable(function: Callable[..., Any]) -> Callable[[Function], Function]:
    """Register the typing of ``function`` in kernels (typed `numba.extending.type_callable`)."""
    return cast(Callable[[Function], Function], _type(function))


def lower_builtin(function: Callable[..., Any], *kinds: Any) -> Callable[[Function], Function]:
    """Register LLVM lowering for ``function``, faster than `@overload`."""
    return cast(Callable[[Function], Function], _lower(function, *kinds))


def array_data(context: Any, builder: Any, signature: Any, arguments: Any, k: int) -> Any:
    """Return the data pointer of argument ``k``, an array."""
    return context.make_array(signature.args[k])(context, builder, arguments[k]).data


_NUMBERS = numba.types.Array(numba.types.float64, 1, "C")
_RESULTS: dict[Callable[..., Any], Callable[..., Any]] = {
    bits_of: lambda number: numba.types.int64,
    float_of: lambda bits: numba.types.float64,
    prefetch: lambda array, i: numba.types.none,
    keep_alive: lambda array: numba.types.none,
    without_refcount: lambda arrays: arrays,
    as_float64_view: lambda records: _NUMBERS if getattr(records, "layout", None) == "C" else None,
    atomic_add: lambda counters, row, which, size: numba.types.int64,
    atomic_load: lambda counters, row, which: numba.types.int64,
}
"""Type of what each intrinsic returns, by the types of its arguments."""
for _function, _typer in _RESULTS.items():
    type_callable(_function)(lambda context, typer=_typer: typer)


@lower_builtin(bits_of, numba.types.float64)
def _bits_of(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.bitcast(arguments[0], ir.IntType(64))


@lower_builtin(float_of, numba.types.int64)
def _float_of(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.bitcast(arguments[0], ir.DoubleType())


@lower_builtin(prefetch, numba.types.Array, numba.types.Integer)
def _fetch_ahead(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    data = array_data(context, builder, signature, arguments, 0)
    pointer = builder.bitcast(builder.gep(data, [arguments[1]]), cgutils.voidptr_t)
    word = ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, word, word, word])
    prefetch = builder.module.declare_intrinsic("llvm.prefetch", (cgutils.voidptr_t,), kind)
    builder.call(prefetch, [pointer, word(0), word(3), word(1)])  # for reading, high locality, data cache
    return context.get_dummy_value()


@lower_builtin(keep_alive, numba.types.Array)
def _kept(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return context.get_dummy_value()


@lower_builtin(without_refcount, numba.types.BaseTuple)
def _borrowed(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    uncounted = []
    for kind, counted in zip(signature.args[0], _llvm.unpack_tuple(builder, arguments[0]), strict=True):
        if not isinstance(kind, numba.types.Array):
            uncounted.append(counted)
            continue
        array = context.make_array(kind)(context, builder, counted)
        array.meminfo = _llvm.get_null_value(array.meminfo.type)
        array.parent = _llvm.get_null_value(array.parent.type)
        uncounted.append(array._getvalue())
    return context.make_tuple(builder, signature.return_type, uncounted)


_WORD = ir.IntType(64)


@lower_builtin(as_float64_view, numba.types.Array)
def _as_numbers(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    numbers = context.make_array(_NUMBERS)(context, builder)
    width = context.get_constant(numba.types.intp, 8)
    size = builder.udiv(builder.mul(array.nitems, array.itemsize), width)
    data = builder.bitcast(array.data, numbers.data.type)
    _arrays.populate_array(numbers, data, [size], [width], width, array.meminfo, array.parent)
    return _results.impl_ret_borrowed(context, builder, _NUMBERS, numbers._getvalue())


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    row, which = (_integer(context, builder, signature, arguments, k) for k in (1, 2))
    place = builder.add(builder.mul(row, _WORD(CACHE_LINE)), which)
    return builder.gep(array_data(context, builder, signature, arguments, 0), [place])


def _integer(context: Any, builder: Any, signature: Any, arguments: Any, k: int) -> Any:
    return context.cast(builder, arguments[k], signature.args[k], numba.types.int64)


@lower_builtin(atomic_add, numba.types.Array, *[numba.types.Integer] * 3)
def _count_up(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    place = _place(context, builder, signature, arguments)
    return builder.atomic_rmw("add", place, _integer(context, builder, signature, arguments, 3), "acq_rel")


@lower_builtin(atomic_load, numba.types.Array, *[numba.types.Integer] * 2)
def _counted(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.load_atomic(_place(context, builder, signature, arguments), "acquire", 8)


_models: Any = models
_registry: Any = arrayobj
_from_dtype: Any = numpy_support.from_dtype


class Lanes(types.NestedArray):
    """Type of a row's field: an array of fixed shape, addressed directly."""


class RowType(types.Record):
    """Type of a row: a record whose array fields are :class:`Lanes`."""

    def __init__(self, record: types.Record) -> None:
        fields: list[Any] = [
            (
                name,
                {
                    "type": Lanes(field.type.dtype, field.type.shape)
                    if isinstance(field.type, types.NestedArray)
                    else field.type,
                    "offset": field.offset,
                },
            )
            for name, field in record.fields.items()
        ]
        super().__init__(fields, record.size, record.aligned)
        # The same in every process: kernels on disk are found by it, and Python's own hash is another each time.
        self.name = f"RowType({hashlib.sha256(self.name.encode()).hexdigest()[:16]})"

    def __repr__(self) -> str:
        return self.name


_models.register_default(Lanes)(_models.NestedArrayModel)
_models.register_default(RowType)(_models.RecordModel)
_rows: dict[Any, RowType] = {}


@type_callable(first_row)
def _type_of_row(_: Any) -> Any:
    def row(rows: Any) -> Any:
        if rows.dtype not in _rows:
            _rows[rows.dtype] = RowType(rows.dtype)
        return _rows[rows.dtype]

    return row


@lower_builtin(first_row, types.Array)
def _first_row(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    return builder.bitcast(data, context.get_value_type(signature.return_type))


def _word(value: int) -> Any:
    return ir.Constant(ir.IntType(64), value)


def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    element = kind.typeof(name)
    if not isinstance(element, Lanes):
        pointer = _llvm.get_record_member(builder, value, kind.offset(name), context.get_data_type(element))
        return context.unpack_value(builder, element, pointer)
    data = _llvm.get_record_member(builder, value, kind.offset(name), context.get_data_type(element.dtype))
    model = context.data_model_manager[element]
    known = {
        "nitems": _word(element.nitems),
        "itemsize": _word(element.size),
        "shape": ir.Constant(ir.ArrayType(ir.IntType(64), element.ndim), [_word(n) for n in element.shape]),
        "strides": ir.Constant(ir.ArrayType(ir.IntType(64), element.ndim), [_word(n) for n in element.strides]),
    }
    whole = context.get_value_type(element)
    parts = [
        known.get(field, ir.Constant(kind, None)) for field, kind in zip(model._fields, whole.elements, strict=True)
    ]
    return builder.insert_value(ir.Constant(whole, parts), data, model._fields.index("data"))


_registry.lower_getattr_generic(RowType)(_field)


def _address(context: Any, builder: Any, lanes: Any, value: Any, indices: Any, kinds: Any) -> Any:
    data = builder.extract_value(value, context.data_model_manager[lanes]._fields.index("data"))
    place = None
    for index, kind, stride in zip(indices, kinds, lanes.strides, strict=True):
        whole = context.cast(builder, index, kind, types.intp)
        part = builder.mul(whole, _word(stride // lanes.size)) if stride != lanes.size else whole
        place = part if place is None else builder.add(place, part)
    return builder.gep(data, [place], inbounds=True)


@lower_builtin(operator.getitem, Lanes, types.Integer)
def _load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    pointer = _address(context, builder, signature.args[0], arguments[0], arguments[1:], signature.args[1:])
    return context.unpack_value(builder, signature.return_type, pointer)


@lower_builtin(operator.setitem, Lanes, types.Integer, types.Number)
def _store(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    lanes, index, kind = signature.args
    pointer = _address(context, builder, lanes, arguments[0], [arguments[1]], [index])
    value = context.cast(builder, arguments[2], kind, lanes.dtype)
    context.pack_value(builder, lanes.dtype, value, pointer)
    return context.get_dummy_value()
