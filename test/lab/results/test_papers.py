# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the other papers: what is measured, printed and drawn."""

import re
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest
from helpers import ROOT
from helpers.scans import points_of
from naive import pcl_lof as naive
from numpy.testing import assert_allclose

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.builtin import Elevation
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.tuning.training import Training
from lidar_outlier_lab.cli.results import PAPERS
from lidar_outlier_lab.results.papers import kang, leslar, pirotti, roc
from lidar_outlier_lab.results.papers.methods import METHODS, count
from lidar_outlier_lab.results.samples import Sample
from lidar_outlier_lab.simulation.papers import aerial

DOC = ROOT / 'doc' / 'papers'
TABLES = ROOT / 'doc' / 'results' / 'papers'


@pytest.mark.parametrize('name', PAPERS)
def test_pages(name: str) -> None:
    """Every paper has a page with its generated part, steps, differences and open questions."""
    text = (DOC / f'{name}.md').read_text(encoding='utf-8')
    tables = (TABLES / f'{name}.md').read_text(encoding='utf-8')
    assert f'<!-- begin {name}: written by `lidar-outlier-filter results`' in tables
    assert f'](../results/papers/{name}.md)' in text
    for title in ('Step by step', 'Published and reproduced', 'Why ours differ', 'Open questions'):
        assert f'\n## {title}' in text
    assert f'config/papers/{name}' in text
    for line in tables.splitlines():
        if line.startswith('!['):
            assert (TABLES / line.partition('(')[2].removesuffix(')')).is_file(), line


