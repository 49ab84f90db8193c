# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of rows of twelve numbers, in vectors of the processor, which numba does not find by itself.

Each element gets what the loop of :func:`add_row` gives it, but what is added to stays in
registers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types
from numba.core.cgutils import ir  # type: ignore[attr-defined]  # llvmlite's, which it brings
from numba.extending import intrinsic, overload

if TYPE_CHECKING:
    import numpy as np

    from lidar_outlier_filter.core.annotations import Floats

WIDTH = 12  # elements of a row
FEW_LANES, MANY_LANES = 4, 8  # so many are enough for a size up to that


def add_row(
    target: Floats, row: int, factor: float, source: Floats, other: int | np.uint64, size: int
) -> None:
    """Add a multiple of a row to another one: of the elements 4, 8 or all, at least ``size``."""
    for k in range(FEW_LANES if size <= FEW_LANES else MANY_LANES if size <= MANY_LANES else WIDTH):
        target[row, k] += factor * source[other, k]


def _adder(begin: int, lanes: int) -> Any:
    """Make the loop over some elements of :func:`add_row`: one vector."""
    vector = ir.VectorType(ir.DoubleType(), lanes)
    nothing, zero = ir.Constant(vector, ir.Undefined), ir.Constant(ir.IntType(32), 0)
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def address(which: int) -> Any:
            array = context.make_array(signature.args[which])(context, builder, values[which])
            first = builder.mul(values[which + 1], ir.Constant(ir.IntType(64), WIDTH))
            first = builder.add(first, ir.Constant(ir.IntType(64), begin))
            return builder.bitcast(builder.gep(array.data, [first]), vector.as_pointer())

        factor = builder.insert_element(nothing, values[2], zero)
        factor = builder.shuffle_vector(factor, nothing, zeros)
        target, source = address(0), builder.load(address(3), align=8)
        total = builder.fadd(builder.load(target, align=8), builder.fmul(factor, source))
        builder.store(total, target, align=8)
        return context.get_dummy_value()

    @intrinsic
    def add(_context: Any, target: Any, _row: Any, _factor: Any, source: Any, _other: Any) -> Any:
        given = types.void(target, types.uint64, types.float64, source, types.uint64)
        return given, generate

    return add


_add_half, _add_most, _add_rest = (
    _adder(0, FEW_LANES),
    _adder(0, MANY_LANES),
    _adder(MANY_LANES, WIDTH - MANY_LANES),
)


# numba wants the names of the arguments, and infers their types.
@overload(add_row)
def _add_row(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    def add(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        if size <= FEW_LANES:
            _add_half(target, row, factor, source, other)
        else:
            _add_most(target, row, factor, source, other)
            if size > MANY_LANES:
                _add_rest(target, row, factor, source, other)

    return add
