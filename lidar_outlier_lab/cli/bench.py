# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``bench``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.cli.terminal import Commands


def add_bench(commands: Commands) -> None:
    """Add the command ``bench``."""
    parser = commands.add_parser(
        'bench',
        help='measure the speed of this machine',
        description='Compare the answers, then time the smoother, the whole way of a cloud, and a '
        "peer's statistical outlier removal on the same points: Open3D's where it is installed.",
    )
    parser.set_defaults(run=_bench)


def _bench(_options: argparse.Namespace) -> int:
    from rich.console import Console

    from lidar_outlier_lab.results.bench import run

    return run(Console())