@pytest.mark.parametrize('name', PAPERS)
def test_functions_are_there(name: str) -> None:
    """Every function that a page names exists."""
    text = (DOC / f'{name}.md').read_text(encoding='utf-8')
    found = re.findall(r'`((?:core|evaluation|lidar_outlier_lab)\.[\w.]+)`', text)
    assert found
    for path in found:
        package = '' if path.startswith('lidar_outlier_lab.') else 'lidar_outlier_filter.'
        resolve_name(f'{package}{path}')
    for file, names in re.findall(r'`(core/[\w/.]+\.cpp)`: ((?:`\w+`(?:, )?)+)', text):
        source = (ROOT / 'lidar_outlier_filter' / file).read_text(encoding='utf-8')
        assert all(f' {function}(' in source for function in re.findall(r'\w+', names))


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pages go to papers/ beside the page of the results; only those that are asked for."""
    page = tmp_path / 'doc' / 'results.md'
    command = ['results', '--output', str(page), '--sections', 'papers']
    assert main([*command, '--papers', 'kang2018', '--presets', 'sotoodeh-hod']) == 0
    assert [file.name for file in (tmp_path / 'doc' / 'papers').glob('*.md')] == ['kang2018.md']
    assert not page.exists()
    assert 'papers written to' in capsys.readouterr().out


# Kang ---------------------------------------------------------------------------------------------


def test_published_form_is_in_page_and_file() -> None:
    """The row of the page is the file of the method, with the histogram that section 4 has."""
    parameters = kang.READINGS[kang.AS_PUBLISHED].parameters
    assert FilterParameters().changed(METHODS['kang2018']).of(Elevation) == parameters
    assert parameters.gap > 0
    page = (TABLES / 'kang2018.md').read_text(encoding='utf-8')
    assert page.count(f'| {kang.AS_PUBLISHED} | ') == 2


# Pirotti ------------------------------------------------------------------------------------------


def test_explored() -> None:
    """Areas, thresholds and medians of a cloud in which a far outlier stands out."""
    ball = np.random.default_rng(1).normal(size=(300, 3))
    xyz = np.concatenate([ball, [[40.0, 0, 0], [0, 60.0, 0]]])
    code = np.array([0] * 300 + [Cause.SINGLE, Cause.CLUSTER], np.uint8)
    found = roc.explore(xyz, code, Cause.CLUSTER, (3, 5))
    assert found.auc['SOR'] == [1.0, 1.0]
    assert found.best('SOR') == 0
    assert found.single['SOR'] == found.clustered['SOR'] == [1.0, 1.0]
    best = found.best_of['SOR'][0]
    assert 30 < best.threshold < 60
    assert (best.whole.found, best.whole.lost) == (2, 0)
    assert best.single == best.clustered == (0, 1)
    assert best.below == (0, 0)
    assert list(found.curves['LOF']) == [3]
    values = roc.statistics(Neighbourhood(xyz, 5), 5)
    assert found.median['LOF'][1] == np.median(values['LOF'])


@pytest.mark.parametrize('k', [2, 5, 12])
def test_pcl_lof_against_loops(k: int) -> None:
    """The factors are those of its code, loop by loop."""
    rng = np.random.default_rng(k)
    xyz = np.concatenate([rng.normal(size=(60, 3)), rng.normal(size=(20, 3)) / 10 + 3, [[9, 9, 9]]])
    near = Neighbourhood(xyz, 15)
    assert_allclose(roc.measure_pcl(near, k), naive.factors(xyz.tolist(), k), rtol=1e-12)
    found = pirotti.with_pcl(near, k)
    assert tuple(found) == pirotti.SHOWN
    plain = roc.statistics(near, k)
    for name in ('SOR', 'LOF'):
        assert_allclose(plain[f'{name}2'], np.abs(plain[name] - np.median(plain[name])))
    middle = np.median(found[pirotti.PCL])
    assert_allclose(found[pirotti.PCL2], np.abs(found[pirotti.PCL] - middle))


def test_mean_distance() -> None:
    """On a plane the nearest is 1/2, the second 3/4 of 1 ÷ √density away, on average."""
    assert pirotti.mean_distance(1, 4.0) == pytest.approx(0.25)
    assert pirotti.mean_distance(2, 1.0) == pytest.approx((1 / 2 + 3 / 4) / 2)
    assert round(pirotti.mean_distance(60, aerial.DENSITY), 2) == 0.53
    rng = np.random.default_rng(1)
    xyz = np.concatenate([rng.uniform(0, 30, (31 * 900, 2)), np.zeros((31 * 900, 1))], axis=1)
    inside = (np.abs(xyz[:, :2] - 15) < 13).all(axis=1)
    measured = roc.statistics(Neighbourhood(xyz, 60), 60)['SOR'][inside].mean()
    assert pirotti.mean_distance(60, 31.0) == pytest.approx(measured, rel=0.01)


def test_off_the_line() -> None:
    """Along a straight street the distance is that across it; one beside it stands out."""
    xyz = np.zeros((50, 3))
    xyz[:, 0] = np.arange(50)
    xyz[20, 1] = 3.0
    off = pirotti.with_line(Neighbourhood(xyz, 10), 10)[pirotti.OFF]
    assert off[20] == pytest.approx(3.0)
    assert np.delete(off, 20).max() < 1.0


# Leslar -------------------------------------------------------------------------------------------


def street() -> Sample:
    """Lay out a road of 40 m by 2 m, a wall beside it, and outliers: three together, one alone."""
    x, y = (part.ravel() / 5 for part in np.mgrid[:200, :10])
    road = np.stack([x, y, np.zeros(len(x))], axis=1)
    wall = np.stack([x, np.full(len(x), 2.2), y], axis=1)
    outliers = np.array([[20.0, 1, 1], [20.5, 1, 1], [21.0, 1, 1], [2.0, 1, 1]])
    xyz = np.concatenate([road, wall, outliers])
    bad = np.arange(len(xyz)) >= 2 * len(x)
    points = points_of(xyz)
    data = Training((points,), bad, ~bad, points.t, 1, streamed=False)
    kinds = np.repeat([Kind.ROAD, Kind.FACADE, Kind.AIR], [len(x), len(x), 4]).astype(np.uint8)
    return Sample('leslar-c', 1, data, bad.astype(np.int64), False, False, kinds)  # noqa: FBT003


def test_count() -> None:
    """The road is counted alone; a cloud without road counts nothing."""
    counted = count(street(), {'chain': ['sor'], 'sor.statistic': 'radius'})
    assert counted.whole.total == len(counted.rejected) == 4004
    assert counted.whole.found == 4
    assert counted.road == 0.0
    assert counted.seconds > 0.0
    counted = count(street(), {'chain': ['sor'], 'sor.multiplier': 0.0})
    assert counted.road == pytest.approx(counted.rejected[:2000].mean())


def test_strip() -> None:
    """The stretch with the most outliers, the road and what is above it; no wall."""
    sample = street()
    rejected = sample.data.bad.copy()
    flat, bad, verdicts = leslar.cut_strip(sample, {'all': rejected})
    assert bad.sum() == 3
    assert (verdicts['all'] == bad).all()
    assert np.ptp(flat[:, 0]) < leslar.LENGTH
    assert set(flat[:, 1]) == {0.0, 1.0}
