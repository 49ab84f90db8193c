# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of an archive: which of its recordings or files were odd.

One file that loads nothing; its table works without scripts.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from lidar_outlier_filter.archive.locations import exists, foreign, read_all
from lidar_outlier_filter.archive.publish import workshop
from lidar_outlier_filter.archive.rows import (
    LIMIT,
    MIN_COMPARED,
    MIN_OF_CLOUDS,
    MIN_OF_POINTS,
    OF_FILES,
    OF_RECORDINGS,
    REJECTED,
    SIGMA,
    ArchiveRow,
    Column,
    compare,
    length,
    percent,
    share,
    signed,
)
from lidar_outlier_filter.archive.sidecar import ArchiveRecord
from lidar_outlier_filter.disk.new_files import writable
from lidar_outlier_filter.errors import printable
from lidar_outlier_filter.recordings.remote_path import RecordingPath

PAGE = 'archive.html'
MARK = '<meta name="generator" content="lidar_outlier_filter {}">'
_OPEN, _SEAL_LENGTH = MARK.partition('{}')[0], 64
MAX_BARS = 400
HEIGHT, BELOW = 60, 6  # of the chart: above its line, and below it, where failed recordings are
MAX_SHOWN = 1000  # rows at first: ten times as many take a browser seconds
MAX_NAMED = 3  # versions and parameters
REPORT = '_report.html'  # after the name of an output: the page of `report`
# From Okabe and Ito: distinct for the colour-blind, on light and dark.
COLOURS = ('#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#b8a900')


def check_page(folder: RecordingPath) -> str:
    """Return the page of an earlier run; '' if it does not exist."""
    path = folder / PAGE
    if not exists(path):
        return ''
    data = read_all([path])[0] if path.is_file() else b''
    text = data.decode(errors='replace')
    before, mark, after = text.partition(_OPEN)
    bare = before + mark + after[_SEAL_LENGTH:]
    if not mark or sha256(bare.encode()).hexdigest() != after[:_SEAL_LENGTH]:
        raise foreign(path)
    return text


def write_page(
    records: Iterable[ArchiveRecord], folder: RecordingPath, what: str = 'recording'
) -> None:
    """Write the page for records into the folder of their outputs, which is locked.

    An earlier page is replaced.

    Parameters
    ----------
    records : in any order
    folder : of the outputs
    what : ``recording``, or ``file`` if each is one cloud

    """
    found = sorted(records, key=lambda record: record.source)
    reports: set[str] = set()
    if isinstance(folder, Path):
        reports = {one.output for one in found if (folder / f'{one.output}{REPORT}').is_file()}
    text, before = page(found, what, reports), check_page(folder)
    if text == before:
        return
    path = folder / PAGE
    if isinstance(path, Path):
        with writable(path), workshop(folder) as built:
            Path(built, PAGE).write_text(text, 'utf-8')
            Path(built, PAGE).replace(path)
    else:
        path.write_text(text)


def page(
    records: Iterable[ArchiveRecord], what: str = 'recording', reports: Collection[str] = ()
) -> str:
    """Make the page for records; ``reports`` are the outputs that have one."""
    rows = compare(records)
    names = sorted({name for row in rows for name in row.rejected_by})
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    done = [row for row in rows if row.record.is_done]
    text = '\n'.join(
        [
            '<!DOCTYPE html>',
            '<html lang="en"><head><meta charset="utf-8">',
            MARK.format(''),
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<title>Archive</title>',
            f'<style>{_asset("page.css")}</style></head><body>',
            f'<h1>{len(rows):,} {what}{"" if len(rows) == 1 else "s"}</h1>',
            *_made_by(done),
            *_totals(rows, done, colours, what),
            *_chart(rows, what),
            *_table(rows, colours, what, reports),
            *_explanation(len(done), what),
            f'<script>{_asset("page.js")}</script></body></html>',
            '',
        ]
    )
    return text.replace(_OPEN, _OPEN + sha256(text.encode()).hexdigest(), 1)


def _asset(name: str) -> str:
    return (files(__package__) / 'assets' / name).read_text(encoding='utf-8')


def _safe(text: str) -> str:
    """Escape a text; names of files may be any bytes."""
    return escape(printable(text))


def _made_by(done: Sequence[ArchiveRow]) -> Iterator[str]:
    """Say when, and by which versions and parameters outputs were made, the most frequent first."""
    runs = Counter(f'{one.record.code}, parameters {one.record.parameters[:12]}' for one in done)
    days = sorted(row.record.finished[:10] for row in done)
    texts = [
        text + f' ({count:,})' * (len(runs) > 1) for text, count in runs.most_common(MAX_NAMED)
    ]
    if len(runs) > MAX_NAMED:
        texts.append(f'{len(runs) - MAX_NAMED} others')
    if days:
        span = days[0] if days[0] == days[-1] else f'{days[0]} to {days[-1]}'
        said = escape(f'done {span}, by version {"; ".join(texts)}')
        yield f'<p class="note">{said}</p>'


