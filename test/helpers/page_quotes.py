# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What pages quote, and where it comes from; as a program it rewrites the quotations.

``cd test && python -m helpers.page_quotes`` writes all. With names of sources, it writes theirs
only.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from helpers import ROOT, page_sources
from helpers.page_runs import Pages
from helpers.page_sources import REPLAY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    Figures = Mapping[str, str]
    Source = Callable[[Pages], Figures]

# Rows of a table that the machine decides.
MACHINE = re.compile(r'.*(points per second|× real time).*')
NAMED = re.compile(r'\{([\w -]+)\}')


@dataclass(frozen=True)
class Quote:
    """A stretch of a page, with the names of figures in braces where it quotes them.

    A blank of the text is any white space of the page.
    """

    page: str
    text: str

    def search(self) -> re.Match[str]:
        """Find the stretch, which must be on its page exactly once."""
        parts = NAMED.split(self.text)
        words = (r'\s+'.join(map(re.escape, re.split(r'\s+', part))) for part in parts[::2])
        pattern = '(.*?)'.join(words)
        found = list(re.finditer(pattern, (ROOT / self.page).read_text('utf-8'), re.DOTALL))
        assert len(found) == 1, f'{self.page} must have once, got {len(found)} times: {self.text}'
        return found[0]

    @property
    def names(self) -> list[str]:
        """Name the figures, in their order."""
        return NAMED.findall(self.text)

    def quoted(self) -> list[str]:
        """Return what the page has where figures are."""
        return [steady(text) for text in self.search().groups()]

    def expected(self, figures: Figures) -> list[str]:
        """Return what it should have."""
        return [steady(figures[name]) for name in self.names]

    def write(self, figures: Figures) -> None:
        """Put the figures into the page."""
        match = self.search()
        page = match.string
        for index, name in reversed(list(enumerate(self.names, 1))):
            text = with_speeds_of(match[index], figures[name])
            page = page[: match.start(index)] + text + page[match.end(index) :]
        (ROOT / self.page).write_text(page, 'utf-8')


def with_speeds_of(old: str, new: str) -> str:
    """Keep the rows that depend on the machine as they were, where there are as many."""
    speeds = [line for line in old.splitlines() if MACHINE.fullmatch(line)]
    lines = new.splitlines()
    indices = [index for index, line in enumerate(lines) if MACHINE.fullmatch(line)]
    if len(indices) == len(speeds):
        for index, line in zip(indices, speeds, strict=True):
            lines[index] = line
    return '\n'.join(lines)


def steady(text: str) -> str:
    """Leave out what depends on the machine."""
    return '\n'.join(line.rstrip() for line in text.splitlines() if not MACHINE.fullmatch(line))


# All of it ----------------------------------------------------------------------------------------

