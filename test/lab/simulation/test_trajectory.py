# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Routes: stops, turns and bumps are where the knots put them."""

from __future__ import annotations

import numpy as np
import pytest

from lidar_outlier_lab.simulation.world.trajectory import Route, rotation


def test_straight_with_a_stop() -> None:
    """Speed changes evenly between knots; a vehicle that stands stays, and then goes on."""
    route = Route(((0.0, 8.0, 0.0), (2.0, 0.0, 0.0), (3.0, 0.0, 0.0), (4.0, 4.0, 0.0)), bump=0.0)
    x, y, z = route.position(np.array([0.0, 1.0, 2.0, 2.7, 3.0, 4.0, 6.0]))
    np.testing.assert_allclose(x, [0.0, 6.0, 8.0, 8.0, 8.0, 10.0, 18.0], atol=1e-4)
    np.testing.assert_allclose(y, -1.6)
    np.testing.assert_allclose(z, 0.0)


@pytest.mark.parametrize('after', [False, True], ids=['between knots', 'after the last'])
def test_turn(*, after: bool) -> None:
    """A steady turn is an arc, also after the last knot: after half a turn one comes back."""
    knots = ((0.0, 6.0, 0.5),) if after else ((0.0, 6.0, 0.5), (20.0, 6.0, 0.5))
    route = Route(knots, (1.0, 2.0, 0.0), bump=0.0, tremble=0.0)
    t = np.array([0.0, np.pi, 2.0 * np.pi, 4.0 * np.pi])
    x, y, _ = route.position(t)
    np.testing.assert_allclose(x, [1.0, 13.0, 1.0, 1.0], atol=1e-3)
    np.testing.assert_allclose(y, [2.0, 14.0, 26.0, 2.0], atol=1e-3)
    ahead = route.rotation(t)[:, 0]
    np.testing.assert_allclose(ahead, [[1, 0, -1, 1], [0, 1, 0, 0], [0, 0, 0, 0]], atol=1e-3)


def test_rotations_are_rotations() -> None:
    """Columns are orthonormal and right-handed; each angle turns the way it says."""
    rng = np.random.default_rng(1)
    turned = rotation(*rng.uniform(-0.4, 0.4, (3, 50)))
    product = np.einsum('jin,jkn->ikn', turned, turned)
    np.testing.assert_allclose(product, np.eye(3)[:, :, None] * np.ones(50), atol=1e-12)
    assert np.linalg.det(turned.transpose(2, 0, 1)) == pytest.approx(1.0)
    zero, some = np.zeros(1), np.full(1, 0.1)
    assert rotation(zero, some, zero)[2, 0, 0] == pytest.approx(-np.sin(0.1))  # nose down
    assert rotation(zero, zero, some)[1, 0, 0] == pytest.approx(np.sin(0.1))  # to the left
    assert rotation(some, zero, zero)[2, 1, 0] == pytest.approx(np.sin(0.1))  # left side up
