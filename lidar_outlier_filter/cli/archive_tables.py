# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The tables and the exit status of a run over recordings or files."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, REFUSED, say
from lidar_outlier_filter.errors import printable

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rich.table import Table

    from lidar_outlier_filter.archive.jobs import Job, Task
    from lidar_outlier_filter.archive.sidecar import ArchiveRecord

MAX_ROWS = 1000  # of a table: more take a terminal seconds
MAX_NAMES = 5  # of recordings without clouds, in the last line


def show(
    tasks: Sequence[Task],
    records: Sequence[ArchiveRecord],
    tried: Collection[Task],
    job: Job,
    folder: object,
) -> None:
    """Print the table of a run, and to stderr what failed or is incomplete."""
    from rich.console import Console

    console = Console()
    console.print(table_of_all(tasks, records, tried, job))
    line = printable(f'written to {folder}')
    console.print(line, markup=False, highlight=False, soft_wrap=True)
    for task, record in zip(tasks, records, strict=True):
        say_lacks(task, record)
    print_counts(tasks, records, tried, job)


def print_counts(
    tasks: Sequence[Task], records: Sequence[ArchiveRecord], tried: Collection[Task], job: Job
) -> None:
    """Print how many are done, now and before, failed and incomplete."""
    from rich.console import Console

    of_state = {state: [r for r in records if r.state == state] for state in _states()}
    done, failed, empty = of_state.values()
    left = set(tasks) - set(tried)
    before = sum(
        record.state == _states()[0]
        for task, record in zip(tasks, records, strict=True)
        if task in left
    )
    lacking = sum(not record.is_complete for record in done)
    counts = f'{len(done) - before} {job.done}, {before} done before'
    counts += f', {len(failed)} {job.failed}, {lacking} incomplete'
    if empty:
        names = ', '.join(printable(record.source) for record in empty[:MAX_NAMES])
        more = f' and {len(empty) - MAX_NAMES:,} more' if len(empty) > MAX_NAMES else ''
        counts += f', {len(empty)} without clouds: {names}{more}'
    Console().print(counts, markup=False, highlight=False, soft_wrap=True)


def _states() -> tuple[str, str, str]:
    from lidar_outlier_filter.archive import sidecar

    return sidecar.DONE, sidecar.FAILED, sidecar.NO_CLOUDS


def say_lacks(task: Task, record: ArchiveRecord) -> None:
    """Say what an output lacks, or why there is none."""
    path = task.location.path
    if record.state == _states()[1]:
        say(record.error or 'no reason is known')
    if record.refused:
        say(f'{record.refused} clouds of {path} were refused and have no result')
    for topic, reason in record.untested.items():
        say(f'no point of {topic} of {path} could be tested: {reason}')
    if record.unread:
        say(f'{record.unread} messages that {path} counts were not found in it')
    for reason in record.lost:
        say(f'lost of {path}: {reason}')


def table_of_all(
    tasks: Sequence[Task], records: Sequence[ArchiveRecord], tried: Collection[Task], job: Job
) -> Table:
    """Make the table, a row for each recording or file.

    That of recordings fits into 80 columns; that of files has a column for the state. Of very many
    only some are shown, failed and incomplete ones first; the page has all.
    """
    from rich import box

    from lidar_outlier_filter.archive.columns import in_terminal
    from lidar_outlier_filter.archive.oddness import ArchiveRow

    pairs = list(zip(tasks, records, strict=True))
    if len(pairs) > MAX_ROWS:
        pairs = sorted(pairs, key=lambda pair: pair[1].is_complete)[:MAX_ROWS]
    rows, of_files = [ArchiveRow(record) for _, record in pairs], job.what == 'file'
    columns = in_terminal(rows, job.what)
    heads = [column.name.replace('real time', 'real\ntime') for column in columns]
    style: dict[str, Any] = {'box': box.SIMPLE_HEAD, 'padding': 0, 'show_edge': False}
    made = numbers(job.what, *heads, 'state') if of_files else numbers(job.what, *heads, **style)
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
        made.add_row(printable(task.source if of_files else task.names[0]), *cells, *states)
    return made


def _state(record: ArchiveRecord, job: Job, *, is_new: bool) -> str:
    if record.error is not None:
        return job.failed
    if record.untested:
        return 'untested'
    return 'done' if is_new else 'done before'


def numbers(first: str, *others: str, **style: Any) -> Table:
    """Make a table of numbers with names in the first column."""
    from rich.table import Table

    made = Table(first, *others, **style)
    made.columns[0].overflow = 'fold'  # a name is never cut
    for column in made.columns[1:]:
        column.justify, column.no_wrap = 'right', True
    return made


def status(records: Sequence[ArchiveRecord]) -> int:
    """Choose the exit status; recordings without clouds do not count."""
    done, _, empty = _states()
    if not any(record.state == done for record in records):
        return REFUSED
    fine = all(record.is_complete or record.state == empty for record in records)
    return DONE if fine else INCOMPLETE
