# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Tables 1 to 3 and figures 3 to 5 of Sotoodeh (2006), and ours beside them."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints, Progress
from lidar_outlier_filter.core.detectors import lof
from lidar_outlier_filter.core.detectors.builtin import Lof
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_lab.results.markdown import NOTHING, image, paragraphs, share_of, table
from lidar_outlier_lab.results.papers import published
from lidar_outlier_lab.results.papers.panels import GreyImage, Layer, PointPanel, draw, draw_images
from lidar_outlier_lab.simulation.papers import surface_truth, tripod

FACTOR = 1.2
NEIGHBOUR_COUNTS = (10, 20, 50)  # neighbours
PAPERS = 20  # of them in the paper
CITIES = 3  # seeds of the table
FRONT = slice(520, 920)  # columns of the room that are shown
MAP_HIGH = 1.5  # factor that is white
STEPS = 4
RESIDUALS = {'below σ': '#4b9b4b', 'below 2 σ': '#e8c53a', 'above 2 σ: outlier': '#d81b1b'}
VERDICTS = {
    'inlier, kept': '#d5d8dc',
    'inlier, rejected': '#f0a30a',
    'outlier, rejected': '#0072b2',
    'outlier, kept': '#d81b1b',
}


def section(_presets: Sequence[str], seed: int, folder: Path, progress: Progress) -> str:
    """Judge cities with his truth, and draw the maps of a city, a room and a street."""
    progress(0, STEPS, 'cities')
    cities = [surface_truth.city(seed + i) for i in range(CITIES)]
    factors = [_factors(city.xyz, NEIGHBOUR_COUNTS) for city in cities]
    progress(1, STEPS, 'figure 3')
    _figure_3(cities[0], factors[0][PAPERS], folder)
    progress(2, STEPS, 'figure 4')
    room = _figure_4(seed, folder)
    progress(3, STEPS, 'figure 5')
    _figure_5(seed, folder)
    return paragraphs(
        f'Cities of the seeds {seed} to {seed + CITIES - 1}; a room and a street of seed {seed}.',
        '### Table 1: where the surface model comes from',
        _images(),
        '### Table 2: residuals against the surface model, m',
        _residuals(cities, seed),
        f'### Table 3: LOF above {FACTOR}, MinPts {PAPERS}',
        _two_by_two(cities, factors, seed),
        '### Table 3 in shares, and with other MinPts',
        _table(cities, factors, seed),
        'Errors are shares of all points, as in the paper. Its own are as it prints them.',
        '### Figure 3',
        image('sotoodeh2006_figure_3.png', 'Residual map of a city, and what LOF says of it'),
        '### Figure 4',
        image('sotoodeh2006_figure_4.png', 'A room: intensity, and LOF maps'),
        room,
        '### Figure 5',
        image('sotoodeh2006_figure_5.png', 'A street in snow: detected outliers in white'),
        'This is another scene: the paper shows Pinchango Alto in Peru, scanned with a Riegl '
        'LMS-Z420i. Ours is a street in snow, from a tripod too. MinPts is 10 in both.',
    )


def _factors(xyz: Floats, neighbours: Sequence[int]) -> dict[int, Floats]:
    near = Neighbourhood(xyz, max(neighbours))
    return {k: lof.measure(near, Lof(min_pts=k)) for k in neighbours}


def _images() -> str:
    """Say what the paper matched, and what stands for it here."""
    ours = dict.fromkeys(published.LOF_IMAGES, f'{NOTHING}: no images')
    ours['points of the surface'] = f'{1 / surface_truth.GRID**2:.0f} per m²'
    rows = [(name, value, ours[name]) for name, value in published.LOF_IMAGES.items()]
    rows.append(('smoothed over', NOTHING, f'{surface_truth.SMOOTH} m'))
    return table(('', 'paper', 'ours'), rows)


def _residuals(cities: Sequence[surface_truth.City], seed: int) -> str:
    """Compare heights measured by hand, and the laser, with the surface model."""
    rows = [('manual measurements: paper', *_metres(published.LOF_CHECKS), NOTHING)]
    for i, city in enumerate(cities):
        off = city.checks
        figures = (float(off.mean()), float(off.std()), float(np.abs(off).max()))
        rows.append((f'{len(off)} positions: ours, seed {seed + i}', *_metres(figures), NOTHING))
    rows.append(('laser: paper', *_metres((*published.LOF_RESIDUALS, published.LOF_LIMIT))))
    for i, city in enumerate(cities):
        off = city.residual
        laser = (float(off.mean()), float(off.std()), float(off.max()), city.limit)
        rows.append((f'laser: ours, seed {seed + i}', *_metres(laser)))
    return table(('', 'mean', 'standard deviation', 'maximum', 'limit'), rows)


def _metres(values: Iterable[float]) -> tuple[str, ...]:
    return tuple(f'{v:.3f}' for v in values)


