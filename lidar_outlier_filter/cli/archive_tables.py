# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a run over recordings or files prints at its end, and the exit status."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, REFUSED, say

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rich.table import Table

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import Entry
    from lidar_outlier_filter.archive.order import Order
    from lidar_outlier_filter.archive.task import Task

MOST_ROWS = 1000  # of a table: more take a terminal seconds, and nobody reads them
MOST_NAMES = 5  # of recordings without clouds, in the last line


def show(
    tasks: Sequence[Task],
    entries: Sequence[Entry],
    tried: Collection[Task],
    order: Order[Any],
    folder: object,
) -> None:
    """Print the table of a run that tried some of them, and to stderr what failed or lacks."""
    from rich.console import Console

    console = Console()
    console.print(table_of_all(tasks, entries, tried, order))
    console.print(f'written to {folder}', markup=False, highlight=False, soft_wrap=True)
    for task, entry in zip(tasks, entries, strict=True):
        say_lacks(task.location, entry)
    print_counts(entries, tried, order)


def _before(entries: Sequence[Entry], tried: Collection[Task]) -> set[str]:
    """Name what was done before."""
    now = {task.source for task in tried}
    return {entry.source for entry in entries if entry.source not in now}


def print_counts(entries: Sequence[Entry], tried: Collection[Task], order: Order[Any]) -> None:
    """Print how many are done, now and before, and how many are not."""
    from rich.console import Console

    from lidar_outlier_filter.archive.manifest import DONE as IS_DONE
    from lidar_outlier_filter.archive.manifest import NO_CLOUDS

    done = [entry for entry in entries if entry.state == IS_DONE]
    empty = [entry.source for entry in entries if entry.state == NO_CLOUDS]
    before = len(_before(done, tried))
    failed = len(entries) - len(done) - len(empty)
    lacking = sum(not entry.is_complete for entry in done)
    counts = f'{len(done) - before} {order.verb}, {before} done before'
    counts += f', {failed} {order.failed}, {lacking} incomplete'
    if empty:
        more = f' and {len(empty) - MOST_NAMES:,} more' if len(empty) > MOST_NAMES else ''
        counts += f', {len(empty)} without clouds: {", ".join(empty[:MOST_NAMES])}{more}'
    Console().print(counts, markup=False, highlight=False, soft_wrap=True)


def say_lacks(location: Location, entry: Entry) -> None:
    """Say what is missing in an output, or why there is none."""
    from lidar_outlier_filter.archive.manifest import FAILED

    if entry.state == FAILED:
        say(entry.error or 'no reason is known')
    if entry.refused:
        say(f'{entry.refused} clouds of {location.path} were refused and have no answer')
    for topic, reason in entry.untested.items():
        say(f'no point of {topic} of {location.path} could be tested: {reason}')
    if entry.unread:
        say(f'{entry.unread} messages that {location.path} counts were not found in it')
    for reason in entry.lost:
        say(f'lost of {location.path}: {reason}')


def table_of_all(
    tasks: Sequence[Task], entries: Sequence[Entry], tried: Collection[Task], order: Order[Any]
) -> Table:
    """Make the table, a row for each; of recordings it fits into a terminal of 80 columns.

    Files have a column that says what became of each. Of very many only some are shown, those that
    failed or lack something first; the page has all.
    """
    from rich import box

    from lidar_outlier_filter.archive.columns import in_terminal
    from lidar_outlier_filter.archive.oddness import counts_of

    rows = list(zip(tasks, entries, strict=True))
    if len(rows) > MOST_ROWS:
        rows = sorted(rows, key=lambda row: row[1].is_complete)[:MOST_ROWS]
    counted = [counts_of(asdict(entry)) for _, entry in rows]
    columns = in_terminal(counted, order.what)
    heads = [column.name.replace('real time', 'real\ntime') for column in columns]
    before = _before(entries, tried)
    of_files = order.what == 'file'
    made = (
        numbers(order.what, *heads, 'state')
        if of_files
        else numbers(order.what, *heads, box=box.SIMPLE_HEAD, padding=0, show_edge=False)
    )
    if len(rows) < len(entries):
        made.caption = f'{len(entries) - len(rows):,} more are on the page'
    for (task, entry), counts in zip(rows, counted, strict=True):
        cells = [''] * len(columns)
        if entry.error is None:
            cells = [f'{column.value(counts):{column.format}}' for column in columns]
        elif not of_files:
            cells[0] = entry.state
        states = [_state(entry, before, order)] if of_files else []
        made.add_row(task.label, *cells, *states)
    return made


def _state(entry: Entry, before: Collection[str], order: Order[Any]) -> str:
    """Say in a word what became of one."""
    if entry.error is not None:
        return order.failed
    if entry.untested:
        return 'untested'
    return 'done before' if entry.source in before else 'done'


def numbers(first: str, *others: str, **style: Any) -> Table:
    """Make a table of numbers behind a name."""
    from rich.table import Table

    made = Table(first, *others, **style)
    made.columns[0].overflow = 'fold'  # a name is never cut
    for column in made.columns[1:]:
        column.justify, column.no_wrap = 'right', True
    return made


def status(entries: Sequence[Entry]) -> int:
    """Choose the exit status: REFUSED where nothing is done, INCOMPLETE where something is not.

    Recordings without clouds are left out of account.
    """
    from lidar_outlier_filter.archive.manifest import DONE as IS_DONE
    from lidar_outlier_filter.archive.manifest import NO_CLOUDS

    if not any(entry.state == IS_DONE for entry in entries):
        return REFUSED
    fine = all(entry.is_complete or entry.state == NO_CLOUDS for entry in entries)
    return DONE if fine else INCOMPLETE
