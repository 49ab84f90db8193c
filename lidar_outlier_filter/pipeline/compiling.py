# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of a chain: loaded from disk, or compiled in this process or in background processes.

Run as a program, it reads one share of the work from stdin and compiles it.
"""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import DETECTORS, explanations
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.core.kernels import listeners
from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.core.neighbours.floor import count_low
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.neighbours.tree_build import SUBTREE, build
from lidar_outlier_filter.core.points.mask import Mask, MaskLearner
from lidar_outlier_filter.core.points.points import Points, returns
from lidar_outlier_filter.core.points.poses import SensorExtrinsics, Track
from lidar_outlier_filter.core.points.scan_lines import LineCounter
from lidar_outlier_filter.core.scan_pattern.recovered_rings import (
    as_turn,
    find_elevations,
    find_origin,
)
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.visibility import SensorWatch

SENSORS = ('profile', 'spinning')  # kinds of sensors, each with its own kernels
COUNT = 128  # points of a sample: enough for every default detector
RINGS = 4
SCORES = 'scores'  # also turns on reasons, which have their own kernels
PATIENT = 10  # niceness of background processes beside a running filter

_ready: set[tuple[object, ...]] = set()  # `kernels_of` each chain loaded in this process


class NotCompiled(Exception):  # noqa: N818  no error: a result
    """A kernel would have to be compiled."""


class KernelShare(NamedTuple):
    """What one process compiles: a detector, its parameters that are not defaults, and sensors."""

    detector: str
    values: dict[str, object]
    sensors: tuple[str, ...]

    @property
    def text(self) -> str:
        """The name in messages."""
        return self.detector if self.sensors == SENSORS else f'{self.detector}, {self.sensors[0]}'


def kernels_of(parameters: FilterParameters) -> tuple[object, ...]:
    """Return the detectors and their variants, which determine the kernels."""
    chosen = [
        (name, value)
        for name, value in parameters.flat().items()
        if name.partition('.')[0] in parameters.chain and isinstance(value, str | bool)
    ]
    return (parameters.chain, parameters.vote > 0, parameters.scores, *chosen)


def is_ready(parameters: FilterParameters) -> bool:
    """Return whether this process has all kernels of a chain."""
    return kernels_of(parameters) in _ready


def make_ready(
    parameters: FilterParameters, sensors: Sequence[str] = SENSORS, *, offline: bool = False
) -> None:
    """Run the kernels of a chain once; what is not on disk is compiled, and written there.

    ``offline`` includes kernels that no start of a node waits for: those of large clouds, of files,
    of masks, and of the explanations in reports.
    """
    _run_shared(_turns())
    if offline:
        build(np.zeros((SUBTREE + 1, 3)))
        count_low(_turns().xyz, np.arange(COUNT))
        MaskLearner(1.0).add(_turns())
    chain = Chain(parameters)
    for points in (points for sensor in sensors for points in _samples(sensor)):
        chain.judge(points)
        for name in parameters.chain:
            if offline and name in explanations():
                seen = DetectorInput(points, parameters, chain.neighbours)
                explanations()[name].contributions(seen, parameters, points.valid)
    if 'profile' in sensors and any(DETECTORS[name].lines != 'needs' for name in parameters.chain):
        hood = Neighbourhood(np.append(_turns().xyz, _turns().xyz[:1], axis=0), 1)
        hood.nearest(1)
        hood.distinct()  # with a copy; only in the share that searches neighbours anyway
    if tuple(sensors) == SENSORS:
        _ready.add(kernels_of(parameters))


def _run_shared(points: Points) -> None:
    """Run the kernels that every chain may need: of decoding, poses, views, and recovered rings."""
    returns(points.xyz)
    Mask.nothing(0).covers(points, 0.0)
    LineCounter().by_angle(points.range, points.valid)
    track = Track(1.0, 1.0)
    track.add(0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    track.move(points, SensorExtrinsics(np.zeros(3), np.eye(3)))
    SensorWatch().add(StreamCloud(points), has_rings=True)
    beams = find_origin(points.range, points.range)
    find_elevations(points.range, points.range, beams)
    as_turn(replace(points, ring=points.line))


def load(parameters: FilterParameters, *, offline: bool = False) -> bool:
    """Run the kernels of a chain once; return False where one would have to be compiled."""
    if is_ready(parameters) and not offline:
        return True
    asking = threading.get_ident()

    def refuse(_module: str) -> None:
        if threading.get_ident() == asking:
            raise NotCompiled

    listeners.insert(0, refuse)  # before other listeners, which are then not called
    try:
        make_ready(parameters, offline=offline)
    except NotCompiled:
        return False
    finally:
        listeners.remove(refuse)
    return True


def shares(parameters: FilterParameters) -> list[KernelShare]:
    """Split the kernels of a chain into shares for parallel processes."""
    default, found = FilterParameters().flat(), []
    changed = {name: value for name, value in parameters.flat().items() if value != default[name]}
    for detector in parameters.chain:
        given = {
            name: value
            for name, value in changed.items()
            if name == SCORES or name.startswith(f'{detector}.')
        }
        by_sensor = 'ring' in DETECTORS[detector].columns(parameters)
        parts = [(sensor,) for sensor in SENSORS] if by_sensor else [SENSORS]
        found += [KernelShare(detector, given, part) for part in parts]
    return found


class Processes:
    """Compiles shares in separate processes, one per core at a time."""

    def __init__(self, *, patient: bool = False, offline: bool = False) -> None:
        """``patient`` processes run at low priority; ``offline`` as in :func:`make_ready`."""
        self.is_stopped = False
        self._patient, self._offline = patient, offline
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()

    def run(
        self,
        work: Sequence[KernelShare],
        progress: Callable[[int, int, str], object] = lambda _done, _total, _text: None,
    ) -> list[str]:
        """Compile all shares; return a sentence for each one that failed."""
        done = 0

        def one(share: KernelShare) -> str:
            nonlocal done
            error = self._compile(share)
            with self._lock:
                done += 1
                progress(done, len(work), share.text)
            return error

        with ThreadPoolExecutor(cores()) as pool:
            return [error for error in pool.map(one, work) if error]

    def stop(self) -> None:
        """Kill all processes, and start no more."""
        with self._lock:
            self.is_stopped = True
            for process in self._running:
                process.kill()

    def _compile(self, share: KernelShare) -> str:
        paths = os.pathsep.join(path for path in sys.path if path)
        with self._lock:
            if self.is_stopped:
                return ''
            process = subprocess.Popen(  # noqa: S603  this very module
                [sys.executable, '-P', '-m', __name__, str(PATIENT * self._patient)],
                env={**os.environ, 'PYTHONPATH': paths},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,  # does not receive this process's signals
            )
            self._running.add(process)
        _, said = process.communicate(json.dumps([*share, self._offline]))
        with self._lock:
            self._running.discard(process)
            if process.returncode == 0 or self.is_stopped:
                return ''
        last = said.strip().rpartition('\n')[2] or f'exit status {process.returncode}'
        return f'{share.text} could not be compiled: {last}'


def _samples(sensor: str) -> Iterator[Points]:
    """Yield small clouds of a sensor, with the memory layouts of a stream."""
    t = np.arange(COUNT) * 1000
    if sensor == 'profile':
        xyz = np.zeros((COUNT, 3))
        xyz[:, 0] = np.arange(COUNT)
        xyz[COUNT // 2, 2] = 10.0
        # Two lines without a scan pattern, for the methods on nearest neighbours
        points = Points(xyz, t, np.arange(COUNT) // (COUNT // 2), np.ones(COUNT, np.bool_))
        for order in (np.arange(COUNT), np.arange(COUNT)[::-1]):
            yield points.take(order)
        # Whole revolutions of a moving scanner, for the methods on scan patterns
        yield replace(_turns(), t=t)
    else:
        bright = np.arange(1, COUNT + 1, dtype=np.float32)  # of equal ones nothing is known
        yield replace(_turns(), t=np.tile(t[: COUNT // RINGS], RINGS), intensity=bright)


def _turns() -> Points:
    """Return stacked scan lines of one revolution each, without times."""
    each = COUNT // RINGS
    azimuth, line = np.linspace(0.0, 6.0, each), np.repeat(np.arange(RINGS), each)
    level = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(each)])
    xyz = np.tile(level, (RINGS, 1))
    xyz[:, 2] = 0.1 * line
    return Points(xyz, np.zeros(COUNT, np.int64), line, np.ones(COUNT, np.bool_))


def _main() -> None:
    os.nice(int(sys.argv[1]))
    CacheFile.allows_portable = False
    detector, values, sensors, offline = json.load(sys.stdin)
    parameters = FilterParameters().changed({**values, 'chain': (detector,)})
    make_ready(parameters, sensors, offline=offline)


if __name__ == '__main__':
    _main()
