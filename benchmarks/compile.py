# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Processor seconds that compiling takes, and that loading does, for each chain and each kernel.

    python benchmarks/compile.py [CHAIN[:SENSOR] ...]

Each chain is compiled in a process of its own, from a copy of the package without what is
compiled; then once more, from what is on disk by then. The time of a kernel is without that of
others which it calls; below stand the sums of packages, for what detectors declare. Without a chain
it is each detector alone. A sensor, ``spinning`` or ``profile``, leaves out what others need.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

MOST = 12  # kernels of a chain that are listed
DEPTH = 4  # names of a package, as in core.detectors.boosted_trees.pattern


def compile_one(chain: str) -> None:
    """Compile a chain, and print what took how long; in a process of its own."""
    chain, _, sensor = chain.partition(':')
    from numba.core.event import Event, Listener, register  # noqa: PLC0415

    from lidar_outlier_filter.core.kernels.compiling import SENSORS  # noqa: PLC0415
    from lidar_outlier_filter.parameters.filter import FilterParameters  # noqa: PLC0415
    from lidar_outlier_filter.pipeline.compiling import make_ready  # noqa: PLC0415

    took: Counter[str] = Counter()
    count: Counter[str] = Counter()

    class Stopwatch(Listener):
        """Takes the time of each kernel, without those inside."""

        def __init__(self) -> None:
            self._open: list[list[float]] = []

        def on_start(self, _event: Event) -> None:
            self._open.append([time.process_time(), 0.0])

        def on_end(self, event: Event) -> None:
            began, inside = self._open.pop()
            seconds = time.process_time() - began
            if self._open:
                self._open[-1][1] += seconds
            function = event.data['dispatcher'].py_func
            name = f'{function.__module__}.{function.__name__}'
            took[name.removeprefix('lidar_outlier_filter.')] += seconds - inside
            count[name.removeprefix('lidar_outlier_filter.')] += 1

    parameters = FilterParameters().changed({'chain': chain.split(',')})
    register('numba:compile', Stopwatch())
    began = time.process_time()
    make_ready(parameters, (sensor,) if sensor else SENSORS)
    total = time.process_time() - began
    print(f'{chain}: {total:.1f} s, {count.total()} compilations')  # noqa: T201
    for name, seconds in took.most_common(MOST):
        print(f'  {seconds:5.2f} s  {count[name]} × {name}')  # noqa: T201
    of_package: Counter[str] = Counter()
    for name, seconds in took.items():
        part = '.'.join(name.split('.')[:DEPTH])
        of_package[part if part.startswith('core.detectors.') else 'all else'] += seconds
    for name, seconds in of_package.most_common():
        print(f'  {seconds:5.2f} s  in {name}')  # noqa: T201


def main() -> None:
    """Compile each chain from an empty and from a full cache."""
    from helpers.watching import fresh_copy  # noqa: PLC0415

    from lidar_outlier_filter.core.detectors.registry import DETECTORS  # noqa: PLC0415

    for chain in sys.argv[1:] or DETECTORS:
        with tempfile.TemporaryDirectory() as folder:
            env = {**os.environ, **fresh_copy(Path(folder)), 'COMPILE': chain}
            for _ in ('empty', 'full'):
                subprocess.run([sys.executable, '-P', __file__], env=env, check=True)  # noqa: S603


if __name__ == '__main__':
    if 'COMPILE' in os.environ:
        del sys.path[:2]  # the copy
        compile_one(os.environ['COMPILE'])
    else:
        main()
