# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Where the figures come from that pages quote: each source measures some, by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from helpers.page_runs import DATA, Pages
from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import judge
from lidar_outlier_filter.core.detectors.boosted_trees.trees import PATTERN_MODEL, read_file
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.evaluation.confusion import Share
from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.report import evaluate
from lidar_outlier_filter.evaluation.report import percent as exactly
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_lab.results.papers.methods import CLASSIC, SMOOTHER
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.recording import record
from lidar_outlier_lab.training.held_out import CHOOSE_BY
from lidar_outlier_lab.training.scenes import known_recordings, read_sweeps
from lidar_outlier_lab.training.single_sweeps import read_single_sweeps

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lidar_outlier_filter.evaluation.confusion import Confusion

    Figures = Mapping[str, str]
    Source = Callable[[Pages], Figures]

REPLAY = 'lidar-outlier-filter replay'
# The default, the papers' three, the smoother by its own defaults, and as in the paper.
STREET_FORMS: Mapping[str, Mapping[str, object]] = {
    'default': {},
    'classic': CLASSIC,
    'smoother': {'chain': ['alpha_beta_gamma']},
    'paper': SMOOTHER,
}
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
            'to the table': (said + '┏' + table).partition('\nwritten to ')[0],
            'above the table': said.rstrip(),
        }

    return source


def street(pages: Pages) -> Figures:
    """Simulate the street of the demo, and judge it by the default and by the smoother."""
    folder = pages.new('street')
    record(demo_drive(), folder / 'drive')
    figures: dict[str, str] = {}
    for form, values in STREET_FORMS.items():
        replay(folder / 'drive', folder / form, parameters={**SENSOR, **values})
        found = evaluate(read_recording(folder / form), CAUSES)
        whole = found.whole
        for name, share in {**found.causes, **found.surfaces}.items():
            figures[f'{form} {name}'] = f'{100 * share.ratio:.0f} %'
            figures[f'{form} {name} exactly'] = exactly(share.ratio)
        lost = Share(whole.lost, whole.total - whole.outliers)
        figures |= {f'{form} lost': counted(lost)}
        figures |= {f'{form} lost exactly': f'{grouped(lost.part)} ({exactly(lost.ratio)})'}
        figures |= {'outliers': grouped(whole.outliers), 'points': grouped(whole.total)}
        figures |= {'share': exactly(whole.outliers / whole.total)}
        figures |= {f'{form} F1': f'{whole.f1:.3f}', f'{form} recall': f'{whole.recall.ratio:.3f}'}
        figures |= {f'{form} {name}': text for name, text in _exactly(whole).items()}
    return figures


def _exactly(whole: Confusion) -> Figures:
    """Write what is said first of a run."""
    return {
        'precision exactly': exactly(whole.precision.ratio),
        'recall exactly': exactly(whole.recall.ratio),
        'F1 exactly': exactly(whole.f1),
    }


def snow(pages: Pages) -> Figures:
    """Simulate the same street in snow, and judge it by the default."""
    folder = pages.new('snow')
    record(snow_drive(), folder / 'drive', lines_per_message=1)
    replay(folder / 'drive', folder / 'default')
    found = evaluate(read_recording(folder / 'default'), CAUSES)
    whole = found.whole
    figures = {
        f'{cause} exactly': f'{counted(share)}, {exactly(share.ratio)}'
        for cause, share in found.causes.items()
    }
    figures |= {'outliers': grouped(whole.outliers), 'points': grouped(whole.total)}
    figures |= {'share': exactly(whole.outliers / whole.total)}
    figures |= {'lost exactly': counted(Share(whole.lost, whole.total - whole.outliers))}
    return {**figures, **_exactly(whole)}


def trees(_pages: Pages) -> Figures:
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
    figures |= {'least left': percent(left[0]), 'most left': percent(left[-1])}
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


def percent(share: float) -> str:
    """Write a share as pages do."""
    return f'{100 * share:#.2g} %'


def counted(share: Share) -> str:
    """Write so many of so many."""
    return f'{grouped(share.part)} of {grouped(share.total)}'


def grouped(value: int) -> str:
    """Write a whole number as pages do: in groups of three from five digits on."""
    return f'{value:,}'.replace(',', ' ') if value >= SHORT else str(value)
