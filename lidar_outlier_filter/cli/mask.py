# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``mask``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import (
    DONE,
    add_parameter_options,
    can_draw,
    read_parameters,
    say,
    stoppable_bar,
)

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.cli.terminal import Commands
    from lidar_outlier_filter.core.points.mask import Mask
    from lidar_outlier_filter.recordings.own_vehicle import LearntMask


def add_mask(commands: Commands) -> None:
    """Add the command ``mask``."""
    parser = commands.add_parser(
        'mask',
        help='learn from a drive where the sensor sees its own vehicle',
        description='Write a mask for the parameter mask: what stays at the same direction and '
        'range while the vehicle moves. Beside it, a picture. Exit status: 0 all done; 1 refused, '
        'as of a recording in which the vehicle stands still.',
        epilog='examples:\n  lidar-outlier-filter mask drive --output car.csv\n'
        '  lidar-outlier-filter mask drive --output car.csv --reach 15',
    )
    parser.add_argument('recording', type=Path, metavar='RECORDING', help='of a drive')
    parser.add_argument(
        '--output', type=Path, required=True, metavar='FILE', help='new mask, such as car.csv'
    )
    parser.add_argument('--topic', metavar='T', help='of the clouds; default: the only one')
    parser.add_argument(
        '--reach',
        type=float,
        default=10.0,
        metavar='METRES',
        help='from the sensor to the farthest point of the vehicle; default: 10',
    )
    add_parameter_options(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.core.points.mask import as_text
    from lidar_outlier_filter.disk.new_files import check_new, new_files
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.own_vehicle import learn_mask

    picture = options.output.with_name(f'{options.output.name}.png')
    draws = can_draw()
    for path in (options.output, picture):
        check_new(path)
    parameters = FilterParameters().changed(read_parameters(options.params, options.settings))
    with stoppable_bar('learning the mask') as progress:
        found = learn_mask(options.recording, parameters, options.topic, options.reach, progress)
    with new_files([options.output, picture][: 1 + draws]) as built:
        built[0].write_text(as_text(found.mask), 'ascii')
        if draws:
            from lidar_outlier_filter.report.figures import draw_mask

            draw_mask(found.mask, built[1])
    _show(options.output, found)
    return DONE


def _show(output: Path, found: LearntMask) -> None:
    """Print what was learnt, and how to use it."""
    from rich.console import Console

    seen = found.mask.is_seen
    by = f'by {found.odometry}' if found.odometry else 'by the scene'
    lines = [
        f'{found.topic}: {found.taken} of {found.looks} turns from elsewhere ({by})',
        f'the vehicle is in {seen.mean() if seen.size else 0.0:.1%} of the directions'
        + (_ranges(found.mask) if seen.any() else ''),
        f'written to {output}; use it with --set mask={output}',
    ]
    console = Console()
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if found.refused:
        say(f'{found.refused} of its clouds were refused, and not learnt from')


def _ranges(mask: Mask) -> str:
    return f', {mask.near.min():.2f} to {mask.far.max():.2f} m away'
