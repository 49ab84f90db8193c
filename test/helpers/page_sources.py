# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the figures come from that pages quote: each source measures some, by their names."""

from __future__ import annotations

import re
from collections import defaultdict
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from helpers import ROOT
from helpers.page_runs import DATA, Pages
from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.core.detectors.boosted_trees import trees as files_of
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import judge
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.evaluation.confusion import Share
from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.report import evaluate
from lidar_outlier_filter.evaluation.report import percent as exactly
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_lab.results.papers.methods import CLASSIC, SMOOTHER, VEGETATION
from lidar_outlier_lab.simulation.scenes import mapping_streets
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.recording import record
from lidar_outlier_lab.training.held_out import NO_WEATHER
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    Figures = Mapping[str, str]
    Source = Callable[[Pages], Figures]

REPLAY = 'lidar-outlier-filter replay'
# The default, the papers' three, the smoother by its own defaults, and as in the paper.
STREET_FORMS: Mapping[str, Mapping[str, object]] = {
    'default': {},
    'classic': CLASSIC,
    'vegetation': VEGETATION,
    'smoother': {'chain': ['alpha_beta_gamma']},
    'paper': SMOOTHER,
    'strict': {'boosted_trees.threshold': 0.9},
    'careful': {'boosted_trees.threshold': 1.1},
}
CAUSE_ROWS = (
    *('snow', 'rain', 'fog', 'spray', 'dust', 'exhaust', 'mirrored by the road', 'ghost'),
    *('reflection', 'single', 'cluster', 'bird', 'barrier', 'near surface', 'mixed'),
)
NAMES = {'heavy_snow': 'snow', 'heavy snow': 'snow', 'ghosts': 'ghost'}
NAMES |= {'mixed points, ghosts, birds': 'mixed'}
MODELS = (files_of.PATTERN_MODEL, files_of.PROFILE_MODEL, files_of.SURVEY_MODEL)
LITTLE, MUCH = 0.5, 0.005  # found, or F1, and lost: worse is bold
SHORT = 10_000
WEATHER_NAMES = {'light_snow': 'light snow', 'heavy_snow': 'heavy snow', 'mixed': 'mixed points'}


def output_of(page: str, command: str) -> Source:
    """Quote what a command of a page writes: all of it, or what stands above its table."""

    def source(pages: Pages) -> Figures:
        lines = pages.run(page).output(command).splitlines()
        output = '\n'.join(line.rstrip() for line in lines)
        said, _, table = output.partition('┏')
        return {
            'all': output.strip(),  # a page keeps the blanks before it
            'to the speed': (said + '┏' + table).partition('\n│ points per second ')[0],
            'above the table': said.rstrip(),
        }

    return source


def tables(_pages: Pages) -> Figures:
    """Read the tables in doc/results.

    A cell has the name ``file/heading/corner of the table/row/column``, the rows of a table
    ``file/heading``. Of headings, columns and corners counts what precedes a comma or colon,
    of rows all but a bracket. The first of equal names counts. Of F1 with other figures in
    brackets, ``NAME, F1`` is F1 alone.
    """
    figures: dict[str, str] = {}
    for path in (ROOT / 'doc' / 'results').glob('*.md'):
        heading, columns = '', list[str]()
        for line in path.read_text('utf-8').splitlines():
            cells = [cell.strip(' `*') for cell in line.split('|')[1:-1]]
            if line.startswith('#'):
                heading = _short(line.strip('# '))
            elif not cells:
                columns = []
            elif not columns:
                columns = [_short(cell) for cell in cells]
            elif not set(line) <= set('| -:'):
                stem = f'{path.stem}/{heading}'
                figures[stem] = f'{figures[stem]}\n{line}' if stem in figures else line
                title = re.sub(r'decode → | → split| \(.*|`', '', cells[0])
                for column, cell in zip(columns[1:], cells[1:], strict=True):
                    name = '/'.join(filter(None, (stem, columns[0], title, column)))
                    figures.setdefault(name, cell)
                    figures.setdefault(f'{name}, F1', cell.partition(' ')[0])
    return figures | {'causes': '\n'.join(_causes(figures))}