def _totals(
    rows: Sequence[ArchiveRow], done: Sequence[ArchiveRow], colours: Mapping[str, str], what: str
) -> Iterator[str]:
    sums = sum((row.sums for row in done), Counter())
    points, refused = sums['points'], sums['refused']
    failed, odd = sum(row.record.is_failed for row in rows), sum(bool(row.odd) for row in done)
    empty = len(rows) - len(done) - failed
    seconds, duration = (
        sum(getattr(row.record, name) for row in done) for name in ('seconds', 'duration')
    )
    recorded = what == 'recording'  # a file is one cloud without a length
    values = [
        ('failed', f'{failed:,}', failed, True),
        ('without clouds', f'{empty:,}', 0, empty > 0),
        ('odd', f'{odd:,}', odd, True),
        ('length', length(duration), 0, recorded),
        ('size', size(sum(row.record.size for row in rows)), 0, True),
        ('clouds', f'{sums["messages"]:,}', 0, recorded),
        ('clouds refused', f'{refused:,}', refused, recorded),
        ('points', f'{points:,}', 0, True),
        ('points rejected', percent(share(sums['rejected'], points)), 0, True),
        ('points untested', percent(share(sums['untested'], points)), 0, True),
        ('× real time', f'{share(duration, seconds):.1f}', 0, recorded),
    ]
    yield '<dl class="totals">'
    for name, text, warns, is_shown in values:
        if is_shown:
            mark = ' class="warn"' if warns else ''
            yield f'<div{mark}><dt>{name}</dt><dd>{text}</dd></div>'
    yield '</dl>'
    by = sum((row.rejected_by for row in done), Counter())
    yield '<p class="key">Rejected by '
    for name, colour in colours.items():
        box = f'<i style="background:{colour}"></i>'
        yield f'<span>{box}{_safe(name)} {percent(share(by[name], points))}</span> '
    yield '</p>'


