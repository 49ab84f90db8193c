# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of an archive: which of its recordings or files were odd.

One file, no network, a table without JS.
"""

from __future__ import annotations

from collections import Counter
from html import escape
from itertools import compress, islice
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.oddness import (
    FEWEST,
    LEAST_OF_CLOUDS,
    LEAST_OF_POINTS,
    LIMIT,
    SIGMA,
    DriveCounts,
    drives,
    percent,
    share,
    signed,
)
from lidar_outlier_filter.archive.page_style import COLOURS, SCRIPT, STYLE
from lidar_outlier_filter.disk.new_files import replaced

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

BARS = 400  # at most, in the picture over the table
HEIGHT = 60  # of the picture
COLUMNS = (
    ('name', 'text'),
    ('odd', 'number'),
    ('length', 'number'),
    ('clouds', 'number'),
    ('refused', 'number'),
    ('gaps', 'number'),
    ('points', 'number'),
    ('rejected', 'number'),
    ('by detector', 'number'),
    ('untested', 'number'),
    ('× real time', 'number'),
)
# Columns and sums that files have not: each is one cloud.
OF_RECORDINGS = {'length', 'clouds', 'refused', 'clouds refused', 'gaps', '× real time'}


def write_page(entries: Iterable[Mapping[str, Any]], path: Path, what: str = 'recording') -> None:
    """Write the page for the lines of a manifest; another one is replaced at the end.

    ``what`` is ``recording``, or ``file`` where each is one cloud.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    text = page(entries, what)
    if path.is_file() and path.read_bytes() == text.encode():
        return
    with replaced(path) as built:
        built.write_bytes(text.encode())


def page(entries: Iterable[Mapping[str, Any]], what: str = 'recording') -> str:
    """Make the page for the lines of a manifest."""
    found = drives(entries)
    names = sorted({name for drive in found for name in drive.rejected_by})
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    done = [drive for drive in found if drive.done]
    return '\n'.join(
        [
            '<!DOCTYPE html>',
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<title>Archive</title>',
            f'<style>{STYLE}</style></head><body>',
            f'<h1>{_count(len(found), what)}</h1>',
            *_totals(found, done, colours, what),
            *_picture(found, what),
            *_table(found, colours, what),
            *_explanation(len(done), what),
            f'<script>{SCRIPT}</script></body></html>',
            '',
        ]
    )


