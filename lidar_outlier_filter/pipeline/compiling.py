# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels for a chain: run in this process, read from disk, or made by other processes.

As a program it reads one share of the work from stdin, and compiles it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import DETECTORS, explanations
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.kernels import listeners
from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.points.poses import Track
from lidar_outlier_filter.core.scan_pattern import recovered_rings
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.visibility import compile_watch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

SENSORS = ('profile', 'spinning')  # whose points are judged by different kernels
COUNT = 128  # points: enough for each detector of the defaults to judge them
RINGS = 4
SCORES = 'scores'  # which come with reasons, that have kernels of their own
PATIENT = 10  # niceness beside a filter that runs

_ready: set[tuple[object, ...]] = set()  # what chooses kernels, of chains ready in this process


class NotCompiled(Exception):  # noqa: N818  no error: a result
    """A kernel would have to be compiled."""


class KernelShare(NamedTuple):
    """What one process compiles: a detector, its parameters that are not defaults, and sensors."""

    detector: str
    values: dict[str, object]
    sensors: tuple[str, ...]

    @property
    def text(self) -> str:
        """Name it, for people."""
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
    parameters: FilterParameters, sensors: Sequence[str] = SENSORS, *, explain: bool = False
) -> None:
    """Run the kernels of a chain once; what is not on disk is compiled, and written there.

    ``explain`` includes the kernels by which reports explain scores.
    """
    Decoder(parameters).compile()
    compile_watch()
    Track.compile()
    recovered_rings.compile_kernels()
    chain = Chain(parameters)
    for points in (points for sensor in sensors for points in _samples(sensor)):
        chain.judge(points)
        for name in parameters.chain:
            if explain and name in explanations():
                seen = DetectorInput(points, parameters, chain.neighbours)
                explanations()[name].explain(seen, parameters, points.valid)
    if tuple(sensors) == SENSORS:
        _ready.add(kernels_of(parameters))


def load(parameters: FilterParameters, *, explain: bool = False) -> bool:
    """Run the kernels of a chain once; return False where one would have to be compiled."""
    if is_ready(parameters) and not explain:
        return True
    asking = threading.get_ident()

    def refuse(_module: str) -> None:
        if threading.get_ident() == asking:
            raise NotCompiled

    listeners.insert(0, refuse)  # nobody is called for what is not compiled
    try:
        make_ready(parameters, explain=explain)
    except NotCompiled:
        return False
    finally:
        listeners.remove(refuse)
    return True


def shares(parameters: FilterParameters) -> list[KernelShare]:
    """Cut the work for a chain into parts that can be done side by side."""
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
    """Compiles shares in processes of their own, as many at once as there are cores."""

    def __init__(self, *, patient: bool = False, explain: bool = False) -> None:
        """Start none yet; patient ones leave the processor to others."""
        self.is_stopped = False
        self._patient, self._explain = patient, explain
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
        """Kill all processes, and start no other."""
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
                start_new_session=True,  # the signals that end this one are not for them
            )
            self._running.add(process)
        _, said = process.communicate(json.dumps([*share, self._explain]))
        with self._lock:
            self._running.discard(process)
            if process.returncode == 0 or self.is_stopped:
                return ''
        last = said.strip().rpartition('\n')[2] or f'exit status {process.returncode}'
        return f'{share.text} could not be compiled: {last}'


def _samples(sensor: str) -> Iterator[Points]:
    """Yield small clouds of a sensor, in the layouts of memory that a stream gives."""
    t = np.arange(COUNT) * 1000
    if sensor == 'profile':
        xyz = np.zeros((COUNT, 3))
        xyz[:, 0] = np.arange(COUNT)
        xyz[COUNT // 2, 2] = 10.0
        # Two lines without a scan pattern: these are judged by their nearest neighbours.
        points = Points(xyz, t, np.arange(COUNT) // (COUNT // 2), np.ones(COUNT, np.bool_))
        for order in (np.arange(COUNT), np.arange(COUNT)[::-1]):
            yield points.take(order)
        # In whole turns, around a scanner that moves on: these have a scan pattern.
        yield replace(_turns(), t=t)
    else:
        bright = np.ones(COUNT, np.float32)
        yield replace(_turns(), t=np.tile(t[: COUNT // RINGS], RINGS), intensity=bright)


def _turns() -> Points:
    """Return lines of one turn each, one above the other, without times."""
    each = COUNT // RINGS
    turned, line = np.linspace(0.0, 6.0, each), np.repeat(np.arange(RINGS), each)
    level = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(each)])
    xyz = np.tile(level, (RINGS, 1))
    xyz[:, 2] = 0.1 * line
    return Points(xyz, np.zeros(COUNT, np.int64), line, np.ones(COUNT, np.bool_))


def _main() -> None:
    os.nice(int(sys.argv[1]))
    CacheFile.allows_portable = False
    detector, values, sensors, explain = json.load(sys.stdin)
    parameters = FilterParameters().changed({**values, 'chain': (detector,)})
    make_ready(parameters, sensors, explain=explain)


if __name__ == '__main__':
    _main()
