"""Fast compilation of rows: records whose fields are short arrays, one element for each lane.

``row.blade[n]`` is what kernels consist of.  Numba lowers it as an access to any array, whose shape and strides may
change and whose indices may be negative, for which a kernel of some hundred accesses takes several seconds.  Here the
shape is part of the type, indices count from 0, and an access is one address and one load or store.
"""

from __future__ import annotations

import hashlib
import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.np import arrayobj, numpy_support

from cutenv._engine.intrinsics import first_row
from cutenv._engine.lowering import lower_builtin, type_callable

_llvm: Any = cgutils  # these libraries have no type annotations
_models: Any = models
_registry: Any = arrayobj
_from_dtype: Any = numpy_support.from_dtype


class Lanes(types.NestedArray):
    """Type of a field of a row: an array of fixed shape whose elements are addressed directly."""


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
