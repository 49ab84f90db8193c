# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, sentences and exit status at the end of ``clean``, and of many replays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, REFUSED, numbers, say, show
from lidar_outlier_filter.core.detectors.plausible import check_share
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.clean import CleanReport
from lidar_outlier_filter.files.judged_file import unit_text
from lidar_outlier_filter.parameters.declaration import MASK

if TYPE_CHECKING:
    from lidar_outlier_filter.archive.jobs import Job, Result, Task
    from lidar_outlier_filter.archive.sidecar import ArchiveRecord
    from lidar_outlier_filter.report.worst import Worst

MAX_ROWS = 1000  # of a table: more take a terminal seconds
SHOWN_NAMES = 5  # of recordings without clouds, in the last line
# Of ASPRS (LAS 1.4, table 17); 12 is reserved.
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
NOTABLE_SHARE = 0.005  # share of the points that rarely are outliers
SHOWN_GROUPS = 10  # that are listed


def show_replayed(
    tasks: Sequence[Task],
    records: Sequence[ArchiveRecord],
    tried: Collection[Task],
    job: Job,
    folder: object,
) -> None:
    """Print the table of a run, and to stderr what failed or is incomplete."""
    show(table_of_all(tasks, records, tried, job), f'written to {folder}')
    for task, record in zip(tasks, records, strict=True):
        say_lacks(task, record)
    print_counts(tasks, records, tried, job)


def print_counts(
    tasks: Sequence[Task], records: Sequence[ArchiveRecord], tried: Collection[Task], job: Job
) -> None:
    """Print how many are done, now and before, failed and incomplete."""
    done = [record for record in records if record.is_done]
    failed = [record for record in records if record.is_failed]
    empty = [record for record in records if not (record.is_done or record.is_failed)]
    pairs = zip(tasks, records, strict=True)
    before = sum(record.is_done and task not in tried for task, record in pairs)
    lacking = sum(not record.is_complete for record in done)
    counts = f'{len(done) - before} {job.done}, {before} done before'
    counts += f', {len(failed)} {job.failed}, {lacking} incomplete'
    if empty:
        names = ', '.join(record.source for record in empty[:SHOWN_NAMES])
        more = f' and {len(empty) - SHOWN_NAMES:,} more' if len(empty) > SHOWN_NAMES else ''
        counts += f', {len(empty)} without clouds: {names}{more}'
    show(counts)


def say_implausible(
    what: str, topics: Mapping[str, Mapping[str, Any]], accepted: float | None
) -> bool:
    """Report topics of which more was rejected than can be outliers; return whether there are any.

    Parameters
    ----------
    what : the recording
    topics : counts by topic
    accepted : share of the points that may be rejected

    """
    found = False
    for name, counts in topics.items():
        try:
            check_share(
                f'{name} of {what}',
                counts['rejected'] - counts['rejected_by'].get(MASK, 0),
                counts['points'] - counts['untested'] - counts.get('invalid', 0),
                counts.get('methods', ()),
                accepted,
            )
        except CloudError as err:
            say(str(err))
            found = True
    return found


def say_lacks(task: Task, record: ArchiveRecord) -> None:
    """Report the losses of an output, or why it is missing."""
    path = task.location.path
    if record.is_failed:
        say(record.error or 'no reason is known')
    if record.refused:
        say(f'{record.refused} clouds of {path} were refused and have no result')
    for topic, reason in record.untested.items():
        say(f'no point of {topic} of {path} could be tested: {reason}')
    if record.unread:
        say(f'{record.unread} messages of its own count are missing in {path}')
    for reason in record.lost:
        say(f'lost of {path}: {reason}')


def table_of_all(
    tasks: Sequence[Task], records: Sequence[ArchiveRecord], tried: Collection[Task], job: Job
) -> Table:
    """Make the table, a row for each recording or file.

    For recordings it fits into 80 columns; for files it has a column for the state. At most
    ``MAX_ROWS`` are shown, failed and incomplete ones first; the page has all.
    """
    # One file needs no archive.
    from lidar_outlier_filter.archive.rows import ArchiveRow, in_terminal  # noqa: PLC0415

    pairs = list(zip(tasks, records, strict=True))
    if len(pairs) > MAX_ROWS:
        pairs = sorted(pairs, key=lambda pair: pair[1].is_complete)[:MAX_ROWS]
    rows, of_files = [ArchiveRow(record) for _, record in pairs], job.what == 'file'
    columns = in_terminal(rows, job.what)
    heads = [column.name.replace('real time', 'real\ntime') for column in columns]
    style: dict[str, Any] = {'box': box.SIMPLE_HEAD, 'padding': 0, 'show_edge': False}
    made = numbers(job.what, *heads, 'state') if of_files else numbers(job.what, *heads, **style)
    # Beside the counts of files, 80 columns leave two letters for a name: it is not folded.
    made.columns[0].no_wrap = of_files
    if len(rows) < len(records):
        made.caption = f'{len(records) - len(rows):,} more are on the page'
    now = set(tried)
    for (task, record), row in zip(pairs, rows, strict=True):
        cells = [''] * len(columns)
        if record.error is None:
            cells = [column.text(column.value(row)) for column in columns]
        elif not of_files:
            cells[0] = record.state
        states = [_state(record, job, is_new=task in now)] if of_files else []
        made.add_row(task.source if of_files else task.names[0], *cells, *states)
    return made


