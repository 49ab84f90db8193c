# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of an archive: which of its recordings or files were odd.

One file, no network, a table without JS.
"""

from __future__ import annotations

from collections import Counter
from html import escape
from itertools import chain, islice
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from lidar_outlier_filter.archive.columns import COLUMNS, REJECTED, length, rejected
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
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.columns import Column

BARS = 400  # at most, in the picture over the table
HEIGHT = 60  # of the picture
SHOWN = 1000  # rows at first: a browser takes seconds to lay out ten times as many
MOST_WAYS = 3  # versions and parameters that are named
REPORT = '_report.html'  # behind the name of an output: the page that `report` writes on it
# Sums that files have not: each is one cloud.
OF_RECORDINGS = ('length', 'clouds', 'clouds refused', '× real time')


def write_page(entries: Iterable[Mapping[str, Any]], path: Path, what: str = 'recording') -> None:
    """Write the page for the lines of a manifest; another one is replaced at the end.

    ``what`` is ``recording``, or ``file`` where each is one cloud.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    lines = list(entries)
    names = {line['output'] for line in lines}
    reports = {name for name in names if (path.parent / f'{name}{REPORT}').is_file()}
    text = page(lines, what, reports)
    if path.is_file() and path.read_bytes() == text.encode():
        return
    with replaced(path) as built:
        built.write_bytes(text.encode())


def page(
    entries: Iterable[Mapping[str, Any]], what: str = 'recording', reports: Collection[str] = ()
) -> str:
    """Make the page for the lines of a manifest; ``reports`` are the outputs that have one."""
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
            *_made_by(done),
            *_totals(found, done, colours, what),
            *_picture(found, what),
            *_table(found, colours, what, reports),
            *_explanation(len(done), what),
            f'<script>{SCRIPT}</script></body></html>',
            '',
        ]
    )


