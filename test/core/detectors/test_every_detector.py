# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Properties of every spatial detector: order, threads, frame and unit of the points."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers.shapes import CLOUDS, corner, rotation, scattered
from numpy.testing import assert_allclose, assert_array_equal

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import elevation, hierarchical, lof, sor
from lidar_outlier_filter.core.detectors.builtin import Elevation, Hierarchical, Lof, Quadric, Sor
from lidar_outlier_filter.core.detectors.quadric import detector as quadric
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.errors import FilterError

Cloud = Callable[[np.random.Generator], Floats]

LISTS: dict[str, Lof | Sor] = {  # those that score by lists of neighbours
    'lof': Lof(min_pts=12),
    'lof2': Lof(min_pts=12, statistic='lof2'),
    'sor': Sor(k=12),
    'sor2': Sor(k=12, statistic='sor2', limit=0.5),
    'radius': Sor(min_neighbors=12, statistic='radius', radius=2.0),
    'range': Sor(k=12, range_scaled=True),
}
DETECTORS = (*LISTS, 'elevation', 'ground', 'hierarchical')
SURFACES = ('section', 'patch')


def detect(name: str, xyz: Floats, threads: int = 0, longer: int = 0) -> Floats:
    """Score a cloud by a detector, by neighbour lists that are longer than it needs."""
    if name == 'elevation':
        return elevation.detect(xyz, Elevation(), threads)
    if name == 'ground':
        return elevation.detect(xyz, Elevation(against='ground', cell=2.0), threads)
    if name == 'hierarchical':
        return hierarchical.detect(xyz, Hierarchical(0.99, 0.95, 5), threads).score
    if name not in LISTS:
        surfaces = Quadric(window=name)
        return quadric.detect(Neighbourhood(xyz, surfaces.list_length, threads), surfaces)
    parameters, neighbourhood = LISTS[name], Neighbourhood(xyz, 12 + longer, threads)
    if isinstance(parameters, Lof):
        return lof.detect(neighbourhood, parameters)
    return sor.detect(neighbourhood, parameters, np.linalg.norm(xyz, axis=1))


@pytest.mark.parametrize('name', DETECTORS)
@pytest.mark.parametrize('cloud', CLOUDS)
def test_order_does_not_matter(cloud: Cloud, name: str) -> None:
    """Scores belong to points, in whatever order these are given, which is not changed."""
    rng = np.random.default_rng(4)
    xyz = cloud(rng)
    given, order = xyz.copy(), rng.permutation(len(xyz))
    scores = detect(name, xyz)
    assert_array_equal(xyz, given)
    assert_allclose(detect(name, xyz[order]), scores[order], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize('name', SURFACES)
def test_order_does_not_matter_to_surfaces(name: str) -> None:
    """Nor to surfaces, where no neighbours of a patch tie."""
    test_order_does_not_matter(corner, name)


@pytest.mark.slow
def test_order_of_coincident_points_does_not_matter() -> None:
    """Each of them may be in the fit of a surface or not; they have one score all the same."""
    rng = np.random.default_rng(5)
    floor = np.column_stack([rng.uniform(-3, 3, (1500, 2)), rng.normal(0, 0.02, 1500)])
    floor[:200, 2] += rng.uniform(0, 3, 200)
    wall = np.column_stack([rng.uniform(-3, 3, 500), np.zeros(500), rng.uniform(0, 3, 500)])
    wall[:, 1] = 2 + rng.normal(0, 0.01, 500)
    xyz = np.concatenate([floor, wall, floor[:700]])
    order = rng.permutation(len(xyz))
    scores = detect('section', xyz)
    assert_array_equal(detect('section', xyz[order]), scores[order])
    assert_array_equal(scores[-700:], scores[:700])


@pytest.mark.parametrize('name', [*DETECTORS, *SURFACES])
def test_threads_do_not_matter(name: str) -> None:
    """The number of threads does not change a bit."""
    rng = np.random.default_rng(8)
    xyz = np.concatenate([rng.normal(size=(3000, 3)), rng.integers(0, 9, (2000, 3))])
    xyz[-200:] = xyz[0]
    expected = detect(name, xyz, threads=1)
    for threads in (2, 5):
        assert_array_equal(detect(name, xyz, threads), expected)


@pytest.mark.parametrize('name', ['lof', 'lof2', 'sor', 'sor2', 'radius', 'hierarchical'])
@pytest.mark.parametrize('cloud', [scattered, corner])  # others have ties, which rounding breaks
def test_rigid_motion(cloud: Cloud, name: str) -> None:
    """A cloud that is turned and moved has the same scores."""
    rng = np.random.default_rng(5)
    xyz = cloud(rng)
    moved = xyz @ rotation(rng).T + [1000.0, -200.0, 30.0]
    assert_allclose(detect(name, moved), detect(name, xyz), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize('wrong', [np.nan, np.inf, -1e160])
@pytest.mark.parametrize('name', ['elevation', 'hierarchical', 'ground', 'lof'])
def test_impossible_coordinates_are_refused(name: str, wrong: float) -> None:
    """Their squares are no numbers."""
    xyz = scattered(np.random.default_rng(6))
    xyz[17, 1] = wrong
    with pytest.raises(FilterError, match='coordinates must be finite and at most'):
        detect(name, xyz)


@pytest.mark.parametrize('name', LISTS)
@pytest.mark.parametrize('cloud', CLOUDS)
def test_longer_lists(cloud: Cloud, name: str) -> None:
    """Another detector of the chain may ask for more neighbours."""
    xyz = cloud(np.random.default_rng(9))
    assert_array_equal(detect(name, xyz, longer=30), detect(name, xyz))