def _state(record: ArchiveRecord, job: Job, *, is_new: bool) -> str:
    if record.error is not None:
        return job.failed
    if record.untested:
        return 'untested'
    return 'done' if is_new else 'done before'


def status(records: Sequence[ArchiveRecord]) -> int:
    """Choose the exit status; recordings without clouds do not count."""
    if not any(record.is_done for record in records):
        return REFUSED
    counted = [record for record in records if record.is_done or record.is_failed]
    return DONE if all(record.is_complete for record in counted) else INCOMPLETE


def show_cleaned(
    tasks: Sequence[Task],
    records: Sequence[ArchiveRecord],
    results: Mapping[Task, Result],
    job: Job,
) -> None:
    """Print the results of many files: sentences, tables, and the outputs."""
    reports, worst = {}, {}
    for task, record in zip(tasks, records, strict=True):
        one = results.get(task)
        if one is None or one.report is None:
            say_lacks(task, record)
            continue
        path = Path(str(task.location.path))
        reports[path] = one.report
        if one.found is not None:
            worst[path] = one.found
    is_shown = len(tasks) > 1 or records[0].error is None
    _show(reports, worst, table_of_all(tasks, records, results, job) if is_shown else None)
    if len(tasks) > 1:
        print_counts(tasks, records, results, job)


def show_file(path: Path, report: CleanReport, worst: Worst | None, seconds: float) -> None:
    """Print the results of a single file: sentences, tables, and the outputs."""
    rare = ('invalid', 'ignored', 'untested', 'spared')
    counts = {name: getattr(report, name) for name in rare if getattr(report, name)}
    row = {'points': report.points, **counts, 'rejected': report.rejected}
    cells = {name: f'{number:,}' for name, number in row.items()}
    cells['share'] = f'{100 * report.rejected / report.points:.3f} %'
    cells |= {'seconds': f'{seconds:.1f}', 'state': 'untested' if report.is_untested else 'done'}
    table = numbers('file', *cells)
    table.add_row(path.name, *cells.values())
    _show({path: report}, {} if worst is None else {path: worst}, table)


def _show(
    found: Mapping[Path, CleanReport], worst: Mapping[Path, Worst], table: Table | None
) -> None:
    """Print sentences on each file, the table of all, further tables, and the outputs."""
    for path, report in found.items():
        _say_how(path, report)
    reports = list(found.values())
    if table is not None:
        show(table)
    if any(len(report.rejected_by) > 1 for report in reports):
        show(_table_of_detectors(reports))
    if any(report.by_class for report in reports):
        show(_table_of_classes(reports))
    if any(report.rejected for report in reports):
        show(_table_of_causes(reports, worst))
    if any(one.groups for one in worst.values()):
        show(_table_of_groups(worst))
    show(*(f'written to {name}' for report in reports for name in report.outputs))


def _say_how(path: Path, report: CleanReport) -> None:
    """Report units, scan lines and other circumstances of how a file was judged."""
    if report.metres:
        unit = unit_text(report.metres)
        crs = f'; its coordinate system is {report.crs}' if report.crs else ''
        say(f'{path} is in {unit}, and is judged in metres{crs}')
    if report.coarse:
        say(f'{path}: {report.coarse}')
    if report.note:
        say(f'{path}: {report.note}')
    if report.rings:
        has = f' has {report.lack}' if report.lack else ''
        say(f'{path}{has}: {report.rings} rings are recovered from elevation')
    elif report.lack:
        say(f'{path} has {report.lack}: it is judged without scan lines')
    if report.is_untested:
        say(f'{path}: {" and ".join(report.chain)} could test none of its points')
    if report.left_low:
        say(f'{path}: kept points that look like low points: {report.left_low:,}; {LOW_POINTS}')
    if report.rejected > NOTABLE_SHARE * report.points:
        say(f'{path}: {100 * report.rejected / report.points:.1f} % of its points are rejected')


def _table_of_detectors(reports: Sequence[CleanReport]) -> Table:
    """Make the table of what each detector of a chain rejected, of all files together."""
    rejected = Counter[str]()
    for report in reports:
        rejected.update(report.rejected_by)
    table = numbers('detector', 'rejected')
    for name, count in rejected.items():
        table.add_row(name, f'{count:,}')
    return table


def _table_of_classes(reports: Sequence[CleanReport]) -> Table:
    """Make the table of the classes of LAS, of all files together."""
    points, rejected = Counter[int](), Counter[int]()
    for report in reports:
        for number, counts in report.by_class.items():
            points[number] += counts[0]
            rejected[number] += counts[1]
    table = numbers('class', 'points', 'rejected', 'share')
    for number, count in sorted(points.items()):
        name = f'{number} {CLASSES.get(number, "")}'.rstrip()
        share = f'{100 * rejected[number] / count:.3f} %'
        table.add_row(name, f'{count:,}', f'{rejected[number]:,}', share)
    return table


def _table_of_causes(reports: Sequence[CleanReport], worst: Mapping[Path, Worst]) -> Table:
    """Make the table of rejected points by position, and by groups if they are known."""
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
    for number, (path, group) in enumerate(found[:SHOWN_GROUPS], 1):
        name = f'{number}' if len(worst) == 1 else f'{number} {path.name}'
        position = (f'{value:.1f}' for value in group.middle)
        sizes = (f'{value:.2f}' for value in (group.across, group.height))
        table.add_row(name, f'{group.count:,}', *position, *sizes)
    return table
