# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables for a page that people write in as well: what is generated stands between markers."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from lidar_outlier_filter.core.annotations import Bools
from lidar_outlier_filter.disk.new_files import replaced
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.report import percent

NOTHING = '–'
COMMAND = 'lidar-outlier-filter results'


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table whose first column is a text and all others are numbers."""
    aligned = ['---', *('---:' for _ in head[1:])]
    return '\n'.join('| ' + ' | '.join(row) + ' |' for row in (head, aligned, *rows))


def paragraphs(*parts: str) -> str:
    """Put parts below each other, an empty line between; empty parts are left out."""
    return '\n\n'.join(part for part in parts if part)


def folded(title: str, text: str) -> str:
    """Hide a long text behind its title."""
    return f'<details><summary>{title}</summary>\n\n{text}\n\n</details>'


def number(value: float, decimals: int = 3) -> str:
    """Write a number; a dash without one."""
    return NOTHING if math.isnan(value) else f'{value:.{decimals}f}'


def share_of(some: Bools) -> str:
    """Write the share of points that a mask chooses."""
    return percent(float(some.mean()))


def image(name: str, text: str) -> str:
    """Show a picture of the folder ``images`` beside the page."""
    return f'![{text}](images/{name})'


def begin_of(section: str, command: str = COMMAND) -> str:
    """Return the marker above a section."""
    return f'<!-- begin {section}: written by `{command}`, do not edit -->'


def end_of(section: str) -> str:
    """Return the marker below a section."""
    return f'<!-- end {section} -->'


def put(page: str, section: str, text: str, command: str = COMMAND) -> str:
    """Return a page with the text of one section replaced; what is new stands at its end.

    The markers name the command that writes the section.

    Raises
    ------
    RecordingError
        If only one of the section's two markers is there, or they are in the wrong order.

    """
    begin, end = begin_of(section, command), end_of(section)
    block = f'{begin}\n\n{text.strip()}\n\n{end}\n'
    first, last = page.find(begin), page.find(end)
    if first == last == -1:
        return f'{page.rstrip()}\n\n{block}' if page.strip() else block
    if not -1 < first < last:
        must_be = f'both, or neither, and in this order: {begin} {end}'
        raise RecordingError(f'the markers of {section}', must_be, 'others')
    return page[:first] + block + page[last + len(end) :].removeprefix('\n')


def write_row(path: Path, section: str, row: Sequence[str], command: str) -> None:
    """Put a row into the table of a section, in place of the row with the same first cell."""
    page = path.read_text(encoding='utf-8')
    found = page.partition(begin_of(section, command))[2].partition(end_of(section))[0]
    lines = found.strip().splitlines()
    line = f'| {" | ".join(row)} |'.replace('|  |', '| |')
    same = [i for i, old in enumerate(lines) if old.startswith(f'| {row[0]} |')]
    if same:
        lines[same[0]] = line
    else:
        lines.append(line)
    write(path, section, '\n'.join(lines), command=command)


def write(
    path: Path, section: str, text: str, pictures: Iterable[Path] = (), command: str = COMMAND
) -> None:
    """Put a section into a page, and its pictures into ``images`` beside it; make what is missing.

    Raises
    ------
    RecordingError
        If the page cannot be read or written, or its markers are broken.

    """
    try:
        page = path.read_text(encoding='utf-8') if path.exists() else ''
        page = put(page, section, text, command)
        images = path.parent / 'images'
        images.mkdir(parents=True, exist_ok=True)
        for picture in pictures:
            with replaced(images / picture.name) as built:
                built.write_bytes(picture.read_bytes())
        with replaced(path) as built:
            built.write_bytes(page.encode())
    except (OSError, UnicodeDecodeError) as err:
        raise RecordingError(f'the page {path}', 'readable and writable', err) from err
