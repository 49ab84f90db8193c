# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The ring filter in C++ is the one of a plain loop; a peer that is another is not measured.

PCL is on few machines: whoever measures it compares its results first, by ``bench.same``.
"""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.results import bench, native_peers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_lab.results.native_peers import NativePeers


@pytest.fixture(scope='module')
def native() -> Iterator[NativePeers]:
    """Compile the ring filter alone; like a browser for the pages, its tests need a compiler."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native_peers, 'LIBRARIES', ('not_installed',))
        with native_peers.native_peers() as compiled:
            assert compiled is not None, 'no c++'
            assert not compiled.has_pcl
            yield compiled


def test_ring_filter_is_a_plain_loop(native: NativePeers) -> None:
    """Pieces of each ring are kept if they have five points or are 0.1 m long."""
    rng = np.random.default_rng(4)
    ring = rng.integers(0, 3, 900).astype(np.uint16)
    azimuth = np.sort(rng.uniform(-1.0, 1.0, 900)).astype(np.float32)
    distance = np.repeat(rng.choice([0.5, 2.0, 2.05, 9.0], 90), 10).astype(np.float32)
    plane = np.stack([np.cos(azimuth), -np.sin(azimuth), 0 * azimuth], axis=1)
    xyz = distance[:, None] * plane
    rejected = np.ones(900, np.bool_)
    for number in range(3):
        pieces: list[list[int]] = []
        for i in map(int, np.flatnonzero(ring == number)):
            j = pieces[-1][-1] if pieces else i
            near, far = sorted((distance[i], distance[j]))
            turned = azimuth[i] - azimuth[j] >= radians(1)
            if not pieces or turned or far >= near * np.float32(1.03):
                pieces.append([])
            pieces[-1].append(i)
        for piece in pieces:
            length = np.linalg.norm(xyz[piece[0]] - xyz[piece[-1]])
            rejected[piece] = len(piece) <= 4 and length < 0.1
    assert 100 < rejected.sum() < 800
    np.testing.assert_array_equal(native.rings(xyz, azimuth, distance, ring), rejected)


def test_all_are_measured_on_a_sweep(native: NativePeers) -> None:
    """Few points of a dry street are rejected; the copy is of 48 bytes a point."""
    (turn,) = bench.spinning_messages(16, 1024)[:1]
    ring_filter, copy = bench.vehicle_works(turn, native)
    rejected = np.asarray(ring_filter.call())
    assert ring_filter.points == copy.points == len(rejected)
    assert 0 < rejected.mean() < 0.3


def test_another_result_is_refused() -> None:
    """No table is written then."""
    with pytest.raises(FilterError, match=r'that DROR on PCL rejects must be .* got 1'):
        bench.same('DROR on PCL', np.array([True, False]), np.array([True, True]))


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """There are no such peers, and the page says so."""
    monkeypatch.setattr(native_peers, 'which', lambda _: None)
    with native_peers.native_peers() as compiled:
        assert compiled is None
    assert 'PCL: no C++ compiler' in bench._conditions(None)
