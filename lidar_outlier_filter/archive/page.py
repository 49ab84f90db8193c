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
from lidar_outlier_filter.disk.new_files import replaced

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.archive.columns import Column

BARS = 400  # at most, in the picture over the table
HEIGHT = 60  # of the picture
# Sums that files have not: each is one cloud.
OF_RECORDINGS = ('length', 'clouds', 'clouds refused', '× real time')
# Of Okabe and Ito: different for the colour-blind too, on light and on dark ground.
COLOURS = ('#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#b8a900')
STYLE = """
:root { color-scheme: light dark; --ground: #fff; --text: #1b1b1b; --soft: #5c5c5c;
  --line: #d8d8d8; --stripe: #f5f6f7; --odd: #b34a00; --failed: #8a1c5b; --plain: #6f9ec4; }
@media (prefers-color-scheme: dark) { :root { --ground: #16181b; --text: #e8e8e8; --soft: #a9adb3;
  --line: #3a3e44; --stripe: #1e2125; --odd: #ffa45c; --failed: #f08cc0; --plain: #4f7ea6; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 90rem; padding: 1rem; background: var(--ground);
  color: var(--text); font: 15px/1.4 system-ui, sans-serif; }
h1 { font-size: 1.4rem; margin: 0 0 .8rem; }
.totals { display: grid; grid-template-columns: repeat(auto-fit, minmax(12rem, 1fr)); gap: .5rem;
  margin: 0; }
.totals div { border: 1px solid var(--line); border-radius: .4rem; padding: .4rem .6rem; }
.totals .warn dd { color: var(--odd); }
dt, small, figcaption, .note, .key { color: var(--soft); font-size: .85rem; }
dd { margin: 0; font-size: 1.15rem; font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
figure { margin: 1rem 0; }
svg { display: block; width: 100%; height: 5rem; border-bottom: 1px solid var(--line); }
rect.plain, i.plain { fill: var(--plain); background: var(--plain); }
rect.odd, i.odd { fill: var(--odd); background: var(--odd); }
rect.failed, i.failed { fill: var(--failed); background: var(--failed); }
i.plain, i.odd, i.failed, .key i { display: inline-block; width: .8em; height: .8em;
  margin: 0 .3em 0 .6em; border-radius: .15em; vertical-align: -.05em; }
.key span { white-space: nowrap; }
.scroll { overflow-x: auto; border: 1px solid var(--line); border-radius: .4rem; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: .35rem .6rem; text-align: right; vertical-align: top;
  font-variant-numeric: tabular-nums; white-space: nowrap; font-weight: normal; }
th:first-child { text-align: left; position: sticky; left: 0; background: inherit;
  min-width: 20rem; white-space: normal; overflow-wrap: anywhere; }
thead tr { background: var(--ground); }
thead th { border-bottom: 2px solid var(--line); font-weight: 600; }
tbody tr { background: var(--ground); }
tbody tr:nth-child(even) { background: var(--stripe); }
tbody tr:target { outline: 2px solid var(--odd); outline-offset: -2px; }
th b { font-weight: 600; }
th small { display: block; margin-top: .15rem; line-height: 1.25; }
th small.odd { color: var(--odd); }
th small.failed { color: var(--failed); }
td.odd { color: var(--odd); font-weight: 600; }
td.failed { color: var(--failed); font-weight: 600; }
thead button { all: unset; cursor: pointer; font-weight: 600; }
thead button:focus-visible { outline: 2px solid var(--odd); outline-offset: 2px; }
thead button::after { content: ' ↕'; color: var(--soft); }
th[aria-sort=ascending] button::after { content: ' ↑'; color: inherit; }
th[aria-sort=descending] button::after { content: ' ↓'; color: inherit; }
.bar { display: block; width: 6rem; height: 1em; margin-top: .2em; background: var(--line); }
.bar span { display: flex; height: 100%; min-width: 1px; }
.bar i { height: 100%; }
@media (min-width: 60rem) { .totals { grid-template-columns: repeat(5, 1fr); } }
@media (min-width: 84rem) { .scroll { overflow-x: visible; }
  thead th { position: sticky; top: 0; background: var(--ground); z-index: 1; } }
@media (max-width: 40rem) { body { padding: .6rem; } th:first-child { min-width: 9rem;
  max-width: 45vw; }
  .totals { grid-template-columns: repeat(2, 1fr); } }
"""
# Buttons in the heads sort the rows; numbers from the largest, at first.
SCRIPT = """
const body = document.querySelector('tbody');
const heads = [...document.querySelectorAll('thead th')];
heads.forEach((head, column) => {
  const button = document.createElement('button');
  button.append(...head.childNodes);
  head.append(button);
  const number = head.dataset.kind === 'number';
  const value = row => {
    const text = row.cells[column].dataset.sort;
    return !number ? text : text === undefined ? -1 : text === 'inf' ? Infinity : Number(text);
  };
  button.addEventListener('click', () => {
    const before = head.getAttribute('aria-sort');
    const up = before ? before === 'descending' : !number;
    heads.forEach(other => other.removeAttribute('aria-sort'));
    head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
    const compare = (a, b) => a < b ? -1 : a > b ? 1 : 0;
    body.append(...[...body.rows].sort(
      (a, b) => (up ? 1 : -1) * compare(value(a), value(b))));
  });
});
"""


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


