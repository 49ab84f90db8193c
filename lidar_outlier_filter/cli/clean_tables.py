# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What ``clean`` prints at its end: sentences, and tables by file, class, cause and group."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from rich.table import Table

    from lidar_outlier_filter.archive.manifest import Entry
    from lidar_outlier_filter.archive.one_file import CleanOrder, FileTask
    from lidar_outlier_filter.archive.order import Made
    from lidar_outlier_filter.files.clean import CleanReport
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
# By a rule in metres.
LOW_POINTS = 'to find more, try --chain boosted_trees,elevation --set elevation.against=ground'
MUCH = 0.005  # share of the points that rarely are outliers
MOST_GROUPS = 10  # that are listed


def show(
    tasks: Sequence[FileTask],
    entries: Sequence[Entry],
    tried: Sequence[FileTask],
    order: CleanOrder,
    made: Mapping[FileTask, Made],
) -> None:
    """Print what became of each of many files, the tables, and what was written."""
    from rich.console import Console

    from lidar_outlier_filter.cli.archive_tables import print_counts, say_lacks, table_of_all

    for task, entry in zip(tasks, entries, strict=True):
        if task in made:
            _say_how(task.path, made[task].report)
        else:
            say_lacks(task.location, entry)
    Console().print(table_of_all(tasks, entries, tried, order))
    reports = [made[task].report for task in tasks if task in made]
    worst = {task.path: one.found for task, one in made.items() if one.found is not None}
    _show_rejected(reports, worst)
    print_counts(entries, tried, order)


def show_one(path: Path, report: CleanReport, seconds: float, worst: Worst | None) -> None:
    """Print what became of a single file, the tables, and what was written."""
    from rich.console import Console

    _say_how(path, report)
    rare = ('invalid', 'ignored', 'untested', 'spared')
    counts = {
        'points': report.points,
        **{name: getattr(report, name) for name in rare if getattr(report, name)},
        'rejected': report.rejected,
    }
    by = report.rejected_by if len(report.rejected_by) > 1 else {}
    names = [*counts, 'share', *(f'by {name}' for name in by), 'seconds', 'state']
    table = numbers('file', *names)
    cells = [f'{count:,}' for count in counts.values()]
    cells.append(f'{report.rejected / max(report.points, 1):.3%}')
    cells += [f'{count:,}' for count in by.values()]
    table.add_row(path.name, *cells, f'{seconds:.1f}', 'untested' if report.is_untested else 'done')
    Console().print(table)
    _show_rejected([report], {} if worst is None else {path: worst})


def _show_rejected(reports: Sequence[CleanReport], worst: Mapping[Path, Worst]) -> None:
    """Print tables by class, cause and group, and what was written."""
    from rich.console import Console

    console = Console()
    if any(report.by_class for report in reports):
        console.print(_table_of_classes(reports))
    if any(report.rejected for report in reports):
        console.print(_table_of_causes(reports, worst))
    if any(one.groups for one in worst.values()):
        console.print(_table_of_groups(worst))
    for report in reports:
        for written in report.outputs:
            console.print(f'written to {written}', markup=False, highlight=False, soft_wrap=True)


def numbers(first: str, *others: str) -> Table:
    """Make a table of numbers behind a name."""
    from rich.table import Table

    made = Table(first, *others)
    made.columns[0].overflow = 'fold'  # a name is never cut
    for column in made.columns[1:]:
        column.justify, column.no_wrap = 'right', True
    return made


def _say_how(path: Path, report: CleanReport) -> None:
    """Say in which way a file is not judged as it is."""
    if report.metres:
        sizes = ', '.join(f'{name} = {size:.10g} m' for name, size in report.metres.items())
        crs = f'; its coordinate system is {report.crs}' if report.crs else ''
        say(f'{path} is not in metres ({sizes}): it is judged in metres{crs}')
    if report.coarse:
        say(f'{path}: {report.coarse}')
    if report.rings:
        has = f' has {report.lack}' if report.lack else ''
        say(f'{path}{has}: {report.rings} rings are recovered from elevation')
    elif report.lack:
        say(f'{path} has {report.lack}: it is judged without scan lines')
    if report.is_untested:
        say(f'{path}: {" and ".join(report.chain)} could test none of its points')
    if report.left_low:
        say(f'{path}: kept points that look like low points: {report.left_low:,}; {LOW_POINTS}')
    if report.rejected > MUCH * report.points:
        say(f'{path}: {report.rejected / report.points:.1%} of its points are rejected')


def _table_of_classes(reports: Sequence[CleanReport]) -> Table:
    """Make the table of the classes of LAS, of all files together."""
    total: dict[int, tuple[int, int]] = {}
    for report in reports:
        for number, counts in report.by_class.items():
            before = total.get(number, (0, 0))
            total[number] = (before[0] + counts[0], before[1] + counts[1])
    table = numbers('class', 'points', 'rejected', 'share')
    for number, (points, rejected) in sorted(total.items()):
        name = f'{number} {CLASSES.get(number, "")}'.rstrip()
        table.add_row(name, f'{points:,}', f'{rejected:,}', f'{rejected / points:.3%}')
    return table


def _table_of_causes(reports: Sequence[CleanReport], worst: Mapping[Path, Worst]) -> Table:
    """Make the table of what is rejected, by where it lies, and by groups where they are known."""
    if not worst:
        table = numbers('rejected points', 'points')
        for name, attribute in (('below what is kept', 'low'), ('above what is kept', 'high')):
            table.add_row(name, f'{sum(getattr(report, attribute) for report in reports):,}')
        return table
    table = numbers('rejected points', 'points', 'groups', 'largest')
    counts: dict[str, list[int]] = {}
    for one in worst.values():
        for name, sizes in one.causes.items():
            counts.setdefault(name, []).extend(sizes)
    for name, sizes in counts.items():
        sums = (sum(sizes), len(sizes), max(sizes, default=0))
        table.add_row(name, *(f'{number:,}' for number in sums))
    return table


def _table_of_groups(worst: Mapping[Path, Worst]) -> Table:
    """Make the table of the largest groups of all files, in the units of the files."""
    table = numbers('group', 'points', 'x', 'y', 'z', 'across, m', 'height, m')
    found = [(path, group) for path, one in worst.items() for group in one.groups]
    found.sort(key=lambda item: -item[1].count)
    for number, (path, group) in enumerate(found[:MOST_GROUPS], 1):
        name = f'{number}' if len(worst) == 1 else f'{number} {path.name}'
        position = (f'{value:.1f}' for value in group.middle)
        sizes = (f'{value:.2f}' for value in (group.across, group.height))
        table.add_row(name, f'{group.count:,}', *position, *sizes)
    return table
