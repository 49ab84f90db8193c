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

NAMED = re.compile(r'\{([^{}]+)\}')


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

    def expected(self, figures: Figures) -> list[str]:
        """Return what the page must have where figures are."""
        return [figures[name] for name in NAMED.findall(self.text)]

    def write(self, figures: Figures) -> None:
        """Put the figures into the page."""
        match = self.search()
        page = match.string
        for index, text in reversed(list(enumerate(self.expected(figures), 1))):
            page = page[: match.start(index)] + text + page[match.end(index) :]
        (ROOT / self.page).write_text(page, 'utf-8')


# All of it ----------------------------------------------------------------------------------------

ACCURACY = 'doc/accuracy.md'
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
FETCHED = {  # sensors whose sweeps are not among the project's recordings
    'Ouster OS0-128, streets and a field': 'OS0-128',
    'Ouster OS1-32, a street': 'OS1-32',
    'Ouster OS2-128, a street': 'OS2-128',
    'Ouster OS2-32, a street': 'OS2-32',
    'Hesai QT128, an office': 'QT128',
    'Hesai XT16, an office': 'XT16',
}
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
PRESETS = {
    'leslar-a': 'wet and cold street, dense exhaust',
    'leslar-b': 'wet street, scattered outliers, barrier arm',
    'leslar-c': 'dry street, points just above the road',
    'street-16': '16 rings, rain and spray',
    'street-32': '32 rings, snow',
    'street-64': '64 rings, rain',
    'street-128': '128 rings, rain and spray',
}
OTHERS = {
    'the default': 'F1/default',
    'DROR, tuned on each drive': 'best F1/sor as DROR',
    'range-scaled distance, tuned on each drive': 'best F1/sor as DSOR',
    '`sor`, tuned on each drive': 'best F1/sor',
    'Open3D SOR(20, 2.0)': 'F1/Open3D SOR(20, 2.0)',
    'Open3D radius(3, 0.5)': 'F1/Open3D radius(3, 0.5)',
    'scikit-learn LOF(20) > 1.2': 'F1/scikit-learn LOF(20) > 1.2',
}
CHAINS = {'the default': 'default', '`alpha_beta_gamma`': 'alpha_beta_gamma'}
CHAINS |= {'`quadric`': 'quadric', '`lof`': 'lof', '`sor`': 'sor', '`sor` as DROR': 'sor as DROR'}
CHAINS |= {'`hierarchical`': 'hierarchical', '`elevation`': 'elevation'}
BOTH, LOST = 'real_snow/Both returns', 'good points lost'
COUNTS = ('recall', 'precision', 'F1', LOST)
DRIVES = ('leslar-a', 'leslar-b', 'leslar-c', 'street-32')
THREE = 'alpha_beta_gamma, quadric, lof'
SWEEPS, DEMO = 'Sweeps of 128 × 1024', 'The demo'  # headings of doc/results/speed.md
RINGS = '128 rings, 10 Hz, 1.3 million points/s, blocks: auto'  # a row of doc/results/load.md
SPEEDS = {
    'spinning sensor, 128 × 1024': (SWEEPS, 'alpha_beta_gamma', ''),
    'spinning sensor, 64 × 2048': ('Sweeps of 64 × 2048', 'alpha_beta_gamma', ''),
    'profile scanner, 160 lines/s of 1000': (
        'A profile scanner of 160 lines × 1000 shots a second',
        '',
        '',
    ),
    'profile scanner, 200 lines/s of 1000': (DEMO, 'alpha_beta_gamma', THREE),
}
LIVOX = '{livox/Scanners without rings/scanner'
TROUBLE = 'doc/troubleshooting.md'
STRICTNESS = {'strict': 'strict', 'default': 'normal', 'careful': 'careful'}
MAKERS = {'VLP-16': 'Velodyne', 'HDL-32E': 'Velodyne', 'VLP-32C': 'Velodyne'}
MAKERS |= {'OS1-128': 'Ouster', 'XT32': 'Hesai'}
WEATHER = ('light snow', 'rain', 'fog', 'spray', 'dust')


def row(title: str, table: str, names: Iterable[str]) -> str:
    """Write a row of a page, whose cells are in a table of all results."""
    return f'| {title} | ' + ' | '.join(f'{{tables/{table}/{name}}}' for name in names) + ' |'


def speed_row(title: str, table: str, *names: str) -> str:
    """Write a row of speeds, Open3D's last."""
    every = (*names, 'Open3D: SOR(20, 2.0)')
    cells = (f'{{speed/{table}/{name}/2 cores}} ' if name else '' for name in every)
    return f'| {title} | ' + '| '.join(cells) + '|\n'