def _chart(rows: Sequence[ArchiveRow], what: str) -> Iterator[str]:
    """Draw a bar for each row, or for several, by name; each links to its row."""
    if not rows:
        return
    order = sorted(range(len(rows)), key=lambda number: rows[number].record.source)
    each = -(-len(order) // MAX_BARS)
    highest = max(REJECTED.value(row) for row in rows) or 1
    numbers, bars = iter(order), []
    while group := list(islice(numbers, each)):
        bars.append(max(group, key=lambda n: (rows[n].record.is_failed, REJECTED.value(rows[n]))))
    yield '<figure>'
    box = f'viewBox="0 0 {len(bars)} {HEIGHT + BELOW}"'
    yield f'<svg {box} preserveAspectRatio="none" role="img">'
    yield '<title>Share of the points rejected</title>'
    yield f'<line x2="{len(bars)}" y1="{HEIGHT}" y2="{HEIGHT}"/>'
    for x, number in enumerate(bars):
        row = rows[number]
        high = max(1.0, HEIGHT * REJECTED.value(row) / highest)
        top = HEIGHT - high
        if row.record.is_failed:
            top, high = HEIGHT + 1, BELOW - 1
        kind = 'failed' if row.record.is_failed else 'odd' if row.odd else 'plain'
        title = f'{row.record.source}: {row.record.error or percent(REJECTED.value(row))}'
        yield (
            f'<a href="#r{number}"><rect class="{kind}" x="{x + 0.1}" y="{top:.1f}" '
            f'width="0.8" height="{high:.1f}"><title>{_safe(title)}</title></rect></a>'
        )
    text = f'the largest of {each} {what}s each' if each > 1 else f'one {what} each'
    yield '</svg>'
    yield (
        f'<figcaption>Share of the points rejected, by name of the {what}, {text}; the highest '
        f'bar is {percent(highest)}. <i class="plain"></i>usual <i class="odd"></i>odd '
        '<i class="failed"></i>failed: below the line, without a share</figcaption></figure>'
    )


def _table(
    rows: Sequence[ArchiveRow], colours: Mapping[str, str], what: str, reports: Collection[str]
) -> Iterator[str]:
    highest = max((REJECTED.value(row) for row in rows if row.record.is_done), default=0) or 1
    columns = OF_RECORDINGS if what == 'recording' else OF_FILES
    if len(rows) > MAX_SHOWN:
        text = f'show all {len(rows):,}, not only the first {MAX_SHOWN:,}'
        yield f'<label class="note"><input type="checkbox" id="all"> {text}</label>'
        behind = f'tr:nth-child(n+{MAX_SHOWN + 1}):not(:target)'
        yield f'<style>body:not(:has(#all:checked)) tbody {behind} {{ display: none; }}</style>'
    heads = [name for one in columns for name in (one.name, *['by detector'] * (one is REJECTED))]
    yield '<div class="scroll"><table><thead><tr>'
    for name in (what, 'odd', *heads, 'done'):
        kind = 'text' if name in (what, 'done') else 'number'
        yield f'<th scope="col" data-kind="{kind}">{name}</th>'
    yield '</tr></thead><tbody>'
    for number, row in enumerate(rows):
        cells = ''.join(_cells(row, columns, colours, highest))
        head = _head(row, '/' if what == 'recording' else '', reports)
        yield f'<tr id="r{number}">{head}{cells}</tr>'
    yield '</tbody></table></div>'


def _head(row: ArchiveRow, ending: str, reports: Collection[str]) -> str:
    """Name a row, with links to its output and report, and what is odd about it."""
    record, links = row.record, ''
    if record.is_done:
        address = f'./{quote(record.output, errors="surrogateescape")}'
        links = f' <a href="{address}{ending}">output</a>'
        if record.output in reports:
            links += f' <a href="{address}{REPORT}">report</a>'
    kind = 'failed' if record.is_failed else 'odd' if record.is_done else 'plain'
    notes = ''.join(
        f'<small class="{kind}" tabindex="0" title="{_safe(line)}">{_unbroken(_safe(line))}</small>'
        for line in ([record.error] if record.error else row.odd)
    )
    name = _safe(record.source)
    folder, slash, last = name.rpartition('/')
    return f'<th scope="row" data-sort="{name}">{folder}{slash}<b>{last}</b>{links}{notes}</th>'


def _cells(
    row: ArchiveRow, columns: Sequence[Column], colours: Mapping[str, str], highest: float
) -> Iterator[str]:
    if row.record.is_done:
        mark = ' class="odd"' if abs(row.z) >= LIMIT else ''
        yield f'<td{mark} data-sort="{abs(row.z)}">{signed(row.z)}</td>'
        for column in columns:
            value = column.value(row)
            yield f'<td data-sort="{value}">{column.text(value)}</td>'
            if column is REJECTED:
                yield f'<td data-sort="{value}">{_bar(row, colours, highest)}</td>'
    else:
        kind, text, sort = (
            ('failed',) * 2 + ('inf',) if row.record.is_failed else ('plain', 'no clouds', -1)
        )
        yield f'<td class="{kind}" data-sort="{sort}">{text}</td>'
        yield '<td></td>' * (len(columns) + 1)  # and that of the bars
    when = escape(row.record.finished)
    yield f'<td data-sort="{when}" title="{when}">{when[:10]}</td>'


def _unbroken(line: str) -> str:
    """Keep a number and its sign on one line."""
    return line.replace(' %', '\N{NO-BREAK SPACE}%').replace('(z ', '(z\N{NO-BREAK SPACE}')


def _bar(row: ArchiveRow, colours: Mapping[str, str], highest: float) -> str:
    """Draw the share of each detector, scaled where several reject the same points."""
    total = sum(row.rejected_by.values())
    parts = [
        f'<i style="width:{100 * share(count, total):.1f}%;background:{colours[name]}" '
        f'title="{_safe(name)} {percent(share(count, row.sums["points"]))}"></i>'
        for name, count in sorted(row.rejected_by.items())
    ]
    width = 100 * min(1.0, REJECTED.value(row) / highest)
    return f'<span class="bar"><span style="width:{width:.1f}%">{"".join(parts)}</span></span>'


def _explanation(done: int, what: str) -> Iterator[str]:
    least, compared = f'{percent(MIN_OF_POINTS)} of the points', ''
    lacking = 'It is also odd if none of its points could be tested. '
    if what == 'recording':
        least += f' or {percent(MIN_OF_CLOUDS)} of the clouds'
        compared = ', and of clouds after a gap'
        lacking = (
            'It is also odd if clouds were refused, no point of a topic could be tested, or '
            'messages are missing. '
        )
    yield (
        f'<p class="note">A {what} is odd if a share of it is {LIMIT:g} or more robust z from '
        f'the median of all {what}s: (share − median) / ({SIGMA:g} × the median absolute '
        f'deviation, at least {least}). Compared are the shares of points rejected, '
        f'rejected by each detector and untested{compared}. {lacking}'
        'The column “odd” has the largest z.</p>'
    )
    if done < MIN_COMPARED:
        yield f'<p class="note">Fewer than {MIN_COMPARED} {what}s are done: none is compared.</p>'


def size(count: float) -> str:
    """Write a number of bytes with three significant digits."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:  # noqa: PLR2004  the step between units
            return f'{count:.3g} {unit}'
        count /= 1000
    return f'{count:.3g} TB'
