# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors of numbers that kernels hold in registers, where numba would keep sums in memory.

Kernels calculate with them as with numbers: each element gets what a loop over numbers gives it,
bit by bit. Where kernels are not compiled, vectors are arrays of numpy.
"""

import inspect
import operator
from typing import Any

import numpy as np
from numba import types
from numba.core.cgutils import ir  # type: ignore[attr-defined]  # llvmlite's, which it brings
from numba.extending import lower_builtin, models, register_model, type_callable
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Floats, Single

WIDTH = 16  # elements: as many singles as fit into the largest register of any processor
ROW, FEW_LANES, MANY_LANES = 12, 4, 8  # elements of a row, and those enough for a size up to that


def load(values: NDArray[Any], at: int) -> Any:
    """Return the elements from a flat index on."""
    return values.reshape(-1)[at : at + WIDTH].copy()


def take(values: NDArray[Any], positions: NDArray[Any], at: int, off: int, in_step: bool) -> Any:  # noqa: ARG001
    """Return ``values`` at ``positions[at:] + off``; fast where these follow each other.

    ``in_step`` says whether they do, see :func:`follow`.
    """
    return values[positions[at : at + WIDTH] + off]


def follow(positions: Any) -> bool:
    """Return whether each place is the one behind the place before."""
    return bool((positions == positions[0] + np.arange(WIDTH)).all())


def store(values: NDArray[Any], at: int, vector: Any) -> None:
    """Write the elements from a flat index on."""
    values.reshape(-1)[at : at + WIDTH] = vector


def repeat(value: Single) -> Any:
    """Return a vector of one value."""
    return np.full(WIDTH, value, np.float32)


def single(vector: Any) -> Any:
    """Return the elements in single precision."""
    return np.asarray(vector, np.float32)


def no_counts() -> Any:
    """Return counts of 0."""
    return np.zeros(WIDTH, np.int32)


def count(counts: Any, mask: Any) -> Any:
    """Return the counts, one more where the mask is True."""
    return counts + mask


def select(mask: Any, one: Any, other: Any) -> Any:
    """Return one where the mask is True, and the other elsewhere."""
    return np.where(mask, one, other)


def least(one: Any, other: Any) -> Any:
    """Return ``min(one, other)``."""
    return np.where(other < one, other, one)


def most(one: Any, other: Any) -> Any:
    """Return ``max(one, other)``."""
    return np.where(other > one, other, one)


def root(vector: Any) -> Any:
    """Return the square roots."""
    return np.sqrt(vector)


def add_row(
    target: Floats, row: int, factor: float, source: Floats, other: int | np.uint64, size: int
) -> None:
    """Add a multiple of a row to another one: of the elements 4, 8 or all, at least ``size``."""
    for k in range(FEW_LANES if size <= FEW_LANES else MANY_LANES if size <= MANY_LANES else ROW):
        target[row, k] += factor * source[other, k]


class LaneVector(types.Type):
    """Numba's type of a vector."""

    def __init__(self, element: Any) -> None:
        """Name it, by which numba compares types."""
        self.element = element
        super().__init__(name=f'LaneVector({element})')


@register_model(LaneVector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: LaneVector) -> None:
        element = manager[kind.element].get_value_type()
        super().__init__(manager, kind, ir.VectorType(element, WIDTH))  # type: ignore[no-untyped-call]


SINGLES, COUNTS = LaneVector(types.float32), LaneVector(types.int32)
MASK = LaneVector(types.boolean)
_INDEX = ir.IntType(64)


def _define(function: Any, returned: Any, make: Any, *kinds: Any) -> None:
    """Let kernels call a function with arguments of the given kinds, or any.

    ``returned`` takes their types and gives that of the result, None where there is no vector;
    ``make`` writes the code, and gets the context, a builder, these types and the values.
    """

    def typer(*given: Any) -> Any:
        return returned(*given)

    # numba asks it how many arguments there are.
    arguments = typer.__signature__ = inspect.signature(function)  # type: ignore[attr-defined]
    type_callable(function)(lambda _context: typer)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return make(context, builder, signature.args, values)

    any_kinds = (types.Any,) * len(arguments.parameters)
    lower_builtin(function, *(kinds or any_kinds))(generate)  # type: ignore[no-untyped-call]


