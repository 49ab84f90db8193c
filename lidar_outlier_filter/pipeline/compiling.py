# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels for a chain: run in this process, read from disk, or made by processes beside.

As a program it reads one share of the work from stdin, and compiles it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.kernels.compiling import SENSORS, NotCompiled, only_compiled
from lidar_outlier_filter.core.kernels.threads import cores
from lidar_outlier_filter.core.points.poses import Track
from lidar_outlier_filter.core.scan_pattern import recovered_rings
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.visibility import compile_watch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

SCORES = 'scores'  # which come with reasons, that have kernels of their own
PATIENT = 10  # niceness beside a filter that runs

_ready: set[tuple[object, ...]] = set()  # what chooses kernels, of chains ready in this process


@dataclass(frozen=True)
class KernelShare:
    """What one process compiles: a detector with its parameters, for some kinds of sensors."""

    detector: str
    values: tuple[tuple[str, object], ...]
    sensors: tuple[str, ...]

    @property
    def text(self) -> str:
        """Name it, for people."""
        return self.detector if self.sensors == SENSORS else f'{self.detector}, {self.sensors[0]}'


def is_ready(parameters: FilterParameters) -> bool:
    """Return whether this process has all kernels of a chain."""
    return _kind(parameters) in _ready


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
    Chain(parameters).compile(sensors, explain=explain)
    if tuple(sensors) == SENSORS:
        _ready.add(_kind(parameters))


def load(parameters: FilterParameters, *, explain: bool = False) -> bool:
    """Run the kernels of a chain once; return False where one would have to be compiled."""
    if is_ready(parameters) and not explain:
        return True
    try:
        with only_compiled():
            make_ready(parameters, explain=explain)
    except NotCompiled:
        return False
    return True


def shares(parameters: FilterParameters) -> list[KernelShare]:
    """Cut the work for a chain into parts that can be done side by side."""
    found = []
    flat, default = parameters.flat(), FilterParameters().flat()
    for name in parameters.chain:
        values = {
            key: value for key, value in flat.items() if key == SCORES or key.startswith(f'{name}.')
        }
        changed = {key: value for key, value in values.items() if value != default[key]}
        given = tuple(sorted(changed.items()))
        by_sensor = 'ring' in DETECTORS[name].columns(parameters)
        parts = [(sensor,) for sensor in SENSORS] if by_sensor else [SENSORS]
        found += [KernelShare(name, given, part) for part in parts]
    return found


class Processes:
    """Compiles shares in processes of their own, as many at once as there are cores."""

    def __init__(self, *, patient: bool = False, explain: bool = False) -> None:
        """Begin with none; patient ones leave the processor to others."""
        self._patient, self._explain = patient, explain
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def run(
        self,
        work: Sequence[KernelShare],
        progress: Callable[[int, int, str], object] = lambda _done, _total, _text: None,
    ) -> list[str]:
        """Compile all; return what went wrong, a sentence for each share that failed."""
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
        """End all, and begin no other."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()

    def _compile(self, share: KernelShare) -> str:
        paths = os.pathsep.join(path for path in sys.path if path)
        with self._lock:
            if self._stopped:
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
        work = [share.detector, share.values, share.sensors, self._explain]
        _, said = process.communicate(json.dumps(work))
        with self._lock:
            self._running.discard(process)
            if process.returncode == 0 or self._stopped:
                return ''
        last = said.strip().rpartition('\n')[2] or f'exit status {process.returncode}'
        return f'{share.text} could not be compiled beside: {last}'


def _kind(parameters: FilterParameters) -> tuple[object, ...]:
    """Return what chooses kernels: the detectors, and which of their variants."""
    chosen = [
        (name, value)
        for name, value in parameters.flat().items()
        if name.partition('.')[0] in parameters.chain and isinstance(value, str | bool)
    ]
    return (parameters.chain, parameters.vote > 0, parameters.scores, *chosen)


def _main() -> None:
    os.nice(int(sys.argv[1]))
    detector, values, sensors, explain = json.load(sys.stdin)
    parameters = FilterParameters().changed({**dict(values), 'chain': (detector,)})
    make_ready(parameters, sensors, explain=explain)


if __name__ == '__main__':
    _main()
