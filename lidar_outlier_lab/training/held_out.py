# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What trees find on sensors that they were not trained on, and the threshold chosen by that."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Floats, Reals
from lidar_outlier_filter.core.detectors.boosted_trees.trees import find_valleys

CLEAN, STREET = 'clean', 'street'  # kinds of sweeps that are no weather
LIMITS = np.arange(-50, 251) / 50.0  # log-odds tried as thresholds
# Share of clean sweeps that may be rejected, mean over the sensors but the worst.
MAX_CLEAN_SHARE = 0.00125
MIN_OUTLIERS = 100  # outliers of a sweep from which on it is judged
NO_WEATHER = (CLEAN, STREET, 'mixed', 'ghosts')  # kinds that do not choose
DIGITS = 4


class HeldOut(NamedTuple):
    """A sweep of a sensor that was left out, judged at every threshold of several.

    Attributes
    ----------
    sensor, kind : of the sweep
    f1 : (T,) float64
    lost : (T,) float64
        Share of the good points that are rejected.
    outliers : how many there are
    best : the greatest F1 of thresholds that no valley lowers

    """

    sensor: str
    kind: str
    f1: Floats
    lost: Floats
    outliers: int
    best: float


def judge_at_all(  # noqa: PLR0913  what is judged, and how
    sensor: str,
    kind: str,
    outlier: Bools,
    score: Reals,
    limits: Floats = LIMITS,
    drop: float = 0.0,
) -> HeldOut:
    """Count what every threshold rejects: points whose log-odds exceed it, or its valley."""
    bad, good = np.sort(score[outlier]), np.sort(score[~outlier])

    def count(limits: Floats) -> tuple[Floats, Floats]:
        found = len(bad) - np.searchsorted(bad, limits, 'right')
        lost = len(good) - np.searchsorted(good, limits, 'right')
        return 2.0 * found / np.maximum(found + lost + len(bad), 1), lost / max(len(good), 1)

    best = float(count(limits)[0].max())
    return HeldOut(sensor, kind, *count(find_valleys(score, limits, drop)), len(bad), best)


def choose_threshold(sweeps: Sequence[HeldOut], most: float = MAX_CLEAN_SHARE) -> float:
    """Choose the threshold that leaves clean sweeps alone, and is best where least is found.

    Best is the mean F1 of the worst quarter of all pairs of sensor and weather. The sensor whose
    clean sweeps lose most is left out of their mean, where there are several: else it alone would
    decide. Where no threshold leaves them alone, the greatest one.
    """
    clean = _by_group([s for s in sweeps if s.kind == CLEAN], lambda s: s.sensor, lambda s: s.lost)
    weather = [s for s in sweeps if s.kind not in NO_WEATHER and s.outliers >= MIN_OUTLIERS]
    cells = _by_group(weather, lambda s: f'{s.sensor} {s.kind}', lambda s: s.f1)
    worth = worst_quarter([*cells.values()]) if cells else np.zeros(len(LIMITS))
    lost = np.sort(list(clean.values()), axis=0) if clean else np.zeros((1, len(LIMITS)))
    rejected = np.mean(lost[: max(len(lost) - 1, 1)], axis=0)
    allowed = rejected <= most
    if not allowed.any():
        return float(LIMITS[-1])
    return float(LIMITS[int(np.argmax(np.where(allowed, worth, -1.0)))])


def worst_quarter(cells: Sequence[Reals]) -> Floats:
    """Return the mean of the least quarter of values, of each column by itself; at least of one."""
    some: Floats = np.sort(np.asarray(cells, np.float64), axis=0)[: max(len(cells) // 4, 1)]
    return some.mean(axis=0)


def figures(sweeps: Sequence[HeldOut], threshold: float) -> dict[str, Any]:
    """Say what a threshold gives: by weather, by clean recording, and by street."""
    at = int(np.argmin(np.abs(LIMITS - threshold)))
    weather = [s for s in sweeps if s.kind not in {CLEAN, STREET}]
    f1, lost = _weather(weather, lambda s: s.f1), _weather(weather, lambda s: s.lost)
    best = _weather(weather, lambda s: np.array([s.best]))
    clean = _by_group([s for s in sweeps if s.kind == CLEAN], lambda s: s.sensor, lambda s: s.lost)
    streets = [s for s in sweeps if s.kind == STREET]
    street = _by_group(streets, lambda s: s.sensor, lambda s: s.f1)
    return {
        'weather': {
            kind: {
                'f1': round(float(f1[kind][at]), DIGITS),
                'best_f1': round(float(best[kind][0]), DIGITS),
                'lost': round(float(lost[kind][at]), DIGITS + 1),
            }
            for kind in f1
        },
        'clean_rejected': {name: round(float(v[at]), DIGITS + 2) for name, v in clean.items()},
        'street_f1': {name: round(float(v[at]), DIGITS) for name, v in street.items()},
    }


def _weather(sweeps: Sequence[HeldOut], value: Callable[[HeldOut], Floats]) -> dict[str, Floats]:
    """Return the mean of each weather over sensors, each of which counts the same."""
    found: dict[str, Floats] = {}
    judged = [sweep for sweep in sweeps if sweep.outliers >= MIN_OUTLIERS]
    for kind in dict.fromkeys(sweep.kind for sweep in judged):
        some = [sweep for sweep in judged if sweep.kind == kind]
        means = _by_group(some, lambda s: s.sensor, value)
        found[kind] = np.mean(list(means.values()), axis=0)
    return found


def _by_group(
    sweeps: Sequence[HeldOut],
    group: Callable[[HeldOut], str],
    value: Callable[[HeldOut], Floats],
) -> dict[str, Floats]:
    """Return the mean value of each group."""
    names = dict.fromkeys(group(sweep) for sweep in sweeps)
    return {
        name: np.mean([value(sweep) for sweep in sweeps if group(sweep) == name], axis=0)
        for name in names
    }
