# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Starts from an empty and from a full cache, and a change of the chain, with clouds at 10 Hz.

    python benchmarks/start.py [CHAIN [OTHER_CHAIN [NAME:=VALUE ...]]]

The node is a process of its own, over the real middleware. Printed are the seconds since that
process began, or since the parameter was set, and what became of the clouds.
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

from helpers.live import environment  # noqa: E402
from helpers.watching import Watch, fresh_copy  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402

from lidar_outlier_filter.parameters.yaml_files import NODE_NAME  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Mapping

AFTERWARDS = 3.0  # seconds of clouds behind what was waited for


def start(title: str, env: Mapping[str, str], arguments: list[str], other: str = '') -> None:
    """Start the node, print when it did what, and change its chain."""
    with Watch(env, arguments) as watch:
        subscribed = watch.serve(lambda: watch.sent > 0)
        diagnosed = watch.serve(lambda: bool(watch.looks))
        filtered = watch.serve(lambda: bool(watch.looks) and watch.looks[-1].filtered > 0)
        watch.serve(lambda: False, AFTERWARDS)
        print(  # noqa: T201
            f'{title}: subscribed after {subscribed - watch.began:.1f} s, diagnostics '
            f'{diagnosed - watch.began:.1f} s, first answer '
            f'{min(watch.answers, default=0) - watch.began:.1f} s, filtered by '
            f'{filtered - watch.began:.1f} s (to the second)'
        )
        if other:
            _switch(watch, other)
        found = watch.settle()
        print(  # noqa: T201
            f'  {watch.sent} clouds sent: {found.filtered} filtered, {found.passed} passed, '
            f'{found.count("dropped")} dropped, {found.count("refused")} refused'
        )
        said = ''
        for look in watch.looks:
            if look.message != said:
                said = look.message
                print(f'  {look.at - watch.began:6.1f} s: {look.level} {said}')  # noqa: T201
        watch.stop()
        print(watch.log())  # noqa: T201


def _switch(watch: Watch, chain: str) -> None:
    """Set another chain while clouds come, and print when it took over."""
    client = AsyncParameterClient(watch.node, NODE_NAME)
    began = time.monotonic()
    reply = client.set_parameters([Parameter('chain', value=chain.split(','))])
    watch.serve(reply.done)
    replied = time.monotonic()
    name = f'undecided by {chain}', f'rejected by {chain}'
    taken = watch.serve(lambda: any(key in watch.looks[-1].values for key in name))
    watch.serve(lambda: False, AFTERWARDS)
    times = [began, *(at for at in watch.answers if at > began)]
    longest = max(after - before for before, after in itertools.pairwise(times))
    print(  # noqa: T201
        f'  set to {chain}: reply after {replied - began:.1f} s '
        f'({reply.result().results[0].reason!r}), in force by {taken - began:.1f} s (to the '
        f'second); longest time without an answer {longest:.2f} s'
    )


def main() -> None:
    """Measure."""
    chain, other = (*sys.argv[1:3], *('boosted_trees', 'quadric')[len(sys.argv[1:3]) :])
    settings = [f'chain:=[{chain}]', *sys.argv[3:]]
    with tempfile.TemporaryDirectory() as folder:
        env = {**environment(), **fresh_copy(Path(folder))}
        start('empty cache', env, settings, other)
        start('full cache', env, settings, other)


if __name__ == '__main__':
    main()
