# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What pages quote, and where it comes from; as a program it writes the quotations anew.

``cd test && python -m helpers.page_quotes`` writes all. With names of sources, it writes theirs
only.
"""

from __future__ import annotations

import re
import sys
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from helpers.clouds import table
from helpers.detectors import BITS
from helpers.page_runs import DATA, ROOT, Pages, run, write_clouds
from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.cli.terminal import REFUSED
from lidar_outlier_filter.core.detectors.evidence.models import PATTERN_MODEL, read_file
from lidar_outlier_filter.core.detectors.evidence.pattern.judge import judge
from lidar_outlier_filter.core.judging.whole_cloud import judge_whole, with_rings
from lidar_outlier_filter.core.neighbours.scan_pattern import find_pattern
from lidar_outlier_filter.evaluation.judged import CAUSES, read_recording
from lidar_outlier_filter.evaluation.report import evaluate
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.recording import record
from lidar_outlier_lab.training.held_out import CHOOSE_BY
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    Figures = Mapping[str, str]
    Source = Callable[[Pages], Figures]

# Rows of a table that the machine decides.
MACHINE = re.compile(r'.*(points per second|× real time).*')
NAMED = re.compile(r'\{([\w -]+)\}')
REPLAY = 'lidar-outlier-filter replay'
# The default, and the smoother by its own defaults.
STREET_FORMS: Mapping[str, Mapping[str, object]] = {
    'default': {},
    'smoother': {'chain': ['alpha_beta_gamma']},
}
SHORT = 10_000
WEATHER_NAMES = {'light_snow': 'light snow', 'heavy_snow': 'heavy snow', 'mixed': 'mixed points'}
WORDS = {1: 'one', 2: 'two', 3: 'three', 4: 'four', 5: 'five'}


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
        for place, name in reversed(list(enumerate(self.names, 1))):
            text = with_speeds_of(match[place], figures[name])
            page = page[: match.start(place)] + text + page[match.end(place) :]
        (ROOT / self.page).write_text(page, 'utf-8')


def with_speeds_of(old: str, new: str) -> str:
    """Keep the rows that depend on the machine as they were, where there are as many."""
    speeds = [line for line in old.splitlines() if MACHINE.fullmatch(line)]
    lines = new.splitlines()
    places = [place for place, line in enumerate(lines) if MACHINE.fullmatch(line)]
    if len(places) == len(speeds):
        for place, line in zip(places, speeds, strict=True):
            lines[place] = line
    return '\n'.join(lines)


def steady(text: str) -> str:
    """Leave out what depends on the machine."""
    return '\n'.join(line.rstrip() for line in text.splitlines() if not MACHINE.fullmatch(line))


# The sources --------------------------------------------------------------------------------------


def _numpy(_pages: Pages) -> Figures:
    """Judge the cloud of the page without naming a chain."""
    xyz = np.random.default_rng(1).uniform((-20, -20, 0), (20, 20, 0.02), (5000, 3))
    xyz[77] = 1, 2, 3
    verdict = detect_outliers(xyz)
    bits = int(np.bitwise_or.reduce(verdict.detectors))
    chain = ', '.join(f'`{name}`' for name, bit in BITS.items() if bits & bit)
    assert np.flatnonzero(verdict.outlier).tolist() == [77], 'the sentence says: the bird'
    return {'chain': chain, 'count': str(np.count_nonzero(verdict.outlier))}


def _output(page: str, command: str) -> Source:
    """Quote what a command of a page writes: all of it, or what stands above its table."""

    def source(pages: Pages) -> Figures:
        output = pages.run(page).output(command)
        said, _, table = output.partition('┏')
        return {
            'all': output.rstrip(),
            'to the table': (said + '┏' + table).partition('\nwritten to ')[0],
            'above the table': said.rstrip(),
        }

    return source


def _xyzi(pages: Pages) -> Figures:
    """Replay clouds of a driver that was built without ring and time."""
    folder = pages.new('xyzi')
    rows = table(400, intensity=('f4', np.ones(400)))
    write_clouds(folder / 'my_recording', '/rslidar_points', [rows])
    with chdir(folder):
        (folder / 'config').symlink_to(ROOT / 'config')
        status, output = run(f'{REPLAY} my_recording --params config/robosense.yaml')
    assert status == REFUSED
    return {'sentence': output.partition(' for: /rslidar_points: ')[2].partition(' (')[0]}


def _shares(recordings: Mapping[str, str], parameters: str, **more: object) -> Source:
    """Measure what the default rejects of recordings, of the points that are there."""

    def source(pages: Pages) -> Figures:
        values = read_yaml(ROOT / 'config' / parameters) | more
        figures: dict[str, str] = {}
        for name, recording in recordings.items():
            report = replay(DATA / 'bags' / recording, pages.new(name) / 'out', parameters=values)
            points = sum(topic.points - topic.invalid for topic in report.topics)
            rejected = sum(topic.rejected for topic in report.topics)
            figures[name] = percent(rejected / points)
        return figures

    return source


def _street(pages: Pages) -> Figures:
    """Simulate the street of the demo, and judge it by the default and by the smoother."""
    folder = pages.new('street')
    record(demo_drive(), folder / 'drive')
    figures: dict[str, str] = {}
    for form, values in STREET_FORMS.items():
        replay(folder / 'drive', folder / form, parameters={**SENSOR, **values})
        found = evaluate(read_recording(folder / form), CAUSES)
        whole = found.whole
        for cause, share in found.causes.items():
            figures[f'{form} {cause}'] = f'{100 * share.ratio:.0f} %'
        good = whole.total - whole.outliers
        figures |= {f'{form} lost': f'{grouped(whole.lost)} of {grouped(good)}'}
        figures |= {'outliers': grouped(whole.outliers), 'points': grouped(whole.total)}
        figures |= {f'{form} F1': f'{whole.f1:.3f}', f'{form} recall': f'{whole.recall.ratio:.3f}'}
    return figures


def _snow(pages: Pages) -> Figures:
    """Simulate the same street in snow, and judge it by the default."""
    folder = pages.new('snow')
    record(snow_drive(), folder / 'drive', lines_per_message=1)
    replay(folder / 'drive', folder / 'default')
    found = evaluate(read_recording(folder / 'default'), CAUSES)
    shares = {cause: f'{100 * share.ratio:.0f} %' for cause, share in found.causes.items()}
    return shares | {'lost': WORDS.get(found.whole.lost, str(found.whole.lost))}


def _trees(_pages: Pages) -> Figures:
    """Read what the file of the trees for spinning sensors says of sensors left out."""
    held = read_file(PATTERN_MODEL)['held_out']
    dark, once = held['without_intensity'], read_file(PATTERN_MODEL)['held_out_one_pass']
    rows = (
        ('both passes', held),
        ('the same, intensities hidden', dark),
        ('first pass alone', once),
    )
    weather = sorted(held['weather'], key=lambda kind: -held['weather'][kind]['f1'])
    figures = {
        'weather': '\n'.join(
            f'| {WEATHER_NAMES.get(kind, kind)} | {held["weather"][kind]["f1"]:.2f} '
            f'| {dark["weather"][kind]["f1"]:.2f} |'
            for kind in weather
        ),
        'parts': '\n'.join(f'| {name} | {_parts(one)} |' for name, one in rows),
    }
    for sensor, share in held['clean_rejected'].items():
        figures[f'left {sensor}'] = percent(share)
        figures[f'dark {sensor}'] = percent(dark['clean_rejected'][sensor])
    left, shipped = sorted(held['clean_rejected'].values()), _shipped()
    figures |= {'least left': percent(left[0]), 'most but one': percent(left[-2])}
    figures |= {'most left': percent(left[-1])}
    figures |= {'least shipped': percent(min(shipped.values()))}
    figures |= {'most shipped': percent(max(shipped.values()))}
    return figures | {f'shipped {sensor}': percent(share) for sensor, share in shipped.items()}


def _parts(held: Mapping[str, Any]) -> str:
    """Lay out what a table says of some trees: weather, good points lost, clean sweeps, streets."""
    some, streets = [held['weather'][kind] for kind in CHOOSE_BY], held['street_f1']
    clean = [*held['clean_rejected'].values()]
    lost = float(np.mean([one['lost'] for one in some]))
    return ' | '.join(
        [
            *(f'{one["f1"]:.2f}' for one in some),
            *(percent(share) for share in (lost, float(np.median(clean)), max(clean))),
            ' / '.join(f'{streets[f"street-{rings}"]:.2f}' for rings in (16, 32, 64, 128)),
        ]
    )


def _shipped() -> dict[str, float]:
    """Return the share that the trees of the package reject of clean sweeps, by sensor."""
    shares: dict[str, float] = {}
    every = [(one.sensor, read_sweeps(one)) for one in known_recordings(DATA / 'bags')]
    for sensor, sweeps in [*every, *read_single_sweeps(DATA)]:
        rejected = points = 0
        for sweep in sweeps:
            pattern = find_pattern(sweep, spins=True)
            assert pattern is not None, sensor
            rejected += int(np.count_nonzero(judge(pattern, 1.0) > 1))
            points += len(sweep)
        shares[sensor] = rejected / points
    return shares


def _recovered(_pages: Pages) -> Figures:
    """Judge the first cloud of recordings with its rings, with recovered ones, and with none."""
    parameters = FilterParameters()
    figures: dict[str, str] = {}
    for recording in known_recordings(DATA / 'bags'):
        cloud = read_sweeps(recording, 1)[0]
        nothing = np.zeros(len(cloud), np.int64)
        mixed = np.random.default_rng(1).permutation(len(cloud))
        bare = replace(cloud, t=nothing, line=nothing).take(mixed)
        known = judge_whole(cloud, parameters).rejected[mixed]
        found = judge_whole(with_rings(bare, parameters), parameters).rejected
        near = judge_whole(bare, parameters).rejected
        title = recording.sensor
        figures[f'{title} equal'] = f'{100 * np.mean(known == found):.2f} %'
        for how, rejected in (('known', known), ('found', found), ('near', near)):
            figures[f'{title} {how}'] = f'{100 * np.mean(rejected):.3f} %'
    return figures


def _real_snow(_pages: Pages) -> Figures:
    """Read the page of real snow, which a command wrote: F1, and good points lost."""
    page = (ROOT / 'doc' / 'real_snow.md').read_text('utf-8')
    _, _, table = page.partition('## In short')
    figures: dict[str, str] = {}
    for name in ('**default**', '3D-OutDet', 'DROR'):
        row = next(line for line in table.splitlines() if line.startswith(f'| {name} |'))
        cells = [cell.strip() for cell in row.strip('|').split('|')]
        figures |= {f'{name.strip("*")} both': cells[1], f'{name.strip("*")} last': cells[3]}
    return figures


def percent(share: float) -> str:
    """Write a share as pages do."""
    return f'{100 * share:#.2g} %'


def grouped(value: int) -> str:
    """Write a whole number as pages do: in groups of three from five digits on."""
    return f'{value:,}'.replace(',', ' ') if value >= SHORT else str(value)


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
SHORTLY = 'doc/results_in_short.md'
SOURCES: Mapping[str, tuple[Source, Sequence[Quote]]] = {
    'trees': (
        _trees,
        [
            Quote(
                SHORTLY,
                'sensor left out | F1 | intensities hidden |\n| --- | ---: | ---: |\n{weather}\n\n'
                'Clean recordings in dry air',
            ),
            Quote(
                'doc/detectors/evidence.md',
                '`street-16` / `-32` / `-64` / `-128` |\n'
                '| --- |' + 11 * ' ---: |' + '\n'
                '{parts}\n\nThe worst sensor is the Ruby Plus',
            ),
            Quote(
                'README.md',
                'twelve real sensors it rejects {least shipped} to {most shipped} of the points. '
                'It learnt from them. Left out of the training in turn, eleven of the sensors lost '
                '{least left} to {most but one}, and a Ruby Plus in a narrow room {most left}.\n*',
            ),
            *(
                Quote(
                    SHORTLY, f'| {title} | {{left {name}}} | {{dark {name}}} | {{shipped {name}}} |'
                )
                for title, name in SENSORS.items()
            ),
        ],
    ),
    'recovered rings': (
        _recovered,
        [
            Quote(
                'doc/detectors/evidence.md',
                f'| {title} | {{{name} equal}} | {{{name} known}} | {{{name} found}} '
                f'| {{{name} near}} |',
            )
            for title, name in (
                ('VLP-16', 'VLP-16'),
                ('HDL-32E', 'HDL-32E'),
                ('VLP-32C', 'VLP-32C'),
                ('OS0-32', 'OS0-32'),
                ('OS1-128', 'OS1-128'),
                ('XT32', 'XT32'),
                ('`lidar_link`, 32 rings', 'lidar_link'),
            )
        ],
    ),
    'real snow': (
        _real_snow,
        [
            Quote(
                'README.md',
                '| the default, which never saw a label | {default both} | {default last} |\n'
                '| 3D-OutDet, a network trained on this data set | {3D-OutDet both} '
                '| {3D-OutDet last} |\n'
                '| DROR, at the threshold that is best for these labels | {DROR both} '
                '| {DROR last} |\n',
            )
        ],
    ),
    'numpy': (
        _numpy,
        [
            Quote(
                'doc/numpy.md',
                'Without `chain` this cloud is judged by {chain}, which rejects {count} of the',
            )
        ],
    ),
    'ouster': (
        _output(f'{START}ouster.md', REPLAY),
        [Quote(f'{START}ouster.md', 'clouds of an OS1-128:\n\n```text\n{to the table}\n```')],
    ),
    'hesai': (_output(f'{START}hesai.md', REPLAY), [Quote(f'{START}hesai.md', LISTED)]),
    'livox': (_output(f'{START}livox.md', REPLAY), [Quote(f'{START}livox.md', LISTED)]),
    'robosense': (_output(f'{START}robosense.md', REPLAY), [Quote(f'{START}robosense.md', LISTED)]),
    'velodyne': (_output(f'{START}velodyne.md', REPLAY), [Quote(f'{START}velodyne.md', LISTED)]),
    'robosense without times': (
        _xyzi,
        [Quote(f'{START}robosense.md', '* **"{sentence}".** The driver was built with `XYZI`')],
    ),
    'velodyne shares': (
        _shares(
            {
                'VLP-16': 'vlp16_mrpt_mcap',
                'HDL-32E': 'hdl32_mrpt_mcap',
                'VLP-32C': 'vlp32_nebula_db3',
            },
            'velodyne.yaml',
        ),
        [
            Quote(
                f'{START}velodyne.md',
                '| VLP-16, a room | {VLP-16} |\n| HDL-32E, outdoors | {HDL-32E} |\n'
                '| VLP-32C, a hall | {VLP-32C} |',
            )
        ],
    ),
    'hesai share': (
        _shares({'XT32': 'hesai_xt32_nebula_mcap'}, 'hesai.yaml', time_field='stamp'),
        [Quote(f'{START}hesai.md', 'XT32 in an office the default rejects {XT32} of the points')],
    ),
    'street': (
        _street,
        [
            Quote(
                'README.md',
                'In the first picture, {outliers} of {points} points are outliers:\n\n'
                '| | found by the default | found by `alpha_beta_gamma` |\n| --- | --- | --- |\n'
                '| reflections | {default reflection} | {smoother reflection} |\n'
                '| exhaust | {default exhaust} | {smoother exhaust} |\n'
                '| points near a surface | {default near surface} | {smoother near surface} |\n'
                '| mixed pixels at edges | {default mixed} | {smoother mixed} |\n'
                '| a level barrier arm | {default barrier} | {smoother barrier} |\n'
                '| **good points lost** | **{default lost}** | **{smoother lost}** |',
            ),
            Quote(
                'doc/results_in_short.md',
                'On the street of the demo F1 is {default F1}, recall {default recall}, and '
                '{default lost} good points',
            ),
        ],
    ),
    'snow': (
        _snow,
        [
            Quote(
                'README.md',
                'it finds {snow} of the snow and {spray} of the spray, and loses {lost} good '
                'points',
            )
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