def _count(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'


def _made_by(done: Sequence[DriveCounts]) -> Iterator[str]:
    """Say by which versions and parameters outputs were made, the most first, and when."""
    ways = Counter(drive.how for drive in done).most_common()
    days = sorted(drive.finished[:10] for drive in done if drive.finished)
    texts = [
        f'{version}, parameters {parameters[:12]}' + f' ({count:,})' * (len(ways) > 1)
        for (version, parameters), count in ways[:MOST_WAYS]
        if version
    ]
    if len(ways) > MOST_WAYS:
        texts.append(f'{len(ways) - MOST_WAYS} others')
    if days:
        span = days[0] if days[0] == days[-1] else f'{days[0]} to {days[-1]}'
        texts = [f'done {span}, by version {"; ".join(texts)}' if texts else f'done {span}']
    yield from (f'<p class="note">{escape(text)}</p>' for text in texts)


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
    left_out: tuple[str, ...] = () if what == 'recording' else OF_RECORDINGS
    if not empty:
        left_out = (*left_out, 'without clouds')
    yield '<dl class="totals">'
    for name, (text, warns) in values.items():
        if name in left_out:
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
        bars.append(max(group, key=lambda row: (found[row].failed, rejected(found[row]))))
    text = f'the largest of {each} {what}s each' if each > 1 else f'one {what} each'
    if not bars:
        return
    yield '<figure>'
    yield f'<svg viewBox="0 0 {len(bars)} {HEIGHT}" preserveAspectRatio="none" role="img">'
    yield '<title>Share of the points rejected</title>'
    for x, row in enumerate(bars):
        drive = found[row]
        high = HEIGHT if drive.failed else max(1.0, HEIGHT * rejected(drive) / highest)
        kind = 'failed' if drive.failed else 'odd' if drive.odd else 'plain'
        title = escape(f'{drive.source}: {drive.error or percent(rejected(drive))}')
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


def _table(
    found: Sequence[DriveCounts],
    colours: Mapping[str, str],
    what: str,
    reports: Collection[str],
) -> Iterator[str]:
    highest = max((rejected(drive) for drive in found if drive.done), default=0) or 1
    columns = [column for column in COLUMNS if column.is_of(what)]
    if len(found) > SHOWN:
        text = f'show all {len(found):,}, not the first {SHOWN:,} only'
        yield f'<label class="note"><input type="checkbox" id="all"> {text}</label>'
        behind = f'tr:nth-child(n+{SHOWN + 1}):not(:target)'
        yield f'<style>body:not(:has(#all:checked)) tbody {behind} {{ display: none; }}</style>'
    yield '<div class="scroll"><table><thead><tr>'
    yield f'<th scope="col" data-kind="text">{what}</th>'
    for name in ('odd', *chain.from_iterable(map(_heads, columns))):
        yield f'<th scope="col" data-kind="number">{name}</th>'
    yield '<th scope="col" data-kind="text">done</th>'
    yield '</tr></thead><tbody>'
    folder = '/' if what == 'recording' else ''
    for row, drive in enumerate(found):
        links = _links(drive, folder, has_report=drive.output in reports)
        cells = _cells(drive, columns, colours, highest, links)
        yield f'<tr id="r{row}">{"".join(cells)}</tr>'
    yield '</tbody></table></div>'


def _heads(column: Column) -> tuple[str, ...]:
    """Name what stands above a column; behind what is rejected there is who rejected it."""
    return (column.name, 'by detector') if column is REJECTED else (column.name,)


def _links(drive: DriveCounts, folder: str, *, has_report: bool) -> str:
    """Lead to the output, and to the report on it, which lie beside the page."""
    if not drive.done:
        return ''
    address = f'./{quote(drive.output)}'
    found = f' <a href="{address}{folder}">output</a>'
    return f'{found} <a href="{address}{REPORT}">report</a>' if has_report else found


def _cells(
    drive: DriveCounts,
    columns: Sequence[Column],
    colours: Mapping[str, str],
    highest: float,
    links: str,
) -> Iterator[str]:
    name = escape(drive.source)
    folder, slash, last = map(escape, drive.source.rstrip('/').rpartition('/'))
    kind = 'failed' if drive.failed else 'odd' if drive.done else 'plain'
    lines = [drive.error] if drive.error else drive.odd
    notes = ''.join(
        f'<small class="{kind}" tabindex="0" title="{escape(line)}">'
        f'{_unbroken(escape(line))}</small>'
        for line in lines
    )
    yield f'<th scope="row" data-sort="{name}">{folder}{slash}<b>{last}</b>{links}{notes}</th>'
    when = escape(drive.finished)
    done = f'<td data-sort="{when}" title="{when}">{when[:10]}</td>'
    if not drive.done:
        text, sort = ('failed', 'inf') if drive.failed else ('no clouds', '-1')
        yield f'<td class="{kind}" data-sort="{sort}">{text}</td>'
        yield from ['<td></td>'] * (len(columns) + 1)  # one more says by whom
        yield done
        return
    mark = ' class="odd"' if abs(drive.z) >= LIMIT else ''
    yield f'<td{mark} data-sort="{abs(drive.z)}">{signed(drive.z)}</td>'
    for column in columns:
        value = column.value(drive)
        yield f'<td data-sort="{value}">{column.text(value)}</td>'
        if column is REJECTED:
            yield f'<td data-sort="{value}">{_bar(drive, colours, highest)}</td>'
    yield done


def _unbroken(line: str) -> str:
    """Keep a number and its sign on one line."""
    return line.replace(' %', '\N{NO-BREAK SPACE}%').replace('(z ', '(z\N{NO-BREAK SPACE}')


def _bar(drive: DriveCounts, colours: Mapping[str, str], highest: float) -> str:
    """Draw the share of each detector; where several reject a point, their parts are scaled."""
    total = sum(drive.rejected_by.values())
    parts = [
        f'<i style="width:{100 * share(count, total):.1f}%;background:{colours[name]}" '
        f'title="{escape(name)} {percent(share(count, drive.points))}"></i>'
        for name, count in sorted(drive.rejected_by.items())
    ]
    width = 100 * min(1.0, rejected(drive) / highest)
    return f'<span class="bar"><span style="width:{width:.1f}%">{"".join(parts)}</span></span>'


def _explanation(done: int, what: str) -> Iterator[str]:
    least, compared = f'{percent(LEAST_OF_POINTS)} of the points', ''
    lacking = 'It is odd, too, if none of its points could be tested. '
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


def size(count: float) -> str:
    """Write a number of bytes with three digits that count."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:  # noqa: PLR2004  the step between units
            return f'{count:.3g} {unit}'
        count /= 1000
    return f'{count:.3g} TB'