def strictness(form: str, scene: str) -> str:
    """Write what a threshold finds and loses in a scene."""
    return f'| {STRICTNESS[form]}, {scene} | {{{form} recall exactly}} | {{{form} lost}} |'


def of_peers(sensor: str) -> str:
    """Write the columns of LOF and SOR; dashes for sensors that they did not judge."""
    real = f'{{tables/Real clouds/sensor/{MAKERS.get(sensor)} {sensor}'
    return f'{real}/lof}} | {real}/sor}} |' if sensor in MAKERS else '– | – |'


def on_page(page: str, *texts: str) -> list[Quote]:
    """List what a page quotes."""
    return [Quote(page, text) for text in texts]


SOURCES: Mapping[str, tuple[Source, Sequence[Quote]]] = {
    'tables': (
        page_sources.tables,
        [
            *on_page(
                'README.md',
                f'both returns): F1 {{{BOTH}/default/F1}}, and {{{BOTH}/default/{LOST}}} of the '
                f'good points lost; DROR, tuned on the same labels: {{{BOTH}/DROR/F1}} and '
                f'{{{BOTH}/DROR/{LOST}}}. [Real',
                f'On two cores the default filters {{speed/{SWEEPS}/boosted_trees/2 cores}} '
                'million points/s of a sensor of 128 rings',
                f'clouds are published after {{load/Load/input/{RINGS}/p95}} (95th percentile',
            ),
            *on_page(
                ACCURACY,
                'birds, noise |\n| --- | ---: | ---: | ---: | ---: |\n{causes}\n\nPercent of',
                'F1 is {real_snow/In short/default/both returns} with dual returns',
                '**Simulated streets**: F1 {tables/The default/preset/street-16/F1} to '
                '{tables/The default/preset/leslar-a/F1}, above DROR',
                '\n'.join(
                    row(f'`{preset}` | {what}', f'The default/preset/{preset}', COUNTS)
                    for preset, what in PRESETS.items()
                ),
                '\n'.join(
                    row(title, f'The default/{name}', PRESETS) for title, name in OTHERS.items()
                ),
                f'sweeps of 128 × 1024 | {{speed/{SWEEPS}/boosted_trees/2 cores}} '
                f'({{speed/{SWEEPS}/boosted_trees/× Open3D}} × Open3D,',
            ),
            *on_page(
                f'{START}hesai.md',
                f'has an F1 of {{{BOTH}/default/F1}} with both, '
                'and {real_snow/Last return/default/F1} with the last',
            ),
            *on_page(
                'doc/real_snow.md',
                '| last return |\n| --- | ---: | ---: |\n{real_snow/In short}\n\n[Tables]',
            ),
            *on_page(
                f'{START}profile_scanner.md',
                'recall is {tables/The default/preset/leslar-b/recall}, and '
                f'{{tables/The default/preset/leslar-b/{LOST}}} of the good points are lost',
            ),
            *on_page(
                'doc/chains.md',
                '\n'.join(
                    row(title, f'All detectors/{name}', DRIVES) for title, name in CHAINS.items()
                ),
            ),
            *on_page(
                f'{START}livox.md',
                *(
                    f'| {scanner} | '
                    + ' | '.join(f'{LIVOX}/{scanner}, {kind}/free, F1}}' for kind in WEATHER)
                    + f' | {LIVOX}/{scanner}, dry air/free}} |'
                    for scanner in ('Mid-40', 'L2', 'like a Mid-360')
                ),
            ),
            *on_page(
                'doc/performance.md',
                *(
                    speed_row(title, table, 'boosted_trees', *names)
                    for title, (table, *names) in SPEEDS.items()
                ),
                f'up to {{speed/{DEMO}/{THREE}/2 cores}} million points',
            ),
        ],
    ),
    'files': (
        page_sources.files,
        [
            *on_page('README.md', 'A sweep beside a leafy tree lost {actual_scan share}. [How'),
            *on_page(ACCURACY, '`actual_scan` (32 rings), loses {actual_scan share}, most'),
            *on_page(
                'doc/files.md',
                '`autzen_trim.laz`, {autzen_trim points} points, {autzen_trim rejected} rejected',
                'one sweep, {source points} points, {source survey rejected} rejected with',
                'are recovered, and {source rejected} points are rejected.',
            ),
        ],
    ),
    'trees': (
        lambda pages: {**page_sources.tables(pages), **page_sources.trees(pages)},
        [
            *on_page(
                ACCURACY,
                'sensor left out | F1 | intensities hidden |\n| --- | ---: | ---: |\n{weather}\n\n'
                '**Weather that was not trained on.**',
                'sweeps of twelve real sensors lose {least shipped} to {most shipped}, '
                'of eighteen {least left} to {most left} with trees',
                *(
                    f'| {title} | {{left {name}}} | {{dark {name}}} | {{shipped {name}}} | '
                    + of_peers(name)
                    for title, name in SENSORS.items()
                ),
                *(
                    f'| {title} | {{left {name}}} | {{dark {name}}} | – | – | – |'
                    for title, name in FETCHED.items()
                ),
            ),
            *on_page(
                'doc/development/default.md',
                f'`street-16` / `-32` / `-64` / `-128` |\n| --- |{11 * " ---: |"}\n'
                '{parts}\n\nThe worst sensor is the Ruby Plus',
            ),
            *on_page(
                'README.md',
                'twelve real sensors: {least shipped} to {most shipped} of the points are '
                'rejected; of eighteen, {least left} to {most left} by models not trained on the '
                'sensor.',
            ),
            *on_page(
                f'{START}velodyne.md',
                '| VLP-16, a room | {shipped VLP-16} |\n'
                '| HDL-32E, outdoors | {shipped HDL-32E} |\n'
                '| VLP-32C, a hall | {shipped VLP-32C} |',
            ),
            *on_page(f'{START}hesai.md', 'the default rejects {shipped XT32} of the points'),
        ],
    ),
    'ouster': (
        page_sources.output_of(f'{START}ouster.md', REPLAY),
        [
            *on_page(
                f'{START}ouster.md',
                'clouds of an OS1-128:\n\n```text\n{to the speed}\n│ points per second ',
            ),
        ],
    ),
    **{
        name: (
            page_sources.output_of(f'{START}{name}.md', REPLAY),
            [Quote(f'{START}{name}.md', LISTED)],
        )
        for name in ('hesai', 'livox', 'robosense', 'velodyne')
    },
    'tune': (
        page_sources.output_of('doc/evaluate.md', 'lidar-outlier-filter tune my_drive'),
        [Quote('doc/evaluate.md', 'clouds of an HDL-32E outdoors:\n\n```text\n{all}\n```')],
    ),
    'street': (
        page_sources.street,
        [
            *on_page(
                ACCURACY,
                'recesses, poles, parked cars and a barrier arm; {points} points,\n'
                '{outliers} ({share}) of them outliers. A profile scanner',
                '`boosted_trees` |\n| --- | --- | --- | --- |\n'
                + '\n'.join(
                    f'| {title} | {{paper {name} exactly}} | {{smoother {name} exactly}} '
                    f'| {{default {name} exactly}} |'
                    for title, name in STREET_ROWS.items()
                ),
                'On the street of the demo F1 is {default F1}, recall {default recall}, and '
                '{default lost} good points',
                'several lines: {default mixed} are found in the demo, and hardly any on streets '
                'of spinning sensors. `config/classic.yaml` finds {classic mixed} in the demo, '
                'and loses {classic lost} good points.',
            ),
            *on_page(
                'README.md',
                '| | default | `classic.yaml` |\n| --- | --- | --- |\n'
                '| reflections found | {default reflection} | {classic reflection} |\n'
                '| exhaust found | {default exhaust} | {classic exhaust} |\n'
                '| points near a surface found | {default near surface} '
                '| {classic near surface} |\n'
                '| mixed pixels at edges found | {default mixed} | {classic mixed} |\n'
                '| level barrier arm found | {default barrier} | {classic barrier} |\n'
                '| **good points lost** | **{default lost}** | **{classic lost}** |',
                'above: F1 {default F1}, {default lost} good points lost.',
            ),
            *on_page(TROUBLE, *(strictness(form, 'street') for form in STRICTNESS)),
        ],
    ),
    'suburb': (
        page_sources.suburb,
        on_page(
            'README.md',
            'a simulated suburb with hedges it loses {classic lost} good points, among them '
            '{classic foliage exactly} of the foliage; the default loses {default lost}, and '
            '{default foliage exactly} of the foliage. `config/classic_vegetation.yaml` is for '
            'vegetation: there it loses {vegetation lost}, and {vegetation foliage exactly} of the',
        ),
    ),
    'snow': (
        page_sources.snow,
        [
            *on_page(
                ACCURACY,
                'behind a car that whirls it up; {points} points, {outliers} ({share}) of them '
                'outliers. By the default:\n\n| | |\n| --- | --- |\n'
                '| precision | {default precision exactly} |\n'
                '| recall | {default recall exactly} |\n'
                '| F1 | {default F1 exactly} |\n'
                '| snow | {default snow counted} |\n'
                '| spray | {default spray counted} |\n'
                '| mixed points | {default mixed counted} |\n'
                '| good points lost | {default lost} |',
            ),
            *on_page(TROUBLE, *(strictness(form, 'snow') for form in STRICTNESS)),
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
