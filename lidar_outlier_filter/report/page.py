# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page: one file with all its data, that needs no network."""

from __future__ import annotations

import base64
import html
import json
from importlib.resources import files
from typing import TYPE_CHECKING

from lidar_outlier_filter.disk.new_files import new_output
from lidar_outlier_filter.report.frames import cut
from lidar_outlier_filter.report.header import header, split
from lidar_outlier_filter.report.pack import pack

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lidar_outlier_filter.report.gather import Gathered

# The modules of the page by the names that they import each other by. A served page maps the same
# names to addresses.
MODULES = {
    name: f'{name}.js'
    for name in (
        *('three', 'data', 'shaders', 'slices', 'scene', 'flat', 'map', 'overlay', 'scale'),
        *('charts', 'panel', 'colours', 'groups', 'keys', 'stage', 'tools', 'address'),
    )
}
START = 'main.js'


def asset(name: str) -> str:
    """Read a file of the page."""
    return (files(__package__) / 'assets' / name).read_text(encoding='utf-8')


def buffers(gathered: Gathered) -> tuple[str, dict[str, bytes]]:
    """Make the data of a page: the header as JSON, and the buffers by name."""
    frames = cut(gathered)
    packed = pack(gathered, frames)
    known = header(gathered, frames, packed)
    known['colours'] = colour_maps()
    parts = {'reasons': packed.reasons.astype('<f4').tobytes()}
    for number, (begin, end) in enumerate(split(frames)):
        words = packed.points[frames.first[begin] : frames.first[end]]
        parts[f'points-{number}'] = words.astype('<u4').tobytes()
    return json.dumps(known, separators=(',', ':'), allow_nan=False), parts


def page(gathered: Gathered) -> str:
    """Make a page that holds all of it."""
    known, parts = buffers(gathered)
    # In a script element nothing but its end has a meaning.
    safe = known.replace('<', '\\u003c')
    data = [f'<script type="application/json" id="header">{safe}</script>']
    for name, content in parts.items():
        text = base64.b64encode(content).decode('ascii')
        data.append(f'<script type="text/plain" id="data-{name}">{text}</script>')
    return shell(gathered.name, _inlined(), _inline(asset(START)), '\n'.join(data))


def live_page(name: str) -> str:
    """Make the page of a node that runs, which fetches its clouds."""
    whole = asset('live.html')
    return shell(name, _inlined(), _inline(asset('live.js')), whole=whole)


def shell(  # noqa: PLR0913  what a page is made of
    title: str,
    modules: Mapping[str, str],
    start: str,
    data: str = '',
    base: str = '',
    *,
    whole: str = '',
) -> str:
    """Make the page around its data.

    Parameters
    ----------
    title : of the page
    modules : addresses of ``MODULES``, by their names
    start : address of the module that starts the page
    data : elements with the header and the buffers
    base : address that they are fetched from, where the page does not hold them
    whole : the text with marks; default: that of a recording's page

    """
    whole = whole or asset('page.html')
    for mark, text in (
        ('<!--head-->\n', asset('head.html')),
        ('<!--view-->\n', asset('view.html')),
        ('<!--title-->', html.escape(title)),
        ('<!--base-->', f' data-base="{html.escape(base)}"' if base else ''),
        ('<!--style-->', f'<style>{asset("style.css")}</style>'),
        ('<!--licence-->', f'<!--\n{asset("three.LICENSE")}\n-->'),
        ('<!--imports-->', f'<script type="importmap">{json.dumps({"imports": modules})}</script>'),
        ('<!--start-->', f'<script type="module" src="{html.escape(start)}"></script>'),
        ('<!--data-->', data),
    ):
        whole = whole.replace(mark, text)
    return whole


def write_page(gathered: Gathered, output: Path) -> None:
    """Write the page to a new file, whole or not at all.

    Raises
    ------
    RecordingError
        If the file exists, or cannot be written.

    """
    with new_output(output) as built:
        built.write_text(page(gathered), encoding='utf-8')


def _inlined() -> dict[str, str]:
    return {name: _inline(asset(path)) for name, path in MODULES.items()}


def _inline(code: str) -> str:
    return 'data:text/javascript;base64,' + base64.b64encode(code.encode()).decode('ascii')


def colour_maps() -> dict[str, str]:
    """Give maps of 256 colours as base64, three bytes each."""
    maps: dict[str, str] = json.loads(asset('colour_maps.json'))
    return maps
