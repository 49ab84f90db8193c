# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``replay`` and ``mask``."""

import argparse
from pathlib import Path

from rich.table import Table

from lidar_outlier_filter.archive.locations import RECORDING_SUFFIXES, path_at
from lidar_outlier_filter.cli.archive import is_archive, replay_archive, replay_one
from lidar_outlier_filter.cli.arguments import check_accepted_share, check_workers
from lidar_outlier_filter.cli.tables import say_implausible
from lidar_outlier_filter.cli.terminal import (
    DONE,
    IMPLAUSIBLE,
    INCOMPLETE,
    REFUSED,
    can_draw,
    numbers,
    read_parameters,
    say,
    say_unread,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.core.points.mask import as_text
from lidar_outlier_filter.disk.new_files import check_new, new_files
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.own_vehicle import LearntMask, learn_mask
from lidar_outlier_filter.recordings.replay import ReplayReport

SHOWN_REASONS = 5  # of losses, that are said in full


def run_replay(options: argparse.Namespace) -> int:
    """Filter one recording, or all of a folder; return the exit status."""
    if options.largest_message < 1:
        raise RecordingError('--largest-message', 'at least 1 MB', options.largest_message)
    is_many = is_archive(options.recording)
    check_workers(options, is_archive=is_many)
    check_accepted_share(options)
    if is_many:
        return replay_archive(options)
    try:
        report = replay_one(options)
    except RecordingError as err:
        path = path_at(options.recording)
        if (
            not err.is_damage
            or options.salvage
            or not (path.is_dir() or path.suffix in RECORDING_SUFFIXES)
        ):
            raise
        say(f'{err}; --salvage filters what can be read of it')
        return REFUSED
    _show(report)
    topics = {topic.topic: vars(topic) for topic in report.topics}
    if say_implausible(path_at(options.recording).name, topics, options.accept_share):
        return IMPLAUSIBLE
    is_tested = not any(topic.untested_because for topic in report.topics)
    return DONE if report.is_complete and is_tested else INCOMPLETE


def _show(report: ReplayReport) -> None:
    """Print the table of a replay, and to stderr what is missing in its output."""
    show(_table(report), f'written to {report.output}')
    for topic in report.topics:
        if topic.refused:
            clouds = f'{topic.refused} of {topic.messages} clouds of {topic.topic}'
            say(f'{clouds} were refused and have no output, for: {topic.refused_because}')
        if topic.without_pose:
            clouds = f'{topic.without_pose} of {topic.messages} clouds of {topic.topic}'
            say(f'{clouds} have points without poses, which were judged in the frame of the sensor')
        if topic.untested_because:
            say(f'no point of {topic.topic} could be tested: {topic.untested_because}')
    if report.lost.reasons:
        counts = f'{report.lost.messages} messages and {report.lost.chunks} chunks'
        reasons = '; '.join(report.lost.said(SHOWN_REASONS))
        say(f'lost of the recording: at least {counts}: {reasons}')
    say_unread(report.unread)


def _table(report: ReplayReport) -> Table:
    """Make the table of a replay, a column for each topic."""
    table = numbers('topic', *(topic.topic for topic in report.topics))
    for column in table.columns[1:]:
        column.no_wrap, column.overflow = False, 'fold'
    names = ['messages', 'refused', 'points', 'rejected', 'untested', 'invalid']
    if any(topic.dropped for topic in report.topics):
        names.append('dropped')
    for name in names:
        table.add_row(name, *(f'{getattr(topic, name):,}' for topic in report.topics))
    for name in report.topics[0].rejected_by if report.topics else ():
        for text, counts in (
            ('rejected by', [topic.rejected_by for topic in report.topics]),
            ('undecided by', [topic.undecided_by for topic in report.topics]),
        ):
            if all(name in count for count in counts):
                table.add_row(f'{text} {name}', *(f'{count[name]:,}' for count in counts))
    speed = (topic.points / report.elapsed for topic in report.topics)
    table.add_row('points per second', *(f'{value:,.0f}' for value in speed))
    faster = f'{report.recorded / report.elapsed:.1f}'
    table.add_row('× real time', *(faster for _ in report.topics))
    return table


def run_mask(options: argparse.Namespace) -> int:
    """Learn the own vehicle from a drive."""
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
            from lidar_outlier_filter.report.figures import draw_mask  # noqa: PLC0415  an extra

            draw_mask(found.mask, built[1])
    _show_mask(options.output, found)
    return DONE


def _show_mask(output: Path, found: LearntMask) -> None:
    """Print what was learnt, and how to use it."""
    mask, seen = found.mask, found.mask.is_seen
    ranges = f', {mask.near.min():.2f} to {mask.far.max():.2f} m away' if seen.any() else ''
    by = f'by {found.odometry}' if found.odometry else 'by the scene'
    show(
        f'{found.topic}: {found.taken} of {found.turns} sweeps at new places ({by})',
        f'the vehicle is in {100 * seen.mean() if seen.size else 0.0:.1f} % of the directions'
        + ranges,
        f'written to {output}; use it with --set mask={output}',
    )
    if found.refused:
        say(f'{found.refused} of its clouds were refused, and not learnt from')