def _table(found: Sequence[DriveCounts], colours: Mapping[str, str], what: str) -> Iterator[str]:
    highest = max((rejected(drive) for drive in found if drive.done), default=0) or 1
    columns = [column for column in COLUMNS if column.is_of(what)]
    yield '<div class="scroll"><table><thead><tr>'
    yield f'<th scope="col" data-kind="text">{what}</th>'
    for name in ('odd', *chain.from_iterable(map(_heads, columns))):
        yield f'<th scope="col" data-kind="number">{name}</th>'
    yield '</tr></thead><tbody>'
    for row, drive in enumerate(found):
        cells = _cells(drive, columns, colours, highest)
        yield f'<tr id="r{row}">{"".join(cells)}</tr>'
    yield '</tbody></table></div>'


def _heads(column: Column) -> tuple[str, ...]:
    """Name what stands above a column; behind what is rejected there is who rejected it."""
    return (column.name, 'by detector') if column is REJECTED else (column.name,)


def _cells(
    drive: DriveCounts, columns: Sequence[Column], colours: Mapping[str, str], highest: float
) -> Iterator[str]:
    name = escape(drive.source)
    last = escape(drive.source.rstrip('/').rpartition('/')[2])
    kind = 'failed' if drive.failed else 'odd' if drive.done else 'plain'
    lines = [drive.error] if drive.error else drive.odd
    notes = ''.join(f'<small class="{kind}">{_unbroken(escape(line))}</small>' for line in lines)
    yield f'<th scope="row" title="{name}" data-sort="{name}"><b>{last}</b>{notes}</th>'
    if not drive.done:
        text, sort = ('failed', 'inf') if drive.failed else ('no clouds', '-1')
        yield f'<td class="{kind}" data-sort="{sort}">{text}</td>'
        yield from ['<td></td>'] * (len(columns) + 1)  # one more says by whom
        return
    mark = ' class="odd"' if abs(drive.z) >= LIMIT else ''
    yield f'<td{mark} data-sort="{abs(drive.z)}">{signed(drive.z)}</td>'
    for column in columns:
        value = column.value(drive)
        yield f'<td data-sort="{value}">{column.text(value)}</td>'
        if column is REJECTED:
            yield f'<td data-sort="{value}">{_bar(drive, colours, highest)}</td>'


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


def size(count: float) -> str:
    """Write a number of bytes with three digits that count."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:  # noqa: PLR2004  the step between units
            return f'{count:.3g} {unit}'
        count /= 1000
    return f'{count:.3g} TB'
