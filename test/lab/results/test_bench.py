# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark times what it says, on the cores that it says; its peers in C++ are those named."""

import os
import threading
from collections.abc import Iterator
from functools import partial
from itertools import islice
from math import radians
from pathlib import Path

import numpy as np
import pytest

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.results import bench, native_peers, peers
from lidar_outlier_lab.results.native_peers import NativePeers
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive
from lidar_outlier_lab.simulation.world.recording import clouds, to_message


def test_the_first_round_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """All works take turns; the median of the other rounds is the speed."""
    monkeypatch.setattr(bench, 'ROUNDS', 3)
    calls: list[str] = []
    works = [bench.Work(name, 100, partial(calls.append, name)) for name in 'ab']
    bench.measure(works)
    assert (''.join(calls), len(works[0].seconds)) == ('abababab', 3)
    works[0].seconds = [1.0, 2.0, 30.0]
    assert works[0].speed == 100 / 2 / 1e6


def test_works_work() -> None:
    """Each does its work on all its points."""
    xyz = np.random.default_rng(2).normal(size=(2000, 3))
    messages = [to_message(stamp, points) for stamp, points in islice(clouds(demo_drive()), 3)]
    works = [
        *(bench.spatial_work(xyz, name) for name in bench.SPATIAL),
        bench.stream_work(messages, bench.CHAINS[-1]),
    ]
    for work in works:
        work.call()
    in_stream = sum(msg.width for msg in messages)
    spatial = [2000] * len(bench.SPATIAL)
    assert [work.points for work in works] == [*spatial, in_stream]


def test_one_core_is_left() -> None:
    """To all threads, until it is over: what the whole process may use is as before then."""
    before, done = os.sched_getaffinity(0), threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    try:
        with bench.limited(1):
            found = [len(os.sched_getaffinity(n)) for n in (0, thread.native_id or 0)]
        assert found == [1, 1]
        assert os.sched_getaffinity(thread.native_id or 0) == os.sched_getaffinity(0) == before
    finally:
        done.set()
        thread.join()


def test_speeds_of_each_number_of_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each work is timed on one core and on two; the peer is compared with where there is one."""
    used: list[int] = []
    monkeypatch.setattr(bench, 'ROUNDS', 1)
    monkeypatch.setattr(bench, 'cores', lambda: 3)
    monkeypatch.setattr(bench, '_on', lambda count, _: used.append(count))
    works = [bench.Work(name, 1000, str) for name in ('ours', 'Open3D: SOR')]
    head, _, ours, peer = bench.speeds(works).splitlines()
    assert used == [1, 2] * 4
    assert head.startswith('|  | points | 1 core, million/s | 2 cores, million/s |')
    assert head.endswith('| × Open3D |')
    assert ours.startswith('| ours | 1,000 |')
    assert peer.startswith('| Open3D: SOR | 1,000 |')
    assert peer.endswith('| 1.00 |')


# Peers in C++: PCL is on few machines, whoever measures it compares its results by bench.same -----


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


def test_a_peer_that_cannot_be_loaded_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As Open3D is, where the system lacks libusb: said once, and left out."""
    (tmp_path / 'broken_peer.py').write_text("raise OSError('libusb-1.0.so.0: no such file')")
    monkeypatch.syspath_prepend(tmp_path)
    assert [peers.loads('broken_peer') for _ in range(2)] == [False, False]
    assert not peers.loads('no_such_peer')
    sentence = 'it is installed, but cannot be loaded ("libusb-1.0.so.0: no such file")'
    assert capsys.readouterr().err == f'broken_peer is left out: {sentence}\n'
