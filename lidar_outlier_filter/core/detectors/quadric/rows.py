# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Work on rows of twelve numbers in vectors of the processor, which numba does not find by itself.

The elements of a row are independent: each gets what the loops of :func:`add_row` and
:func:`rotate_rows` give it, in the same order. But what is added to stays in registers.
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
HALF, MOST = 4, 8  # so many are enough for a size up to that


def add_row(
    target: Floats, row: int, factor: float, source: Floats, other: int | np.uint64, size: int
) -> None:
    """Add a multiple of a row to another one: of the elements 4, 8 or all, at least ``size``."""
    for k in range(HALF if size <= HALF else MOST if size <= MOST else WIDTH):
        target[row, k] += factor * source[other, k]


def rotate_rows(matrix: Floats, row: int, other: int, cosine: float, sine: float) -> None:
    """Rotate two rows of a matrix."""
    for k in range(WIDTH):
        one, two = matrix[row, k], matrix[other, k]
        matrix[row, k], matrix[other, k] = cosine * one - sine * two, sine * one + cosine * two


class _Elements:
    """Some elements of rows, as LLVM has them."""

    def __init__(self, begin: int, lanes: int, context: Any, builder: Any) -> None:
        self.begin, self.context, self.builder = begin, context, builder
        self.type = ir.VectorType(ir.DoubleType(), lanes)
        self.zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)

    def address(self, kind: Any, array: Any, row: Any) -> Any:
        """Return where they are in a row of an array."""
        build = self.builder
        first = build.mul(row, ir.Constant(ir.IntType(64), WIDTH))
        first = build.add(first, ir.Constant(ir.IntType(64), self.begin))
        data = self.context.make_array(kind)(self.context, build, array).data
        return build.bitcast(build.gep(data, [first]), self.type.as_pointer())

    def repeat(self, value: Any) -> Any:
        """Repeat a number."""
        nothing = ir.Constant(self.type, ir.Undefined)
        one = self.builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
        return self.builder.shuffle_vector(one, nothing, self.zeros)

    def load(self, address: Any) -> Any:
        """Read them; rows begin at any number."""
        return self.builder.load(address, align=8)


def _adder(begin: int, lanes: int) -> Any:
    """Make the loop over some elements of :func:`add_row`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        some, kinds = _Elements(begin, lanes, context, builder), signature.args
        target = some.address(kinds[0], *values[:2])
        source = some.load(some.address(kinds[3], *values[3:]))
        product = builder.fmul(some.repeat(values[2]), source)
        builder.store(builder.fadd(some.load(target), product), target, align=8)
        return context.get_dummy_value()

    @intrinsic
    def add(_context: Any, target: Any, _row: Any, _factor: Any, source: Any, _other: Any) -> Any:
        given = types.void(target, types.uint64, types.float64, source, types.uint64)
        return given, generate

    return add


def _rotator(begin: int, lanes: int) -> Any:
    """Make the loop over some elements of :func:`rotate_rows`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        some, (matrix, row, other, cosine, sine) = _Elements(begin, lanes, context, builder), values
        addresses = [some.address(signature.args[0], matrix, which) for which in (row, other)]
        one, two = (some.load(address) for address in addresses)
        cosine, sine = some.repeat(cosine), some.repeat(sine)
        first = builder.fsub(builder.fmul(cosine, one), builder.fmul(sine, two))
        second = builder.fadd(builder.fmul(sine, one), builder.fmul(cosine, two))
        builder.store(first, addresses[0], align=8)
        builder.store(second, addresses[1], align=8)
        return context.get_dummy_value()

    @intrinsic
    def rotate(_context: Any, matrix: Any, _row: Any, _other: Any, _cosine: Any, _sine: Any) -> Any:
        number = types.float64
        return types.void(matrix, types.uint64, types.uint64, number, number), generate

    return rotate


_add_half, _add_most, _add_rest = _adder(0, HALF), _adder(0, MOST), _adder(MOST, WIDTH - MOST)
_rotate_most, _rotate_rest = _rotator(0, MOST), _rotator(MOST, WIDTH - MOST)


# numba wants the names of the arguments, and infers their types.
@overload(add_row)
def _add_row(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    def add(target, row, factor, source, other, size):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        if size <= HALF:
            _add_half(target, row, factor, source, other)
        else:
            _add_most(target, row, factor, source, other)
            if size > MOST:
                _add_rest(target, row, factor, source, other)

    return add


@overload(rotate_rows)
def _rotate_rows(matrix, row, other, cosine, sine):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, ARG001
    def rotate(matrix, row, other, cosine, sine):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        _rotate_most(matrix, row, other, cosine, sine)
        _rotate_rest(matrix, row, other, cosine, sine)

    return rotate
