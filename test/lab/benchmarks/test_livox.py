# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Scanners without rings: what the default does with them, by itself and with `free`."""

import runpy
from typing import Any

import pytest
from helpers import ROOT


@pytest.fixture(scope='module')
def livox() -> dict[str, Any]:
    """Return what the program defines."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / 'benchmarks'))
        return runpy.run_path(str(ROOT / 'benchmarks' / 'livox.py'))


def test_free_scanners_are_judged_well(livox: dict[str, Any]) -> None:
    """Where the sensor is `free`, the default finds the snow of a rosette, and keeps the street."""
    found = {sweep.kind: sweep for sweep in livox['sweeps']('Mid-40', 3)}
    snow, dry = found['light_snow'], found['clean']
    assert snow.outlier.sum() > 100
    found_free = livox['by_default'](snow.points, snow.outlier)
    assert found_free.f1 > 0.95
    assert found_free.false_rejections.ratio < 0.002
    assert livox['by_default'](dry.points, dry.outlier).false_rejections.ratio < 0.002


def test_rows(livox: dict[str, Any]) -> None:
    """A row has F1 and good points lost: of the default, and of each peer where it is best."""
    (snow,) = (sweep for sweep in livox['sweeps']('Mid-40', 3) if sweep.kind == 'light_snow')
    judged = livox['Judged']()
    livox['judge_sweep'](judged, snow)
    best = {}
    for name, (row,) in judged.peers.items():
        top = row.f1.argmax()
        best[name] = f'{row.f1[top]:.2f} ({100 * row.lost[top]:.2f} %)'
    ours = livox['by_default'](snow.points, snow.outlier)
    found = dict(zip(livox['HEAD'][2:], livox['cells']('light_snow', judged, {}), strict=True))
    lost = ours.false_rejections.ratio
    assert found.pop(livox['FREE']) == f'{ours.f1:.2f} ({100 * lost:.2f} %)'
    del found[livox['DARK']]
    assert found == best
