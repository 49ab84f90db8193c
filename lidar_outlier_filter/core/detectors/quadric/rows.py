# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sums over rows of twelve numbers, in vectors of the processor that numba does not find by itself.

The elements of a row are independent: each gets what the loop in :func:`add_row` gives it. What is
new is that the rows that are added to stay in registers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

if TYPE_CHECKING:
    import numpy as np

    from lidar_outlier_filter.core.annotations import Floats

WIDTH = 12  # elements of a row
FIRST, REST = (0, 8), (8, 4)  # the first element of each vector, and how many it has


def add_row(
    target: Floats, row: int, factor: float, source: Floats, other: int | np.uint64, size: int
) -> None:
    """Add a multiple of a row to another one: the first 8 elements for a size up to 8, else all."""
    for k in range(WIDTH if size > FIRST[1] else FIRST[1]):
        target[row, k] += factor * source[other, k]


def _vector(begin: int, lanes: int) -> Any:
    """Make the loop over some elements of :func:`add_row`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vector = ir.VectorType(ir.DoubleType(), lanes)

        def address(which: int) -> Any:
            array = context.make_array(signature.args[which])(context, builder, values[which])
            row = builder.mul(values[which + 1], ir.Constant(ir.IntType(64), WIDTH))
            element = builder.add(row, ir.Constant(ir.IntType(64), begin))
            return builder.bitcast(builder.gep(array.data, [element]), vector.as_pointer())

        nothing, zeros = ir.Constant(vector, ir.Undefined), ir.VectorType(ir.IntType(32), lanes)
        factor = builder.insert_element(nothing, values[2], ir.Constant(ir.IntType(32), 0))
        factor = builder.shuffle_vector(factor, nothing, ir.Constant(zeros, [0] * lanes))
        target, before, source = address(0), builder.load(address(0)), builder.load(address(3))
        store = builder.store(builder.fadd(before, builder.fmul(factor, source)), target)
        before.align = source.align = store.align = 8
        return context.get_dummy_value()

    @intrinsic
    def add(_context: Any, target: Any, _row: Any, _factor: Any, source: Any, _other: Any) -> Any:
        given = types.void(target, types.uint64, types.float64, source, types.uint64)
        return given, generate

    return add


_add_first, _add_rest = _vector(*FIRST), _vector(*REST)


# numba wants the names of the arguments, and infers their types.
@overload(add_row)
def _add_row(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    def add(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        _add_first(target, row, factor, source, other)
        if size > 8:  # noqa: PLR2004
            _add_rest(target, row, factor, source, other)

    return add
