# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``demo``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.cli.arguments import Commands


def add_demo(commands: Commands) -> None:
    """Add the command ``demo``."""
    parser = commands.add_parser(
        'demo',
        help='simulate a drive, filter it, and compare with the truth',
        description='Simulate recordings, filter them, and write the outputs, pictures and a page.',
        epilog='examples:\n  lidar-outlier-filter demo --output demo\n  lidar-outlier-filter demo',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('demo_output'),
        metavar='DIR',
        help='new folder, or that of an earlier demo; default: demo_output',
    )
    parser.set_defaults(run=_demo)


def _demo(options: argparse.Namespace) -> int:
    from lidar_outlier_lab.results.demo import run

    return run(options.output)
