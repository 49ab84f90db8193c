# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a run over an archive prints at its end, and the exit status."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, REFUSED, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import Entry
    from lidar_outlier_filter.archive.task import Task

MOST_NAMES = 5  # of recordings without clouds, in the last line


def show(
    tasks: Sequence[Task], entries: Sequence[Entry], tried: Sequence[Task], folder: object
) -> None:
    """Print the table of a run that tried some of them, and to stderr what failed or lacks."""
    from rich.console import Console

    from lidar_outlier_filter.archive.manifest import DONE as IS_DONE
    from lidar_outlier_filter.archive.manifest import NO_CLOUDS

    console = Console()
    console.print(_table(tasks, entries))
    console.print(f'written to {folder}', markup=False, highlight=False, soft_wrap=True)
    for task, entry in zip(tasks, entries, strict=True):
        _say_lacks(task.location, entry)
    done = [entry for entry in entries if entry.state == IS_DONE]
    empty = [entry.source for entry in entries if entry.state == NO_CLOUDS]
    now = {task.source for task in tried}
    before = sum(entry.source not in now for entry in done)
    lacking = sum(not entry.is_complete for entry in done)
    counts = f'{len(done) - before} replayed, {before} done before'
    counts += f', {len(entries) - len(done) - len(empty)} failed, {lacking} incomplete'
    if empty:
        more = f' and {len(empty) - MOST_NAMES:,} more' if len(empty) > MOST_NAMES else ''
        counts += f', {len(empty)} without clouds: {", ".join(empty[:MOST_NAMES])}{more}'
    console.print(counts, markup=False, highlight=False, soft_wrap=True)


def _say_lacks(location: Location, entry: Entry) -> None:
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


def _table(tasks: Sequence[Task], entries: Sequence[Entry]) -> Table:
    """Make the table of an archive, a row for each recording, for a terminal of 80 columns."""
    from rich import box
    from rich.table import Table

    from lidar_outlier_filter.archive.columns import in_terminal
    from lidar_outlier_filter.archive.oddness import counts_of

    counted = [counts_of(asdict(entry)) for entry in entries]
    columns = in_terminal(counted)
    heads = (column.name.replace('real time', 'real\ntime') for column in columns)
    table = Table('recording', *heads, box=box.SIMPLE_HEAD, padding=0, show_edge=False)
    table.columns[0].overflow = 'fold'  # a name is never cut
    for place in table.columns[1:]:
        place.justify, place.no_wrap = 'right', True
    for task, entry, counts in zip(tasks, entries, counted, strict=True):
        if entry.error is None:
            cells = [f'{column.value(counts):{column.format}}' for column in columns]
        else:
            cells = [entry.state, *[''] * (len(columns) - 1)]
        table.add_row(task.made, *cells)
    return table


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
