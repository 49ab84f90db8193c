# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Starts of the node with clouds at 10 Hz, the first one without `__pycache__`.

    python benchmarks/start.py [--chain CHAIN] [--then CHAIN] [--package FOLDER] [--write]
                               [NAME:=VALUE ...]

The node is a process of its own, over the real middleware, and is set to another chain. Printed are
seconds since that process began, or since the parameter was set, and what became of the clouds.
``--write`` puts the rows into the table in doc/results.
"""

# ruff: noqa: INP001, T201  a script, which prints

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

from helpers.live import environment  # noqa: E402
from helpers.watching import Watch  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402

from lidar_outlier_filter.parameters.yaml_files import NODE_NAME  # noqa: E402
from lidar_outlier_lab.results.markdown import write_row  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Mapping

PAGE = ROOT / 'doc' / 'results' / 'load.md'
AFTERWARDS = 3.0  # seconds of clouds behind what was waited for


def start(title: str, env: Mapping[str, str], arguments: list[str], other: str) -> list[str]:
    """Start the node, print when it did what, and change its chain; return the times (s)."""
    with Watch(env, arguments) as watch:
        subscribed = watch.serve(lambda: watch.sent > 0)
        diagnosed = watch.serve(lambda: bool(watch.samples))
        watch.serve(lambda: bool(watch.samples) and watch.samples[-1].filtered > 0)
        watch.serve(lambda: False, AFTERWARDS)
        filtered = min(watch.published)
        print(
            f'{title}: subscribed after {subscribed - watch.began:.2f} s, diagnostics '
            f'{diagnosed - watch.began:.2f} s, first cloud filtered {filtered - watch.began:.2f} s'
        )
        _switch(watch, other)
        found = watch.settle()
        print(
            f'  {watch.sent} clouds sent: {found.filtered} filtered, {found.bypassed} bypassed, '
            f'{found.count("dropped")} dropped, {found.count("refused")} refused'
        )
        watch.stop()
        print(watch.log())
    return [f'{at - watch.began:.2f}' for at in (subscribed, diagnosed, filtered)]


def _switch(watch: Watch, chain: str) -> None:
    """Set another chain while clouds come, and print when it took over."""
    client = AsyncParameterClient(watch.node, NODE_NAME)
    began = time.monotonic()
    reply = client.set_parameters([Parameter('chain', value=chain.split(','))])
    replied = watch.serve(reply.done)
    names = f'undecided by {chain}', f'rejected by {chain}'
    taken = watch.serve(lambda: any(name in watch.samples[-1].values for name in names))
    watch.serve(lambda: False, AFTERWARDS)
    times = [began, *(at for at in watch.published if at > began)]
    longest = max(after - before for before, after in itertools.pairwise(times))
    print(
        f'  set to {chain}: reply after {replied - began:.1f} s, in force by '
        f'{taken - began:.1f} s (to the second); longest time without output {longest:.2f} s'
    )


def main() -> None:
    """Read the command line, and measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('--chain', default='boosted_trees')
    parser.add_argument('--then', default='quadric', metavar='CHAIN')
    parser.add_argument(
        '--package', type=Path, default=ROOT, metavar='FOLDER', help='an unpacked wheel, or sources'
    )
    parser.add_argument('--write', action='store_true')
    parser.add_argument('settings', nargs='*', metavar='NAME:=VALUE')
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in ('lidar_outlier_filter', 'lidar_outlier_lab'):
            ignored = shutil.ignore_patterns('__pycache__')
            shutil.copytree(options.package / name, Path(folder, name), ignore=ignored)
        paths = [folder, *filter(None, [os.environ.get('PYTHONPATH')])]
        env = {**environment(), 'PYTHONPATH': os.pathsep.join(paths)}
        for title in ('first, without `__pycache__`', 'second', 'third'):
            arguments = [f'chain:=[{options.chain}]', *options.settings]
            times = start(title, env, arguments, options.then)
            if options.write:
                write_row(PAGE, 'starts', [title, *times], 'benchmarks/start.py --write')


if __name__ == '__main__':
    main()