def _two_by_two(
    cities: Sequence[surface_truth.City], factors: Sequence[dict[int, Floats]], seed: int
) -> str:
    """Lay out truth against verdict as the paper does, its sums included."""
    ours = [
        (f'ours, seed {seed + i}', confusion(city.bad, found[PAPERS] > FACTOR))
        for i, (city, found) in enumerate(zip(cities, factors, strict=True))
    ]
    rows = []
    for name, one in (('paper', published.LOF), *ours):
        for truth, kept, rejected in (
            ('inliers', one.kept, one.lost),
            ('outliers', one.missed, one.found),
            ('all', one.kept + one.missed, one.lost + one.found),
        ):
            cells = (f'{count:,}' for count in (kept, rejected, kept + rejected))
            rows.append((f'{name}: reference {truth}', *cells))
    return table(('', 'LOF: inliers', 'LOF: outliers', 'all'), rows)


def _table(
    cities: Sequence[surface_truth.City], factors: Sequence[dict[int, Floats]], seed: int
) -> str:
    head = ('', 'points', 'outliers', 'recall', 'α-error', 'β-error', 'precision')
    printed = [*_errors(published.LOF)]
    printed[3:5] = published.LOF_PRINTED
    rows = [(f'paper, MinPts {PAPERS}', *printed)]
    for i, (city, found) in enumerate(zip(cities, factors, strict=True)):
        for k, values in found.items():
            name = f'ours, MinPts {k}, seed {seed + i}'
            rows.append((name, *_errors(confusion(city.bad, values > FACTOR))))
    return table(head, rows)


def _errors(counts: Confusion) -> tuple[str, ...]:
    shares = map(counts.share, ('recall', 'alpha_error', 'beta_error', 'precision'))
    return (
        f'{counts.total:,}',
        percent(counts.share('prevalence').ratio),
        *(percent(share.ratio) for share in shares),
    )


def _figure_3(city: surface_truth.City, factor: Floats, folder: Path) -> None:
    """Map the residuals in the classes of the paper, and beside them the verdict of LOF."""
    steps = np.array([city.limit / 2.0, city.limit])
    rejected = factor > FACTOR
    verdict = np.where(rejected, np.where(city.bad, 2, 1), np.where(city.bad, 3, 0))
    flat, classes = city.xyz[:, :2], np.searchsorted(steps, city.residual)
    row = [
        _classes('residuals', flat, classes, RESIDUALS),
        _classes(f'LOF above {FACTOR}, MinPts 20', flat, verdict, VERDICTS),
    ]
    draw([row], folder / 'sotoodeh2006_figure_3.png', ('x, m', 'y, m'), row=7.0)


def _classes(title: str, flat: Floats, code: Ints, names: Mapping[str, str]) -> PointPanel:
    """Show points by their class, (N,): the index of a name, which has a colour."""
    parts = enumerate(names.items())
    return PointPanel(
        title, [Layer(flat[code == k], colour, 0.8, name) for k, (name, colour) in parts]
    )


def _figure_4(seed: int, folder: Path) -> str:
    """Show a room by its intensity and by its factors; say what is above the threshold."""
    scan = tripod.room(seed)
    found = _factors(scan.xyz, (10, 20))
    bright = np.log(scan.points['intensity'].astype(np.float64))
    low, high = np.percentile(bright, [1, 99])
    images = [GreyImage('intensity', scan.image(bright)[:, FRONT], float(low), float(high))]
    for k, values in found.items():
        title = f'LOF, MinPts {k}: 1 black, {MAP_HIGH} white'
        images.append(GreyImage(title, scan.image(values)[:, FRONT], 1.0, MAP_HIGH))
    draw_images(images, folder / 'sotoodeh2006_figure_4.png')
    mixed = scan.points['label'] == Cause.MIXED
    rows = [
        (f'MinPts {k}', share_of(values[mixed] > FACTOR), share_of(values[~mixed] > FACTOR))
        for k, values in found.items()
    ]
    head = (f'above {FACTOR} in the room', 'points between two surfaces', 'all others')
    return table(head, rows)


def _figure_5(seed: int, folder: Path) -> None:
    """Show a street in snow by its range, and the detected points in white."""
    scan = tripod.facades(seed)[0]
    values = _factors(scan.xyz, (10,))[10]
    distance = np.log(np.linalg.norm(scan.xyz - scan.xyz.mean(axis=0), axis=1))
    low, high = np.percentile(distance, [1, 99])
    shade = 0.15 + 0.5 * (1.0 - np.clip((distance - low) / (high - low), 0.0, 1.0))
    shown = np.where(values > FACTOR, 1.0, shade)
    street = GreyImage('LOF above 1.2 in white, MinPts 10', scan.image(shown), 0.0, 1.0)
    draw_images([street], folder / 'sotoodeh2006_figure_5.png')
