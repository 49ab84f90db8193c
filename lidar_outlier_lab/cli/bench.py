# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``bench``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.cli.arguments import Commands


def add_bench(commands: Commands) -> None:
    """Add the command ``bench``."""
    parser = commands.add_parser(
        'bench',
        help='measure the speed of this machine',
        description='Benchmark detectors, all filter steps of a cloud, and other installed '
        'programs, on the same points, with one core and with two.',
        epilog='examples:\n  lidar-outlier-filter bench\n'
        '  lidar-outlier-filter bench --write doc/results/speed.md',
    )
    parser.add_argument(
        '--write', type=Path, metavar='PAGE', help="put the tables between the page's markers"
    )
    parser.set_defaults(run=_bench)


def _bench(options: argparse.Namespace) -> int:
    from lidar_outlier_lab.results.bench import run

    return run(options.write)