def _causes(figures: Figures) -> Iterator[str]:
    """Lay out the worst that each kind of sensor finds and loses, of tables and files of trees."""
    spinning, profile, survey = (files_of.read_file(model)['held_out'] for model in MODELS)
    found = [defaultdict[str, list[tuple[float, ...]]](list) for _ in range(4)]
    for row in figures['profile_heads/The default'].splitlines():
        shares = [(float(share) / 100,) for share in re.findall(r'([\d.]+) %', row)]
        found[0][row.split(' | ')[0][2:]] += shares
    for column, recall in ((0, profile['recall']), (3, survey['recall'])):
        for cause, share in recall.items():
            found[column][f'found: {cause.replace("_", " ")}'].append((share,))
    for weather, one in spinning['weather'].items():
        found[1][f'found: {NAMES.get(weather, weather)}'].append((one['f1'], one['lost']))
    for name, text in figures.items():
        if match := re.fullmatch(r'livox/.*?, (.*)/free', name):
            one = [float(figure) for figure in re.findall(r'[\d.]+', text)]
            found[2][f'found: {NAMES.get(match[1], match[1])}'].append((one[0], one[-1] / 100))
    low, every = figures['surveys/Noise near surfaces/cloud/all/below'].split(' of ')
    found[3]['found: near surface'].append((int(low) / int(every),))
    for cause in CAUSE_ROWS:
        cells = [_worst(kind[f'found: {cause}']) for kind in found]
        yield f'| {cause} | {" | ".join(cells)} |'
    heads, dry = max(found[0]['lost: all good points'])[0], max(found[2]['found: dry air'])[1]
    clean = max(spinning['clean_rejected'].values())
    lost = (max(heads, profile['lost']), clean, dry, survey['lost'])
    cells = [f'**{percent(one)}**' if one > MUCH else percent(one) for one in lost]
    yield f'| good points lost | {" | ".join(cells)} |'


def _worst(some: Iterable[tuple[float, ...]]) -> str:
    """Write the least found, or the least F1 and what is lost then; bold where it is bad."""
    found, *lost = min(some, key=lambda one: (one[0], *(-x for x in one[1:])), default=(np.nan,))
    text = f'{found:.2f} ({percent(lost[0])})' if lost else f'{100 * found:.0f} %'
    text = f'**{text}**' if found < LITTLE or max(lost, default=0) > MUCH else text
    return '–' if np.isnan(found) else text


def _short(text: str) -> str:
    """Leave out what follows a comma, a colon or a backquote."""
    return re.split('[,:]', text.replace('`', ''))[0]


def files(_pages: Pages) -> Figures:
    """Count what is rejected of real files, by the default."""
    figures: dict[str, str] = {}
    for name, file, sensor in (
        ('actual_scan', 'actual_scan_20240820_cloud.pcd', 'auto'),
        ('autzen_trim', 'autzen_trim.laz', 'auto'),
        ('source', 'source.ply', 'auto'),
        ('source survey', 'source.ply', 'survey'),
    ):
        path, parameters = DATA / 'clouds' / file, {'boosted_trees.sensor': sensor}
        found = clean_file(
            path, path, FilterParameters().changed(parameters), CleanOptions(dry=True)
        )
        figures[f'{name} points'] = grouped(found.points)
        figures[f'{name} rejected'] = grouped(found.rejected)
        figures[f'{name} share'] = percent(found.rejected / found.points)
    return figures


def street(pages: Pages) -> Figures:
    """Simulate the street of the demo, and judge it in each form."""
    folder = pages.new('street')
    record(demo_drive(), folder / 'drive')
    return _of_forms(folder, STREET_FORMS, SENSOR)