START = 'doc/quickstart/'
LISTED = '## What you should see\n\n```text\n{above the table}\n```'
SENSORS = {
    'Velodyne VLP-16, a room': 'VLP-16',
    'Velodyne HDL-32E, outdoors': 'HDL-32E',
    'Velodyne VLP-32C, a hall': 'VLP-32C',
    'Ouster OS1-128, a street': 'OS1-128',
    'Ouster OS0-32': 'OS0-32',
    'Hesai XT32, an office': 'XT32',
    '`lidar_link`, 32 rings, a hall': 'lidar_link',
    'Hesai Pandar64, one sweep': 'Pandar64',
    'Hesai Pandar40P, one sweep': 'Pandar40P',
    'Robosense Helios, one sweep': 'Helios',
    'Robosense Ruby Plus, two sweeps': 'RubyPlus',
    'Robosense Bpearl, two sweeps': 'Bpearl',
}
ACCURACY = 'doc/accuracy.md'
STREET_ROWS = {
    'precision': 'precision',
    'recall': 'recall',
    'F1': 'F1',
    'good points lost': 'lost',
    '… of the road': 'road',
    '… of kerbs': 'kerb',
    '… of the sidewalk': 'sidewalk',
    '… of facades': 'facade',
    '… of poles': 'pole',
    'outliers found: reflections': 'reflection',
    '… exhaust': 'exhaust',
    '… barrier arm': 'barrier',
    '… near the surface': 'near surface',
    '… mixed pixels': 'mixed',
}
STREET_TABLE = [
    f'| {title} | {{paper {name} exactly}} | {{smoother {name} exactly}} '
    f'| {{default {name} exactly}} |'
    for title, name in STREET_ROWS.items()
]
SOURCES: Mapping[str, tuple[Source, Sequence[Quote]]] = {
    'trees': (
        page_sources.trees,
        [
            Quote(
                ACCURACY,
                'sensor left out | F1 | intensities hidden |\n| --- | ---: | ---: |\n{weather}\n\n'
                '**Weather that was not trained on.**',
            ),
            Quote(
                ACCURACY,
                'sweeps of twelve real sensors lose {least shipped} to {most shipped}, '
                'or {least left} to {most left} with trees',
            ),
            Quote(
                'doc/development/default.md',
                '`street-16` / `-32` / `-64` / `-128` |\n'
                '| --- |' + 11 * ' ---: |' + '\n'
                '{parts}\n\nThe worst sensor is the Ruby Plus',
            ),
            Quote(
                'README.md',
                'twelve real sensors: {least shipped} to {most shipped} of the points rejected, or '
                '{least left} to {most left} by trees that were not trained on the sensor.',
            ),
            *(
                Quote(
                    ACCURACY,
                    f'| {title} | {{left {name}}} | {{dark {name}}} | {{shipped {name}}} |',
                )
                for title, name in SENSORS.items()
            ),
        ],
    ),
    'ouster': (
        page_sources.output_of(f'{START}ouster.md', REPLAY),
        [Quote(f'{START}ouster.md', 'clouds of an OS1-128:\n\n```text\n{to the table}\n```')],
    ),
    'hesai': (
        page_sources.output_of(f'{START}hesai.md', REPLAY),
        [Quote(f'{START}hesai.md', LISTED)],
    ),
    'livox': (
        page_sources.output_of(f'{START}livox.md', REPLAY),
        [Quote(f'{START}livox.md', LISTED)],
    ),
    'robosense': (
        page_sources.output_of(f'{START}robosense.md', REPLAY),
        [Quote(f'{START}robosense.md', LISTED)],
    ),
    'velodyne': (
        page_sources.output_of(f'{START}velodyne.md', REPLAY),
        [Quote(f'{START}velodyne.md', LISTED)],
    ),
    'tune': (
        page_sources.output_of('doc/evaluate.md', 'lidar-outlier-filter tune my_drive'),
        [Quote('doc/evaluate.md', 'clouds of an HDL-32E outdoors:\n\n```text\n{all}\n```')],
    ),
    'street': (
        page_sources.street,
        [
            Quote(
                ACCURACY,
                'recesses, poles, parked cars and a barrier arm; {points} points,\n'
                '{outliers} ({share}) of them outliers. A profile scanner',
            ),
            Quote(
                ACCURACY, '`boosted_trees` |\n| --- | --- | --- | --- |\n' + '\n'.join(STREET_TABLE)
            ),
            Quote(
                'README.md',
                '| | default | `config/classic.yaml` |\n| --- | --- | --- |\n'
                '| reflections found | {default reflection} | {classic reflection} |\n'
                '| exhaust found | {default exhaust} | {classic exhaust} |\n'
                '| points near a surface found | {default near surface} '
                '| {classic near surface} |\n'
                '| mixed pixels at edges found | {default mixed} | {classic mixed} |\n'
                '| level barrier arm found | {default barrier} | {classic barrier} |\n'
                '| **good points lost** | **{default lost}** | **{classic lost}** |',
            ),
            Quote('README.md', 'above: F1 {default F1}, {default lost} good points lost.'),
            Quote(
                ACCURACY,
                'On the street of the demo F1 is {default F1}, recall {default recall}, and '
                '{default lost} good points',
            ),
        ],
    ),
    'snow': (
        page_sources.snow,
        [
            Quote(
                ACCURACY,
                'behind a car that whirls it up; {points} points, {outliers} ({share}) of them '
                'outliers. By the default:\n\n| | |\n| --- | --- |\n'
                '| precision | {precision exactly} |\n'
                '| recall | {recall exactly} |\n'
                '| F1 | {F1 exactly} |\n'
                '| snow | {snow exactly} |\n'
                '| spray | {spray exactly} |\n'
                '| mixed points | {mixed exactly} |\n'
                '| good points lost | {lost exactly} |',
            ),
        ],
    ),
}


def main(names: Iterable[str]) -> None:
    """Write what these sources give into the pages."""
    for name in names or SOURCES:
        source, quotes = SOURCES[name]
        with TemporaryDirectory() as folder:
            figures = source(Pages(Path(folder)))
        for quote in quotes:
            quote.write(figures)
        sys.stdout.write(f'{name}: {", ".join(sorted({quote.page for quote in quotes}))}\n')


if __name__ == '__main__':
    main(sys.argv[1:])
