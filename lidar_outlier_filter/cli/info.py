# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``info``."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from lidar_outlier_filter.archive.locations import RECORDING_SUFFIXES, location_of, path_at, staged
from lidar_outlier_filter.cli.terminal import (
    DONE,
    INCOMPLETE,
    numbers,
    say_unread,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.errors import ParameterError, refused_for
from lidar_outlier_filter.files.judged_file import describe_file

if TYPE_CHECKING:
    from lidar_outlier_filter.recordings.info import CloudInfo, RecordingInfo, ScanGeometry


def run_info(options: argparse.Namespace) -> int:
    """Print what a recording or a file contains."""
    if not 0 <= options.sample < math.inf:
        raise ParameterError('--sample', 'at least 0 and finite', options.sample)
    path = path_at(options.path)
    if (
        isinstance(path, Path)
        and not path.is_dir()
        and path.suffix.lower() not in RECORDING_SUFFIXES
    ):
        _show_file(path)
        return DONE
    # Files need no rosbags.
    from lidar_outlier_filter.recordings.info import describe_recording  # noqa: PLC0415

    with staged(location_of(path)) as readable, stoppable_bar(path.name) as progress:
        info = describe_recording(readable, options.sample, progress)
    _show(info)
    say_unread(info.unread)
    return INCOMPLETE if info.unread else DONE


def _show(info: RecordingInfo) -> None:
    """Print what is known of a recording: a table of all topics, one for each of clouds."""
    begin = ''
    if info.messages:
        begin = f', from {datetime.fromtimestamp(info.start * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC'
    text = f'{info.path}: {info.duration:,.1f} s{begin}, {_counted(info.messages, "message")}'
    show(text, _topics(info), *(_clouds(topic.name, cloud) for topic, cloud in info.clouds.items()))
    if not info.clouds:
        show('No topic has clouds.')


def _topics(info: RecordingInfo) -> Table:
    table = numbers('topic', 'type', 'count', 'Hz', 'gaps', 'longest', 'jumps', texts=2)
    for topic, times in sorted(info.topics.items(), key=lambda item: item[0].name):
        table.add_row(
            topic.name,
            topic.msgtype,
            f'{times.count:,}',
            _number(times.rate),
            f'{times.gaps:,}',
            f'{times.longest * 1e-9:.3g} s',
            f'{times.jumps:,}',
        )
    return table


def _number(value: float, unit: str = '') -> str:
    """Write three digits that count; nothing of what is not known."""
    return '' if math.isnan(value) else f'{value:.3g}{unit}'


def _clouds(name: str, cloud: CloudInfo) -> Table:
    table = numbers(name, '', texts=2)
    for row in (*_form(cloud), *_lines(cloud.geometry), *_verdict(cloud)):
        table.add_row(*row)
    return table


def _form(cloud: CloudInfo) -> Iterator[tuple[str, str]]:
    height, width = cloud.shape
    yield 'frame', cloud.frame
    yield 'fields', ', '.join(cloud.fields)
    yield 'points', f'{height} × {width}, {cloud.step} bytes each'
    for text in cloud.found:
        yield 'judged' if text.startswith('judged') else 'read', text.removeprefix('judged ')
    rate = _number(cloud.stamps.rate, ' Hz') or 'no rate'
    yield 'header stamps', f'{rate}, {_counted(cloud.stamps.gaps, "gap")}'
    if cloud.stamps.jumps:
        yield '', f'{_counted(cloud.stamps.jumps, "jump")} back'
    yield '', f'{cloud.behind:+.3g} s from the first stamp to its bag time'


def _lines(found: ScanGeometry | None) -> Iterator[tuple[str, str]]:
    if found is None:
        yield 'scan lines', 'no point is valid in the sample'
        return
    kind = 'rings' if found.is_spinning else 'lines'
    per_line = f'{found.per_line:,.0f} points each'
    yield 'scan lines', f'{found.lines:,} {kind} in {found.seconds:.3g} s, {per_line}'
    if found.is_spinning:
        steps = 'even' if found.even else 'uneven'
        text = f'{found.low:.1f}° to {found.high:.1f}°'
        if not math.isnan(found.step):
            text += f', {steps} steps of {found.step:.2g}°'
        yield 'elevation', text
        yield 'azimuth', f'{found.azimuth:.3g}° between two points'
    yield 'range', f'98 % from {found.near:.3g} m to {found.far:.3g} m'
    yield 'no return', f'{100 * found.invalid:.3g} %'


def _verdict(cloud: CloudInfo) -> Iterator[tuple[str, str]]:
    """Say what the defaults make of the sample."""
    report = cloud.report
    if report is None or not report.messages:
        yield 'defaults', 'no cloud in the sample'
        return
    if report.refused:
        reasons = refused_for(report.refusals, report.sentences)
        yield 'refused', f'{report.refused} of {report.messages} clouds, for: {reasons}'
    if report.points:
        share = 100 * report.rejected / report.points
        untested = 100 * report.untested / report.points
        by = ', '.join(f'{name} {count:,}' for name, count in report.rejected_by.items())
        first = f'the first {_counted(report.messages, "cloud")}, {report.points:,} points'
        yield 'defaults reject', f'{share:.3g} % of {first} ({by}); {untested:.3g} % untested'
    if report.points and report.messages > 1:
        rate = (report.messages - 1) / cloud.seconds  # the first one starts the filter
        speed = f'{rate * report.points / report.messages / 1e6:.3g} million points/s'
        times = rate / cloud.stamps.rate
        yield 'speed here', ', '.join(filter(None, [speed, _number(times, ' × real time')]))


def _counted(number: int, name: str) -> str:
    return f'{number:,} {name}' if number == 1 else f'{number:,} {name}s'


def _show_file(path: Path) -> None:
    info = describe_file(path)
    table = numbers('column', 'type', 'least', 'largest', texts=2)
    for name, kind in info.columns.items():
        least, largest = info.extent.get(name, (math.nan, math.nan))
        table.add_row(name, kind, _plain(least), _plain(largest))
    show(f'{path}: {info.points:,} points, {path.stat().st_size:,} bytes', table)
    show(*(f'{name}: {value}' for name, value in info.about.items()))
    if info.rings:
        show(f'{info.rings} rings recovered from elevation')
    if info.method:
        show(f'judged by {info.method}')


def _plain(value: float) -> str:
    return '' if math.isnan(value) else f'{value:,.10g}'
