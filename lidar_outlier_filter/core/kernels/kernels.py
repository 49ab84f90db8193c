# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled, and the small ones that several subpackages share."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.compiler import Compiler
from numpy.typing import NDArray

from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile, use_temporary_folder

SMALL = 16  # values that are sorted rather than partitioned
MAX_PASSES = 8  # passes over the values before pivots are taken at pseudo-random indices

Function = TypeVar('Function', bound='Callable[..., object]')


def kernel(function: Function, **more: object) -> Function:
    """Compile with numba: cached on disk, without the GIL, floating point in the order written.

    No fast-math flag: it would forbid NaN, and let the result depend on the machine. What is cached
    is valid for the sources that it was made from, those of other files too. ``more`` are options
    of numba.
    """
    # Nobody calls kernels from C.
    options: dict[str, Any] = {'error_model': 'numpy', 'no_cfunc_wrapper': True, **more}
    compiler = numba.njit(cache=True, nogil=True, **options)
    try:
        compiled = compiler(function)
    except RuntimeError:  # numba finds no folder that can be written
        use_temporary_folder()
        compiled = compiler(function)
    # numba offers no other way. There is no cache where NUMBA_DISABLE_JIT is set.
    cache = getattr(compiled, '_cache', None)
    if cache is not None:
        file = CacheFile(cache._cache_file, function.__code__.co_filename, compiled)  # noqa: SLF001
        cache._cache_file = file  # noqa: SLF001
    return cast('Function', compiled)


def device_function(function: Function) -> Function:
    """Compile a kernel that only other kernels call.

    It has no entry for Python, which takes longer to compile than many a kernel. Called by Python
    it raises TypeError.
    """
    return _without_entry(function, kernel(function, no_cpython_wrapper=True))


def _without_entry(function: Function, compiled: Function) -> Function:
    """Refuse calls by Python."""

    def refuse(*_arguments: object) -> None:
        raise TypeError(f'{function.__name__} is a device function: only kernels can call it')

    if hasattr(compiled, 'py_func'):  # numba's, which would jump to an entry that is not there
        compiled._insert = lambda *_arguments: None  # type: ignore[attr-defined]  # noqa: SLF001
        compiled._compile_for_args = refuse  # type: ignore[attr-defined]  # noqa: SLF001
    return compiled


class _Apart(Compiler):
    """Compiles for arrays none of which overlaps another one."""

    def define_pipelines(self) -> Any:
        """Let the compiler trust that."""
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


def noalias_kernel(function: Function) -> Function:
    """Compile a device function that writes into no array that overlaps another of its arrays.

    Nothing checks that when it runs: checks take longer than loops over a few lanes. It counts
    no references to arrays, so it may neither make nor return one.
    """
    options: dict[str, Any] = {'_nrt': False, 'pipeline_class': _Apart}
    return _without_entry(function, kernel(function, no_cpython_wrapper=True, **options))


def inlined_kernel(function: Function) -> Function:
    """Put a kernel into those that call it, instead of compiling it by itself.

    Whatever a kernel calls is optimized again with it, and so on: each level between the one that
    Python calls and those that do the work costs as much as the first. It pays for kernels that do
    little but call others; of long ones numba makes copies slowly.
    """
    return kernel(function, inline='always')


@kernel
def select(values: NDArray[np.float64], count: int, rank: int) -> float:
    """Return the value of ``rank`` (from 0) among the first ``count``, none NaN; reorders them.

    Afterwards no value before ``rank`` is larger, and none behind it smaller. Quickselect; its
    partition has no branch on the values, which a processor could not predict. Periodic
    values give poor pivots: after ``MAX_PASSES`` passes these are drawn pseudo-randomly.
    """
    low, high = 0, count - 1
    left, drawn = MAX_PASSES * count, 1
    while high - low > SMALL:
        a, b, c = values[low], values[(low + high) // 2], values[high]
        left -= high - low
        if left < 0:
            # Those of the generator in POSIX.
            drawn = (drawn * 1103515245 + 12345) & 0x7FFFFFFF
            a = values[low + drawn % (high - low)]
            drawn = (drawn * 1103515245 + 12345) & 0x7FFFFFFF
            b = values[low + drawn % (high - low)]
        pivot = max(min(a, b), min(max(a, b), c))
        middle = low
        for i in range(low, high + 1):
            value = values[i]
            values[i] = values[middle]
            values[middle] = value
            middle += value < pivot
        if rank < middle:
            high = middle - 1
        elif middle > low:
            low = middle
        else:
            # The pivot is the smallest: take all its equals out, so that ties end the search.
            for i in range(low, high + 1):
                value = values[i]
                values[i] = values[middle]
                values[middle] = value
                middle += value <= pivot
            if rank < middle:
                return float(pivot)
            low = middle
    for i in range(low + 1, high + 1):
        value = values[i]
        j = i
        while j > low and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return float(values[rank])


@kernel
def median(values: NDArray[np.float64], count: int) -> float:
    """Return the median of the first ``count`` values, at least one; reorders them.

    An even count gives the mean of the two in the middle, as numpy's does.
    """
    half = count // 2
    upper = select(values, count, half)
    if count % 2 == 1:
        return upper
    lower = values[0]
    for i in range(1, half):
        lower = max(lower, values[i])
    return float((lower + upper) / 2)
