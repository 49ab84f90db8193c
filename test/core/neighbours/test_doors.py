# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""No call from Python takes the kernels of trees, floors and neighbours beyond an array."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lidar_outlier_filter.core import _kernels
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.tree_build import Tree

N, K = 300, 5
XYZ = np.random.default_rng(0).normal(size=(N, 3))
HOOD = Neighbourhood(XYZ, K)
TREE, INDEX = HOOD.tree, HOOD.nearest(K).index
LEAVES = _kernels.subtrees(TREE, 0)
Call = Callable[..., object]


def search(**changed: Any) -> None:
    """Search all leaves, but for what is changed."""
    given: dict[str, Any] = {
        'xyz': HOOD.xyz,
        'tree': TREE,
        'these': LEAVES,
        'order': HOOD.order,
        'row': np.arange(N, dtype=np.int32),
        'index': np.empty((N, K), np.int32),
        'tied': np.empty(N, np.bool_),
    }
    _kernels.search_nearest(*(given | changed).values())


def bad(row: int, value: int) -> Any:
    """Return lists one of which holds a wrong number."""
    index = INDEX.copy()
    index[row, -1] = value
    return index


def changed_tree(name: str, node: int, value: int) -> Tree:
    """Return the tree with another number, as one that Python made."""
    numbers = getattr(TREE, name).copy()
    numbers[node] = value
    return TREE._replace(**{name: numbers})


@pytest.mark.parametrize(
    'changed',
    [
        {'row': np.arange(1, N + 1, dtype=np.int32)},
        {'these': LEAVES + len(TREE.child)},
        {'these': LEAVES - len(TREE.child)},
        {'index': np.empty((N, 0), np.int32)},
        {'index': np.empty((N, N), np.int32)},
        {'tree': changed_tree('child', 0, 0)},
        {'tree': changed_tree('child', 0, len(TREE.child) - 1)},
        {'tree': changed_tree('child', int(LEAVES[-1]), 1)},
        {'tree': changed_tree('last', int(LEAVES[-1]), N + 1)},
        {'tree': changed_tree('first', int(LEAVES[0]), -1)},
        {'tree': Tree(*(np.empty((0, *part.shape[1:]), part.dtype) for part in TREE))},
    ],
)
def test_a_search_of_what_does_not_fit_is_refused(changed: dict[str, Any]) -> None:
    """Lists that are too short, rows and leaves that there are not, and trees that are none."""
    with pytest.raises(ValueError, match=r'must|with k at least'):
        search(**changed)


def test_coordinates_that_are_no_numbers_do_not_end_the_process() -> None:
    """Neighbourhoods refuse them; the kernels find something."""
    xyz = HOOD.xyz.copy()
    xyz[::3] = np.nan
    xyz[1::5] = np.inf
    search(xyz=xyz)
    search(xyz=np.full((N, 3), np.nan))
    index = np.arange(N, dtype=np.int32)
    _kernels.grow_tree((xyz, xyz.copy(), index, index.copy()), 0, N, False, 0)  # noqa: FBT003


def test_nobody_writes_into_a_tree_that_was_checked() -> None:
    """Searches do not check it again."""
    for part in TREE:
        with pytest.raises(ValueError, match='read-only'):
            part[0] = 0
        with pytest.raises(ValueError, match='cannot set WRITEABLE'):
            part.flags.writeable = True


def _floor(column: Any, lowest: Floats, count: int = 1) -> None:
    wide = np.zeros(1, np.int64)
    _kernels.write_floor(wide, column, lowest, 0, count, np.empty((1, 2)))


NEAR = (INDEX, np.full(N, -1, np.int32), np.zeros(1, np.int64), np.empty(0, np.int32))
ROW_0 = np.zeros(N, np.int32)
INTS, TWO = np.arange(N), np.array([0, 2])
RESULT, FLAGS = np.empty(N), np.empty(N, np.bool_)
TWICE = np.arange(2 * N, dtype=np.int32)


@pytest.mark.parametrize(
    'call',
    [
        lambda: _kernels.squared_distances(HOOD.xyz, INDEX, K, 0, N + 1, RESULT),
        lambda: _kernels.squared_distances(HOOD.xyz, INDEX, 0, 0, N, RESULT),
        lambda: _kernels.squared_distances(HOOD.xyz, bad(N - 1, -1), K, 0, N, RESULT),
        lambda: _kernels.carry_over(
            INDEX, FLAGS, TWICE[1 : N + 1], 0, N, INDEX.copy(), FLAGS, ROW_0.copy()
        ),
        lambda: _kernels.carry_over(
            bad(0, N), FLAGS, TWICE[:N], 0, N, INDEX.copy(), FLAGS, ROW_0.copy()
        ),
        lambda: _kernels.list_within(HOOD.xyz, TREE, np.array([N]), np.ones(1)),
        lambda: _kernels.list_within(HOOD.xyz, TREE, np.array([1]), np.ones(2)),
        lambda: _kernels.find_copies(HOOD.order, HOOD.xyz, TREE, np.array([-1])),
        lambda: _kernels.prune_tree(TREE, TREE.first, TREE.last + 1, HOOD.xyz),
        lambda: _kernels.halve_node((XYZ, XYZ[:-1], ROW_0, ROW_0), 0, N, False, 0),  # noqa: FBT003
        lambda: _kernels.grow_tree((XYZ, XYZ, ROW_0, ROW_0), 0, N + 1, False, 0),  # noqa: FBT003
        lambda: _kernels.subtrees(TREE._replace(child=TREE.child + len(TREE.child)), 16),
        lambda: _kernels.average_distances(HOOD.xyz, bad(1, N), 0, N, RESULT),
        lambda: _kernels.average_distances(HOOD.xyz, INDEX, -1, N, RESULT),
        lambda: _kernels.write_densities(NEAR, HOOD.xyz, RESULT[1:], 0, N, RESULT),
        lambda: _kernels.write_densities((INDEX, ROW_0, *NEAR[2:]), XYZ, RESULT, 0, N, RESULT),
        lambda: _kernels.write_density_ratios((bad(2, -7), *NEAR[1:]), RESULT, 0, N, RESULT),
        lambda: _kernels.sort_rows_as_given(TWO, INTS, INTS, 0, 1, TWICE[N - 1 : N + 1].copy()),
        lambda: _kernels.sort_rows_as_given(TWO, INTS, INTS, 0, 2, TWICE[:2].copy()),
        lambda: _kernels.elevation_differences(XYZ[:, 2].copy(), bad(0, N), 0, N, RESULT),
        lambda: _kernels.gabriel_edges(HOOD.xyz, TREE, 0, N + 1),
        lambda: _kernels.column_runs(XYZ, np.zeros(1), 1.0),
        lambda: _floor(np.zeros(2, np.int64), np.zeros(1)),
        lambda: _floor(np.full(1, 1 << 40), np.zeros(1)),
        lambda: _floor(np.zeros(300, np.int64), np.zeros(300)),
        lambda: _floor(np.zeros(1, np.int64), np.zeros(1), 2),
    ],
)
def test_what_does_not_fit_is_refused(call: Call) -> None:
    """Neighbours that are no points, ranges beyond the end, arrays that are too short."""
    with pytest.raises(ValueError, match='must'):
        call()
