# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark times what it says, on the cores that it says."""

import os
import threading
from functools import partial
from itertools import islice

import numpy as np
import pytest

from lidar_outlier_lab.results import bench
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