def suburb(pages: Pages) -> Figures:
    """Simulate a suburb with hedges, and judge it by the default and by the papers' three."""
    folder = pages.new('suburb')
    record(mapping_streets.suburb(1), folder / 'drive')
    return _of_forms(folder, ('default', 'classic', 'vegetation'))


def snow(pages: Pages) -> Figures:
    """Simulate the same street in snow, and judge it by the default, more or less strict."""
    folder = pages.new('snow')
    record(snow_drive(), folder / 'drive', lines_per_message=1)
    return _of_forms(folder, ('default', 'strict', 'careful'))


def _of_forms(
    folder: Path, forms: Iterable[str], sensor: Mapping[str, object] = MappingProxyType({})
) -> Figures:
    """Filter and evaluate a drive in several forms."""
    figures: dict[str, str] = {}
    for form in forms:
        replay(folder / 'drive', folder / form, parameters={**sensor, **STREET_FORMS[form]})
        figures |= _of_run(folder / form)
    return figures


def _of_run(recording: Path) -> dict[str, str]:
    """Evaluate a run; its figures have the name of its folder before theirs."""
    found = evaluate(read_recording(recording), CAUSES)
    whole, form = found.whole, recording.name
    lost = Share(whole.lost, whole.total - whole.outliers)
    figures = {
        'outliers': grouped(whole.outliers),
        'points': grouped(whole.total),
        'share': exactly(whole.outliers / whole.total),
        f'{form} lost': counted(lost),
        f'{form} lost exactly': f'{grouped(lost.part)} ({exactly(lost.ratio)})',
        f'{form} F1': f'{whole.f1:.3f}',
        f'{form} F1 exactly': exactly(whole.f1),
        f'{form} recall': f'{whole.recall.ratio:.3f}',
        f'{form} recall exactly': exactly(whole.recall.ratio),
        f'{form} precision exactly': exactly(whole.precision.ratio),
    }
    for name, share in {**found.causes, **found.surfaces}.items():
        figures[f'{form} {name}'] = f'{100 * share.ratio:.0f} %'
        figures[f'{form} {name} exactly'] = exactly(share.ratio)
        figures[f'{form} {name} counted'] = f'{counted(share)}, {exactly(share.ratio)}'
    return figures


def trees(_pages: Pages) -> Figures:
    """Read what the file of the trees for spinning sensors says of sensors left out."""
    file = files_of.read_file(files_of.PATTERN_MODEL)
    held, once = file['held_out'], file['held_out_one_pass']
    dark = held['without_intensity']
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
            if ' ' not in kind  # nor of another law
        ),
        'parts': '\n'.join(f'| {name} | {_parts(one)} |' for name, one in rows),
    }
    for sensor, share in held['clean_rejected'].items():
        figures[f'left {sensor}'] = percent(share)
        figures[f'dark {sensor}'] = percent(dark['clean_rejected'][sensor])
    left, shipped = sorted(held['clean_rejected'].values()), _shipped()
    figures |= {'least left': percent(left[0]), 'most left': percent(left[-1])}
    figures |= {'least shipped': percent(min(shipped.values()))}
    figures |= {'most shipped': percent(max(shipped.values()))}
    return figures | {f'shipped {sensor}': percent(share) for sensor, share in shipped.items()}


def _parts(held: Mapping[str, Any]) -> str:
    """Lay out what a table says of some trees: weather, good points lost, clean sweeps, streets."""
    kinds = (kind for kind in held['weather'] if ' ' not in kind and kind not in NO_WEATHER)
    some, streets = [held['weather'][kind] for kind in kinds], held['street_f1']
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


def percent(share: float) -> str:
    """Write a share as pages do."""
    return f'{100 * share:#.2g} %'


def counted(share: Share) -> str:
    """Write so many of so many."""
    return f'{grouped(share.part)} of {grouped(share.total)}'


def grouped(value: int) -> str:
    """Write a whole number as pages do: in groups of three from five digits on."""
    return f'{value:,}'.replace(',', ' ') if value >= SHORT else str(value)
