# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Draw the curves of the default's trees: how the log-odds change with a feature, on average.

    scripts/environment python benchmarks/model_curves.py doc/images/boosted_trees_curves.png

The points are drawn from clean sweeps and from every weather on them: half of them outliers. A
curve is the mean of what the second pass says of them when a feature has one value for all. The
features are those that add the most to the log-odds.
"""
# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidar_outlier_filter.core.detectors.boosted_trees.explain.pattern_reasons import (
    REASONS,
    contribute,
)
from lidar_outlier_filter.core.detectors.boosted_trees.models import load
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.judge import first_pass
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.scores import (
    COUNT_AGAIN,
    measure_again,
)
from lidar_outlier_filter.core.detectors.boosted_trees.pattern.window import prepare
from lidar_outlier_filter.core.detectors.boosted_trees.trees import add_up
from lidar_outlier_filter.core.scan_pattern.scan_pattern import find_pattern
from lidar_outlier_filter.evaluation.plots import COLOURS, DPI, FRAME, GRID, INK
from lidar_outlier_lab.training.scenes import (
    has_pattern,
    known_recordings,
    read_sweeps,
    recorded_sweeps,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from lidar_outlier_filter.annotations import Singles
    from lidar_outlier_lab.training.train import Sweep


SHOWN, OF_EACH, STEPS = 8, 40, 60
LENGTHS = ('step', 'leap', 'along', 'along_m', 'between', 'beside', 'across')
LENGTHS += ('near3', 'near5', 'near5_m', 'rough_own', 'rough_other', 'range', 'glare')


def some_points(sweep: Sweep, rng: np.random.Generator) -> tuple[Singles, NDArray[np.bool_]]:
    """Draw outliers and good points that the second pass looks at, with their features (F, N)."""
    pattern = find_pattern(sweep.points, spins=True)
    if pattern is None:
        raise SystemExit(f'{sweep.name} has no scan pattern')
    model, there, prepared = load(), pattern.order >= 0, prepare(pattern)
    first = first_pass(prepared, model.first)
    values = np.zeros((COUNT_AGAIN, len(there)), np.float32)
    measure_again(prepared, first, 0, len(pattern.first), values)
    asked = np.flatnonzero(there & (first.score > np.float32(model.doubtful)))
    outlier = sweep.outlier[pattern.order[asked]]
    bad, good = asked[outlier], asked[~outlier]
    rows = [rng.choice(one, min(OF_EACH, len(one)), replace=False) for one in (bad, good)]
    return values[:, np.concatenate(rows)], np.repeat([True, False], [len(r) for r in rows])


def curve(values: Singles, number: int, grid: Singles) -> list[float]:
    """Return the mean log-odds where all points have one value of a feature."""
    total, found = np.empty(values.shape[1], np.float32), []
    for one in grid:
        changed = values.copy()
        changed[number] = one
        add_up(load().again, changed, total)
        found.append(float(total.mean()))
    return found


def draw(values: Singles, outlier: NDArray[np.bool_], path: Path) -> None:
    """Draw the features that add the most."""
    added = np.zeros_like(values)
    contribute(load().again, values, np.ones(len(outlier), np.bool_), added)
    weight = np.abs(added).mean(axis=1)
    chosen = np.argsort(-weight, kind='stable')[:SHOWN]
    figure = Figure((10.5, 5.0), facecolor='white', layout='constrained')
    panels = figure.subplots(2, SHOWN // 2, sharey=True)
    for number, axes in zip(chosen, panels.flat, strict=True):
        name, mine = REASONS[number], values[number]
        low, high = (float(v) for v in np.percentile(mine, [2.0, 98.0]))
        if name in LENGTHS:
            grid = np.geomspace(max(low, 1e-2), high, STEPS).astype(np.float32)
            axes.set_xscale('log')
        else:
            grid = np.linspace(low, high, STEPS).astype(np.float32)
        levels = curve(values, int(number), grid)
        axes.plot(grid, levels, color=COLOURS[0], linewidth=1.8)
        for some, colour in ((mine[outlier], COLOURS[1]), (mine[~outlier], COLOURS[2])):
            middle = float(np.clip(np.median(some), grid[0], grid[-1]))
            axes.axvline(middle, color=colour, linewidth=1.2, linestyle='--')
        axes.set_title(f'{name}  ({weight[number]:.2f})', color=INK, fontsize=10)
        axes.axhline(load().threshold_bright, color=FRAME, linewidth=0.8, linestyle=':')
        axes.grid(color=GRID, linewidth=0.6)
        axes.tick_params(colors=INK, labelsize=8)
        for spine in axes.spines.values():
            spine.set_color(FRAME)
        print(name, f'{weight[number]:.3f}', f'{min(levels):.2f} to {max(levels):.2f}')
    for axes in panels[:, 0]:
        axes.set_ylabel('log-odds, mean', color=INK, fontsize=9)
    figure.set_dpi(DPI)
    FigureCanvasAgg(figure).print_png(str(path), metadata={'Software': None})


def main() -> None:
    """Draw points from the known recordings, and the curves."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--data', type=Path, default=Path('../shared/data'), metavar='DIR')
    parser.add_argument('--seed', type=int, default=1, metavar='N')
    options = parser.parse_args()
    rng, found = np.random.default_rng(options.seed), []
    for recording in known_recordings(options.data / 'bags'):
        clouds = read_sweeps(recording)
        if all(map(has_pattern, clouds)):
            sweeps = recorded_sweeps(recording.sensor, clouds, options.seed)
            found += [some_points(sweep, rng) for sweep in sweeps]
    values = np.concatenate([v for v, _ in found], axis=1)
    draw(np.ascontiguousarray(values), np.concatenate([o for _, o in found]), options.output)


if __name__ == '__main__':
    main()
