# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``simulate``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import DONE
from lidar_outlier_filter.simulation.presets import PRESETS

if TYPE_CHECKING:
    import argparse

    from rich.table import Table

    from lidar_outlier_filter.simulation.recording import Cloud, Truth

    Commands = argparse._SubParsersAction[argparse.ArgumentParser]  # noqa: SLF001  it has no other name

STEPS = 1000  # of the bar


def add_simulate(commands: Commands) -> None:
    """Add the command ``simulate``."""
    width = max(map(len, PRESETS))
    listed = '\n'.join(f'  {name:{width}}  {preset.sentence}' for name, preset in PRESETS.items())
    parser = commands.add_parser(
        'simulate',
        help='make a recording whose outliers are known',
        description='Write a bag of simulated clouds. Their field "label" says outliers by their\n'
        'cause (0: none), their field "surface" what a good point lies on.\n\n'
        f'presets:\n{listed}',
        formatter_class=_raw(),
    )
    parser.add_argument('preset', metavar='PRESET', help='one of those above')
    parser.add_argument(
        '--output', type=Path, metavar='DIR', help='new folder; default: PRESET, here'
    )
    parser.add_argument(
        '--seed', type=int, default=1, metavar='N', help='of all chances, from 0; default: 1'
    )
    parser.add_argument(
        '--share',
        type=float,
        metavar='S',
        help="share of the points that are to be outliers, 0 to 1; default: the preset's own",
    )
    parser.set_defaults(run=_simulate)


def _raw() -> type[argparse.HelpFormatter]:
    """Keep the lines of a description."""
    from argparse import RawDescriptionHelpFormatter

    return RawDescriptionHelpFormatter


def _simulate(options: argparse.Namespace) -> int:
    from rich.console import Console

    from lidar_outlier_filter.cli.interrupts import stopping
    from lidar_outlier_filter.cli.terminal import progress_bar
    from lidar_outlier_filter.simulation.presets import make
    from lidar_outlier_filter.simulation.recording import write

    output = options.output or Path(options.preset)
    with stopping() as leave_if_asked, progress_bar(options.preset) as show:

        def progress(done: float) -> None:
            leave_if_asked()
            show(round(STEPS * done), STEPS)

        def written(_: Cloud) -> None:
            leave_if_asked()

        truth = write(make(options.preset, options.seed, options.share, progress), output, written)
    console = Console()
    console.print(_table(truth))
    console.print(f'written to {output}', markup=False, highlight=False, soft_wrap=True)
    return DONE


def _table(truth: Truth) -> Table:
    """Lay out what a recording holds."""
    from rich.table import Table

    table = Table('', 'points', '')
    for column in table.columns[1:]:
        column.justify = 'right'
    rows = {'all': truth.points, 'outliers': truth.outliers}
    bad = {cause: count for cause, count in truth.causes.items() if cause and count}
    rows |= {f'  {cause.name.lower().replace("_", " ")}': count for cause, count in bad.items()}
    for name, count in rows.items():
        share = count / truth.points if truth.points else 0.0
        table.add_row(name, f'{count:,}', f'{share:.3%}')
    return table
