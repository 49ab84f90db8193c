# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``simulate``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.arguments import add_parameter_options
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    beside,
    progress_bar,
    read_parameters,
    say,
    say_unread,
    show,
    stoppable_bar,
    stopping,
)
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.simulation.presets import PRESETS, RETURN_NAMES, WEATHER_NAMES

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from rich.table import Table

    from lidar_outlier_filter.cli.arguments import Commands
    from lidar_outlier_filter.evaluation.truth import Cause

STEPS = 1000  # of the bar


def add_simulate(commands: Commands) -> None:
    """Add the command ``simulate``."""
    from argparse import RawDescriptionHelpFormatter

    parser = commands.add_parser(
        'simulate',
        help='make a recording whose outliers are known',
        description='Write a bag of simulated clouds, or put weather into a recording of a sensor\n'
        'that spins (--onto). The field "label" has the cause of each outlier (0: good point). In\n'
        'presets, the field "surface" has the surface of each good point.\n\n'
        f'presets:\n{_listed({name: sentence for name, (_, sentence) in PRESETS.items()})}\n\n'
        f'weathers:\n{_listed(WEATHER_NAMES)}',
        formatter_class=RawDescriptionHelpFormatter,
        epilog='examples:\n  lidar-outlier-filter simulate street-16 --output drive --seed 2\n'
        '  lidar-outlier-filter simulate --onto drive --weather light_snow --output snowy',
    )
    parser.add_argument(
        'preset', nargs='?', metavar='PRESET', choices=PRESETS, help='one of those above'
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help='new folder; default: ./PRESET, or RECORDING_WEATHER beside input',
    )
    parser.add_argument(
        '--seed', type=int, default=1, metavar='N', help='random seed, from 0; default: 1'
    )
    parser.add_argument(
        '--share',
        type=float,
        metavar='S',
        help='share of outliers among the points, 0 to 1; default: that of the preset',
    )
    parser.add_argument(
        '--form',
        metavar='NAME',
        help='of mapping-a and mapping-b: one of the forms that drivers send clouds in, such as '
        'turns_10, packets, rows; an unknown one lists all; default: a topic for each head',
    )
    _add_onto(parser)
    parser.set_defaults(run=_simulate)


def _add_onto(parser: argparse.ArgumentParser) -> None:
    """Add the options for weather in a recording."""
    parser.add_argument(
        '--onto',
        type=Path,
        metavar='RECORDING',
        help='bag folder, .mcap, .db3 or ROS 1 .bag to put weather into, in place of PRESET',
    )
    parser.add_argument(
        '--weather', metavar='WEATHER', choices=WEATHER_NAMES, help='one of those above'
    )
    parser.add_argument(
        '--topic',
        action='append',
        default=[],
        dest='topics',
        metavar='T',
        help='put weather into this topic only; may be repeated; default: all PointCloud2 topics',
    )
    parser.add_argument(
        '--return',
        dest='returns',
        default='strongest',
        metavar='R',
        choices=RETURN_NAMES,
        help=f'which echo is measured: {", ".join(RETURN_NAMES)}; default: strongest',
    )
    add_parameter_options(parser)


def _listed(sentences: Mapping[str, str]) -> str:
    width = max(map(len, sentences))
    return '\n'.join(f'  {name:{width}}  {sentence}' for name, sentence in sentences.items())


def _simulate(options: argparse.Namespace) -> int:
    names = {'preset': 'PRESET', 'onto': '--onto', 'weather': '--weather'}
    given = [said for name, said in names.items() if getattr(options, name) is not None]
    if given not in (['PRESET'], ['--onto', '--weather']):
        got = ' and '.join(given) or 'neither'
        raise FilterError('the arguments', 'a PRESET, or --onto RECORDING --weather WEATHER', got)
    return _preset(options) if options.onto is None else _onto(options)


def _preset(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.recordings.bags import made_by
    from lidar_outlier_lab.simulation.presets import make
    from lidar_outlier_lab.simulation.world.recording import write

    output = options.output or Path(options.preset)
    with stopping() as leave_if_asked, progress_bar(options.preset) as advance:

        def progress(done: float) -> None:
            leave_if_asked()
            advance(round(STEPS * done), STEPS)

        made = make(options.preset, options.seed, options.share, progress, options.form)
        given = {name: getattr(options, name) for name in ('preset', 'seed', 'share', 'form')}
        how = made_by('simulate', **given)
        causes = write(made, output, lambda _: leave_if_asked(), how)
    show(_table(causes), f'written to {output}')
    return DONE


def _onto(options: argparse.Namespace) -> int:
    from lidar_outlier_lab.simulation.weather.clouds import put_onto
    from lidar_outlier_lab.simulation.world.recording import by_cause

    for name in ('share', 'form'):
        if (value := getattr(options, name)) is not None:
            raise FilterError(f'--{name}', 'given with a PRESET', value)
    output = options.output or beside(options.onto, f'_{options.weather}')
    with stoppable_bar(options.onto.name) as progress:
        counts = put_onto(
            options.onto,
            output,
            options.weather,
            options.topics,
            options.seed,
            options.returns,
            read_parameters(options.params, options.settings),
            progress=progress,
            inform=say,
        )
    hidden = f'surfaces that are hidden now: {counts.hidden:,}'
    show(_table(by_cause(counts.labels)), hidden, f'written to {output}')
    if counts.untouched:
        clouds = f'{counts.untouched} of {counts.messages} clouds'
        say(f'{clouds} have too few points to show how their sensor turns: no weather in these')
    say_unread(counts.unread)
    return INCOMPLETE if counts.unread else DONE


def _table(causes: Mapping[Cause, int]) -> Table:
    """Lay out what a recording holds."""
    from lidar_outlier_filter.evaluation.report import number_table

    table = number_table('', 'points', '')
    points = sum(causes.values())
    bad = {cause: count for cause, count in causes.items() if cause and count}
    rows = {'all': points, 'outliers': sum(bad.values())}
    rows |= {f'  {cause.name.lower().replace("_", " ")}': count for cause, count in bad.items()}
    for name, count in rows.items():
        share = count / points if points else 0.0
        table.add_row(name, f'{count:,}', f'{100 * share:.3f} %')
    return table