def _wide(builder: Any, value: Any, lanes: int = WIDTH) -> Any:
    """Return a vector; of a number, one that repeats it."""
    if isinstance(value.type, ir.VectorType):
        return value
    nothing = ir.Constant(ir.VectorType(value.type, lanes), ir.Undefined)
    some = builder.insert_element(nothing, value, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)
    return builder.shuffle_vector(some, nothing, zeros)


def _element(*kinds: Any) -> Any:
    """Return the one type that all elements and numbers have; None without a vector."""
    found = {kind.element if isinstance(kind, LaneVector) else kind for kind in kinds}
    some = any(isinstance(kind, LaneVector) for kind in kinds)
    return found.pop() if some and len(found) == 1 else None


def _same(*kinds: Any) -> Any:
    element = _element(*kinds)
    return element and LaneVector(element)


def _mask(*kinds: Any) -> Any:
    return _element(*kinds) and MASK


def _define_operators() -> None:
    """Let kernels calculate: with two vectors, or with one and a number."""

    def define(function: Any, returned: Any, make: Any) -> None:
        def wide(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
            return make(builder, *(_wide(builder, value) for value in values))

        for kinds in (
            (LaneVector, LaneVector),
            (LaneVector, types.Number),
            (types.Number, LaneVector),
        ):
            _define(function, returned, wide, *kinds)

    define(operator.add, _same, ir.IRBuilder.fadd)
    define(operator.sub, _same, ir.IRBuilder.fsub)
    define(operator.mul, _same, ir.IRBuilder.fmul)
    define(operator.truediv, _same, ir.IRBuilder.fdiv)
    define(operator.lt, _mask, lambda builder, a, b: builder.fcmp_ordered('<', a, b))
    define(operator.le, _mask, lambda builder, a, b: builder.fcmp_ordered('<=', a, b))
    define(operator.gt, _mask, lambda builder, a, b: builder.fcmp_ordered('>', a, b))
    define(operator.and_, _same, ir.IRBuilder.and_)

    def smaller(builder: Any, a: Any, b: Any) -> Any:
        return builder.select(builder.fcmp_ordered('<', b, a), b, a)

    def larger(builder: Any, a: Any, b: Any) -> Any:
        return builder.select(builder.fcmp_ordered('>', b, a), b, a)

    define(least, _same, smaller)
    define(most, _same, larger)


def _without_sign(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
    bits = ir.VectorType(ir.IntType(32), WIDTH)
    rest = ir.Constant(bits, [0x7FFFFFFF] * WIDTH)
    return builder.bitcast(
        builder.and_(builder.bitcast(values[0], bits), rest), ir.VectorType(ir.FloatType(), WIDTH)
    )


def _root(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
    kind = ir.FunctionType(values[0].type, [values[0].type])
    function = builder.module.declare_intrinsic(f'llvm.sqrt.v{WIDTH}f32', fnty=kind)
    return builder.call(function, values)


def _load(
    context: Any, builder: Any, kinds: Any, values: Any, lanes: int = WIDTH, stored: Any = None
) -> Any:
    """Write the code that loads a vector, or stores one at the same place."""
    at = context.cast(builder, values[1], kinds[1], types.intp)
    data = context.make_array(kinds[0])(context, builder, values[0]).data
    vector, align = ir.VectorType(data.type.pointee, lanes), kinds[0].dtype.bitwidth // 8
    address = builder.bitcast(builder.gep(data, [at]), vector.as_pointer())
    if stored is None:
        return builder.load(address, align=align)
    return builder.store(stored, address, align=align)


def _store(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    _load(context, builder, kinds, values, stored=values[2])
    return context.get_dummy_value()


def _add_row(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    row, other, size = (context.cast(builder, values[n], kinds[n], types.intp) for n in (1, 4, 5))

    def add(begin: int, lanes: int) -> None:
        def move(n: int, row: Any, stored: Any = None) -> Any:
            at = builder.add(builder.mul(row, _INDEX(ROW)), _INDEX(begin))
            given = (kinds[n], types.intp), (values[n], at)
            return _load(context, builder, *given, lanes, stored)

        product = builder.fmul(_wide(builder, values[2], lanes), move(3, other))
        move(0, row, builder.fadd(move(0, row), product))

    with builder.if_else(builder.icmp_signed('<=', size, _INDEX(FEW_LANES))) as (few, many):
        with few:
            add(0, FEW_LANES)
        with many:
            add(0, MANY_LANES)
            with builder.if_then(builder.icmp_signed('>', size, _INDEX(MANY_LANES))):
                add(MANY_LANES, ROW - MANY_LANES)
    return context.get_dummy_value()


def _take(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    data = context.make_array(kinds[0])(context, builder, values[0]).data
    positions = context.make_array(kinds[1])(context, builder, values[1]).data
    at, off = (context.cast(builder, values[n], kinds[n], types.intp) for n in (2, 3))

    def address(lane: int) -> Any:
        place = builder.load(builder.gep(positions, [builder.add(at, _INDEX(lane))]))
        place = context.cast(builder, place, kinds[1].dtype, types.intp)
        return builder.gep(data, [builder.add(place, off)])

    vector = ir.VectorType(data.type.pointee, WIDTH)
    with builder.if_else(values[4]) as (in_step, otherwise):
        with in_step:
            pointer = builder.bitcast(address(0), vector.as_pointer())
            together = builder.load(pointer, align=kinds[0].dtype.bitwidth // 8)
            begin = builder.block
        with otherwise:
            each = ir.Constant(vector, ir.Undefined)
            for lane in range(WIDTH):
                value = builder.load(address(lane))
                each = builder.insert_element(each, value, ir.IntType(32)(lane))
            end = builder.block
    taken = builder.phi(vector)
    taken.add_incoming(together, begin)
    taken.add_incoming(each, end)
    return taken


def _follow(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
    first = builder.extract_element(values[0], ir.IntType(32)(0))
    steps = ir.Constant(values[0].type, list(range(WIDTH)))
    there = builder.add(_wide(builder, first), steps)
    same = builder.bitcast(builder.icmp_signed('==', values[0], there), ir.IntType(WIDTH))
    return builder.icmp_unsigned('==', same, ir.IntType(WIDTH)(2**WIDTH - 1))


def _single(_context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    singles = ir.VectorType(ir.FloatType(), WIDTH)
    if isinstance(kinds[0].element, types.Integer):
        return builder.sitofp(values[0], singles)
    return builder.fptrunc(values[0], singles)


def _select(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
    return builder.select(values[0], _wide(builder, values[1]), _wide(builder, values[2]))


def _count(_context: Any, builder: Any, _kinds: Any, values: Any) -> Any:
    # True is -1.
    return builder.sub(values[0], builder.sext(values[1], values[0].type))


def _no_counts(_context: Any, _builder: Any, _kinds: Any, _values: Any) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)


_define_operators()
_define(abs, lambda a: a if a == SINGLES else None, _without_sign, LaneVector)
_define(root, lambda a: a if a == SINGLES else None, _root, LaneVector)
_define(load, lambda values, _at: LaneVector(values.dtype), _load)
_define(store, lambda *_: types.void, _store)
_define(take, lambda values, *_: LaneVector(values.dtype), _take)
_define(follow, lambda _: types.boolean, _follow)
_define(repeat, lambda _: SINGLES, lambda _, builder, _kinds, values: _wide(builder, *values))
_define(single, lambda _: SINGLES, _single)
_define(select, lambda *_: SINGLES, _select)
_define(no_counts, lambda: COUNTS, _no_counts)
_define(count, lambda *_: COUNTS, _count)
_define(add_row, lambda *_: types.void, _add_row)