def _count(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'


def _is_of(what: str, name: str) -> bool:
    """Return whether recordings, or files, have a column or a sum."""
    return what == 'recording' or name not in OF_RECORDINGS


def _totals(
    found: Sequence[DriveCounts],
    done: Sequence[DriveCounts],
    colours: Mapping[str, str],
    what: str,
) -> Iterator[str]:
    """Give the sums over all."""
    points, messages = sum(d.points for d in done), sum(d.messages for d in done)
    seconds, duration = sum(d.seconds for d in done), sum(d.duration for d in done)
    failed, empty = sum(d.failed for d in found), sum(d.empty for d in found)
    values = {
        'failed': (f'{failed:,}', failed > 0),
        'without clouds': (f'{empty:,}', False),
        'odd': (f'{sum(bool(d.odd) for d in done):,}', any(d.odd for d in done)),
        'length': (length(duration), False),
        'size': (size(sum(d.size for d in found)), False),
        'clouds': (f'{messages:,}', False),
        'clouds refused': (f'{sum(d.refused for d in done):,}', any(d.refused for d in done)),
        'points': (f'{points:,}', False),
        'points rejected': (percent(share(sum(d.rejected for d in done), points)), False),
        'points untested': (percent(share(sum(d.untested for d in done), points)), False),
        '× real time': (f'{share(duration, seconds):.1f}', False),
    }
    yield '<dl class="totals">'
    for name, (text, warns) in values.items():
        if not _is_of(what, name) or (name == 'without clouds' and not empty):
            continue
        mark = ' class="warn"' if warns else ''
        yield f'<div{mark}><dt>{name}</dt><dd>{text}</dd></div>'
    yield '</dl>'
    by = sum((d.rejected_by for d in done), Counter())
    yield '<p class="key">Rejected by '
    for name, colour in colours.items():
        box = f'<i style="background:{colour}"></i>'
        yield f'<span>{box}{escape(name)} {percent(share(by[name], points))}</span> '
    yield '</p>'


def _picture(found: Sequence[DriveCounts], what: str) -> Iterator[str]:
    """Draw a bar for each, in the order of their names, that leads to its row."""
    order = sorted(range(len(found)), key=lambda row: found[row].source)
    each = -(-len(order) // BARS)
    highest = max((share(d.rejected, d.points) for d in found), default=0) or 1
    bars = []
    rows = iter(order)
    while group := list(islice(rows, each)):
        bars.append(max(group, key=lambda row: (found[row].failed, _rejected(found[row]))))
    text = f'the largest of {each} {what}s each' if each > 1 else f'one {what} each'
    if not bars:
        return
    yield '<figure>'
    yield f'<svg viewBox="0 0 {len(bars)} {HEIGHT}" preserveAspectRatio="none" role="img">'
    yield '<title>Share of the points rejected</title>'
    for x, row in enumerate(bars):
        drive = found[row]
        high = HEIGHT if drive.failed else max(1.0, HEIGHT * _rejected(drive) / highest)
        kind = 'failed' if drive.failed else 'odd' if drive.odd else 'plain'
        title = escape(f'{drive.source}: {drive.error or percent(_rejected(drive))}')
        yield (
            f'<a href="#r{row}"><rect class="{kind}" x="{x + 0.1}" y="{HEIGHT - high:.1f}" '
            f'width="0.8" height="{high:.1f}"><title>{title}</title></rect></a>'
        )
    yield '</svg>'
    yield (
        f'<figcaption>Share of the points rejected, by name of the {what}, {text}; the highest '
        f'bar is {percent(highest)}. <i class="plain"></i>usual <i class="odd"></i>odd '
        '<i class="failed"></i>failed</figcaption></figure>'
    )


def _rejected(drive: DriveCounts) -> float:
    return share(drive.rejected, drive.points)


def _table(found: Sequence[DriveCounts], colours: Mapping[str, str], what: str) -> Iterator[str]:
    highest = max((_rejected(drive) for drive in found if drive.done), default=0) or 1
    names = [what, *(name for name, _ in COLUMNS[1:])]
    shown = [_is_of(what, name) for name in names]
    yield '<div class="scroll"><table><thead><tr>'
    for name, (_, kind) in compress(zip(names, COLUMNS, strict=True), shown):
        yield f'<th scope="col" data-kind="{kind}">{name}</th>'
    yield '</tr></thead><tbody>'
    for row, drive in enumerate(found):
        cells = compress(_cells(drive, colours, highest), shown)
        yield f'<tr id="r{row}">{"".join(cells)}</tr>'
    yield '</tbody></table></div>'


def _cells(drive: DriveCounts, colours: Mapping[str, str], highest: float) -> Iterator[str]:
    name = escape(drive.source)
    last = escape(drive.source.rstrip('/').rpartition('/')[2])
    kind = 'failed' if drive.failed else 'odd' if drive.done else 'plain'
    lines = [drive.error] if drive.error else drive.odd
    notes = ''.join(f'<small class="{kind}">{_unbroken(escape(line))}</small>' for line in lines)
    yield f'<th scope="row" title="{name}" data-sort="{name}"><b>{last}</b>{notes}</th>'
    if not drive.done:
        text, sort = ('failed', 'inf') if drive.failed else ('no clouds', '-1')
        yield f'<td class="{kind}" data-sort="{sort}">{text}</td>'
        yield from ['<td></td>'] * (len(COLUMNS) - 2)
        return
    mark = ' class="odd"' if abs(drive.z) >= LIMIT else ''
    yield f'<td{mark} data-sort="{abs(drive.z)}">{signed(drive.z)}</td>'
    yield _cell(drive.duration, length(drive.duration))
    for value in (drive.messages, drive.refused, drive.gaps, drive.points):
        yield _cell(value, f'{value:,}')
    rejected = _rejected(drive)
    yield _cell(rejected, percent(rejected))
    yield f'<td data-sort="{rejected}">{_bar(drive, colours, highest)}</td>'
    untested = share(drive.untested, drive.points)
    yield _cell(untested, percent(untested))
    speed = share(drive.duration, drive.seconds)
    yield _cell(speed, f'{speed:.1f}')


def _unbroken(line: str) -> str:
    """Keep a number and its sign on one line."""
    return line.replace(' %', '\N{NO-BREAK SPACE}%').replace('(z ', '(z\N{NO-BREAK SPACE}')


def _cell(value: float, text: str) -> str:
    return f'<td data-sort="{value}">{text}</td>'


def _bar(drive: DriveCounts, colours: Mapping[str, str], highest: float) -> str:
    """Draw the share of each detector; where several reject a point, their parts are scaled."""
    total = sum(drive.rejected_by.values())
    parts = [
        f'<i style="width:{100 * share(count, total):.1f}%;background:{colours[name]}" '
        f'title="{escape(name)} {percent(share(count, drive.points))}"></i>'
        for name, count in sorted(drive.rejected_by.items())
    ]
    width = 100 * min(1.0, _rejected(drive) / highest)
    return f'<span class="bar"><span style="width:{width:.1f}%">{"".join(parts)}</span></span>'


def _explanation(done: int, what: str) -> Iterator[str]:
    least, compared, lacking = f'{percent(LEAST_OF_POINTS)} of the points', '', ''
    if what == 'recording':
        least += f' or {percent(LEAST_OF_CLOUDS)} of the clouds'
        compared = ', and of clouds after a gap'
        lacking = (
            'It is odd, too, if clouds were refused, no point of a topic could be tested, or '
            'messages are missing. '
        )
    yield (
        f'<p class="note">A {what} is odd if a share of it is {LIMIT:g} or more robust z from '
        f'the median of all {what}s: (share − median) / ({SIGMA:g} × the median absolute '
        f'deviation, at least {least}). Compared are the shares of points rejected, '
        f'rejected by each detector and untested{compared}. {lacking}'
        'The column “odd” has the largest z.</p>'
    )
    if done < FEWEST:
        yield f'<p class="note">Fewer than {FEWEST} {what}s are done: none is compared.</p>'


def length(seconds: float) -> str:
    """Write a time as people do."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f'{hours:,} h {minutes:02} min'
    return f'{minutes} min {rest:02} s' if minutes else f'{seconds:.3g} s'


def size(count: float) -> str:
    """Write a number of bytes with three digits that count."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:  # noqa: PLR2004  the step between units
            return f'{count:.3g} {unit}'
        count /= 1000
    return f'{count:.3g} TB'
