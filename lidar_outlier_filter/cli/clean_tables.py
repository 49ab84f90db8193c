# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What ``clean`` prints at its end: sentences, and tables by file, class, cause and group."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from lidar_outlier_filter.archive.manifest import DONE
from lidar_outlier_filter.archive.many_files import LEFT
from lidar_outlier_filter.cli.terminal import say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from rich.table import Table

    from lidar_outlier_filter.archive.many_files import Result
    from lidar_outlier_filter.files.cleaning.clean_log import CleanReport
    from lidar_outlier_filter.report.worst import Worst

# Of ASPRS (LAS 1.4, table 17).
CLASSES = {
    0: 'never classified',
    1: 'unclassified',
    2: 'ground',
    3: 'low vegetation',
    4: 'medium vegetation',
    5: 'high vegetation',
    6: 'building',
    7: 'low point (noise)',
    8: 'key point',
    9: 'water',
    10: 'rail',
    11: 'road surface',
    13: 'wire guard',
    14: 'wire conductor',
    15: 'transmission tower',
    16: 'wire connector',
    17: 'bridge deck',
    18: 'high noise',
}
MUCH = 0.005  # share of the points that rarely are outliers
MOST_GROUPS = 10  # that are listed
RARE = ('invalid', 'ignored', 'untested', 'spared')  # columns that are left out where all are 0


def is_untested(report: CleanReport) -> bool:
    """Return whether no point could be tested."""
    return report.points == report.untested + report.invalid + report.ignored


def say_how(result: Result) -> None:
    """Say why a file has no report, or in which way it is not judged as it is."""
    path, report = result.job.path, result.report
    if report is None:
        say(f'{path} {result.error}' if result.state == LEFT else result.error)
        return
    if report.metres:
        sizes = ', '.join(f'{name} = {size:.10g} m' for name, size in report.metres.items())
        say(f'{path} is not in metres ({sizes}): it is judged in metres')
    if report.coarse:
        say(f'{path}: {report.coarse}')
    if report.rings:
        has = f' has {report.lack}' if report.lack else ''
        say(f'{path}{has}: {report.rings} rings are recovered from elevation')
    elif report.lack:
        say(f'{path} has {report.lack}: it is judged without scan lines')
    if is_untested(report):
        say(f'{path}: {" and ".join(report.chain)} could test none of its points')
    if report.rejected > MUCH * report.points:
        say(f'{path}: {report.rejected / report.points:.1%} of its points are rejected')


def show(results: Sequence[Result], worst: Mapping[Path, Worst]) -> None:
    """Print the tables, and what was written."""
    from rich.console import Console

    console = Console()
    reports = [result.report for result in results if result.report is not None]
    if reports or len(results) > 1:
        console.print(_table(results))
    if any(report.by_class for report in reports):
        console.print(_table_of_classes(reports))
    if any(report.rejected for report in reports):
        console.print(_table_of_causes(reports, worst))
    if any(one.groups for one in worst.values()):
        console.print(_table_of_groups(worst))
    for report in reports:
        for written in report.outputs:
            console.print(f'written to {written}', markup=False, highlight=False, soft_wrap=True)
    if len(results) > 1:
        states = Counter(result.state for result in results)
        left = len(results) - states[DONE] - states[LEFT]
        console.print(
            f'{states[DONE]} cleaned, {states[LEFT]} {LEFT}, {left} refused', highlight=False
        )


def _table(results: Sequence[Result]) -> Table:
    """Make the table of the files, a row for each."""
    from rich.table import Table

    reports = [result.report for result in results if result.report is not None]
    chain = dict.fromkeys(name for report in reports for name in report.chain)
    rare = [name for name in RARE if any(getattr(report, name) for report in reports)]
    detectors = [] if len(chain) == 1 else [f'by {name}' for name in chain]
    names = ['points', *rare, 'rejected', 'share', *detectors, 'seconds']
    table = Table('file', *names, 'state')
    table.columns[0].overflow = 'fold'
    for column in table.columns[1:-1]:
        column.justify, column.no_wrap = 'right', True
    for result in results:
        report = result.report
        if report is None:
            state = LEFT if result.state == LEFT else 'refused'
            table.add_row(result.job.path.name, *[''] * len(names), state)
            continue
        by = (report.rejected_by.get(name) for name in chain) if detectors else ()
        table.add_row(
            result.job.path.name,
            f'{report.points:,}',
            *(f'{getattr(report, name):,}' for name in rare),
            f'{report.rejected:,}',
            f'{report.rejected / report.points:.3%}',
            *('' if count is None else f'{count:,}' for count in by),
            f'{sum(report.seconds.values()):.1f}',
            'untested' if is_untested(report) else 'done',
        )
    return table


def _table_of_classes(reports: Sequence[CleanReport]) -> Table:
    """Make the table of the classes of LAS, of all files together."""
    total: dict[int, tuple[int, int]] = {}
    for report in reports:
        for number, counts in report.by_class.items():
            before = total.get(number, (0, 0))
            total[number] = (before[0] + counts[0], before[1] + counts[1])
    table = _numbers('class', 'points', 'rejected', 'share')
    for number, (points, rejected) in sorted(total.items()):
        name = f'{number} {CLASSES.get(number, "")}'.rstrip()
        table.add_row(name, f'{points:,}', f'{rejected:,}', f'{rejected / points:.3%}')
    return table


def _table_of_causes(reports: Sequence[CleanReport], worst: Mapping[Path, Worst]) -> Table:
    """Make the table of what is rejected, by where it lies, and by groups where they are known."""
    if not worst:
        table = _numbers('rejected points', 'points')
        for name, attribute in (('below what is kept', 'low'), ('above what is kept', 'high')):
            table.add_row(name, f'{sum(getattr(report, attribute) for report in reports):,}')
        return table
    table = _numbers('rejected points', 'points', 'groups', 'largest')
    counts: dict[str, list[int]] = {}
    for one in worst.values():
        for name, sizes in one.causes.items():
            counts.setdefault(name, []).extend(sizes)
    for name, sizes in counts.items():
        numbers = (sum(sizes), len(sizes), max(sizes, default=0))
        table.add_row(name, *(f'{number:,}' for number in numbers))
    return table


def _table_of_groups(worst: Mapping[Path, Worst]) -> Table:
    """Make the table of the largest groups of all files, in the units of the files."""
    table = _numbers('group', 'points', 'x', 'y', 'z', 'across, m', 'height, m')
    found = [(path, group) for path, one in worst.items() for group in one.groups]
    found.sort(key=lambda item: -item[1].count)
    for number, (path, group) in enumerate(found[:MOST_GROUPS], 1):
        name = f'{number}' if len(worst) == 1 else f'{number} {path.name}'
        position = (f'{value:.1f}' for value in group.middle)
        sizes = (f'{value:.2f}' for value in (group.across, group.height))
        table.add_row(name, f'{group.count:,}', *position, *sizes)
    return table


def _numbers(first: str, *others: str) -> Table:
    """Make a table of numbers behind a name."""
    from rich.table import Table

    table = Table(first, *others)
    table.columns[0].overflow = 'fold'
    for column in table.columns[1:]:
        column.justify, column.no_wrap = 'right', True
    return table
