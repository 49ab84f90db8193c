# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the other papers: what is measured, printed and drawn."""

from __future__ import annotations

import re
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers import ROOT

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.elevation.parameters import Elevation
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.messages.truth import Cause
from lidar_outlier_lab.results.neighbour_curves import statistics
from lidar_outlier_lab.results.papers import kang, maps, pirotti_buses, roc, side_views
from lidar_outlier_lab.results.papers import sotoodeh_hod as hod
from lidar_outlier_lab.results.papers import sotoodeh_lof as lof
from lidar_outlier_lab.results.papers.pages import PAGES
from lidar_outlier_lab.results.papers.published import HIERARCHICAL, LOF
from lidar_outlier_lab.simulation.papers import aerial, bus_tracks, sotoodeh_clusters

if TYPE_CHECKING:
    from pathlib import Path

DOC = ROOT / 'doc' / 'papers'


@pytest.mark.parametrize('name', PAGES)
def test_pages(name: str) -> None:
    """Every paper has a page with its generated part, steps, differences and open questions."""
    text = (DOC / f'{name}.md').read_text(encoding='utf-8')
    assert f'<!-- begin {name}: written by `lidar-outlier-filter results`' in text
    for title in ('Step by step', 'Theirs and ours', 'Why ours differ', 'Open questions'):
        assert f'\n## {title}' in text
    assert f'config/papers/{name}' in text
    for line in text.splitlines():
        if line.startswith('!['):
            assert (DOC / line.partition('(')[2].removesuffix(')')).is_file(), line


@pytest.mark.parametrize('name', PAGES)
def test_functions_are_there(name: str) -> None:
    """Every function that a page names exists."""
    text = (DOC / f'{name}.md').read_text(encoding='utf-8')
    found = re.findall(r'`((?:core|evaluation|lidar_outlier_lab)\.[\w.]+)`', text)
    assert found
    for path in found:
        package = '' if path.startswith('lidar_outlier_lab.') else 'lidar_outlier_filter.'
        resolve_name(f'{package}{path}')


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pages go to papers/ beside the page of the results; only those that are asked for."""
    page = tmp_path / 'doc' / 'results.md'
    command = ['results', '--output', str(page), '--sections', 'papers']
    assert main([*command, '--papers', 'kang2018', '--presets', 'sotoodeh-hod']) == 0
    assert [file.name for file in (tmp_path / 'doc' / 'papers').glob('*.md')] == ['kang2018.md']
    assert not page.exists()
    assert 'papers written to' in capsys.readouterr().out


# Sotoodeh -----------------------------------------------------------------------------------------


def test_errors_of_2006() -> None:
    """They are those that the paper prints, but for its rounding."""
    assert lof._errors(LOF)[:5] == ('115,820', '3.96 %', '6.95 %', '1.09 %', '3.69 %')


def test_table_of_2007() -> None:
    """Phases see what the earlier left, and each count stands in its column."""
    counts = hod._counts(range(1, 3), 1, cluttered=True)
    assert sum(counts) == 656
    seen = hod._counts(range(1, 3), 2, cluttered=True)
    assert sum(seen) == counts[0] + counts[2]
    text = hod._table([counts, seen], [counts, seen])
    assert '| phase 1: paper | 656 | 569 | 3 | 9 | 75 | 0.46 % | 1.37 % |' in text
    assert '| phase 2: paper | 578 | 565 | 6 | 3 | 4 | 1.04 % | 0.52 % |' in text
    # The slip of the paper: phase 1 leaves 9 outliers, phase 2 sees 7.
    assert HIERARCHICAL[0].missed == 9
    assert HIERARCHICAL[1].outliers == 7


def test_clutter_can_be_lost() -> None:
    """Without it no good point is; with it both phases lose some, and the counts stay."""
    seeds = range(1, 6)
    assert hod._counts(seeds, 1, cluttered=False)[1] == 0
    for phase in (1, 2):
        kept, lost, left, found = hod._counts(seeds, phase, cluttered=True)
        assert lost / (kept + lost + left + found) > 0.001
    scene = sotoodeh_clusters.simulate(1, cluttered=True)
    assert (len(scene.xyz), scene.outlier.sum()) == (656, 84)


# Kang ---------------------------------------------------------------------------------------------


def test_readings() -> None:
    """The letter takes low points only; in space neighbours are others."""
    rng = np.random.default_rng(1)
    xyz = rng.uniform(0, [40, 40, 0.2], (900, 3))
    xyz[7, 2], xyz[8, 2] = -9.0, 9.0
    rejected = {name: kang.judge(xyz, one).rejected for name, one in kang.READINGS.items()}
    assert rejected[kang.LETTER][7]
    assert not rejected[kang.LETTER][8]
    assert rejected[kang.OURS][[7, 8]].all()
    assert kang._with(Elevation(sides='low'), 60) == Elevation(sides='low', k=60)
    assert {one.neighbours for one in kang.READINGS.values()} == {'map', 'space'}


# Pirotti ------------------------------------------------------------------------------------------


def test_laws_of_distances() -> None:
    """Half of the draws are below the mean of the ends, or below their geometric mean."""
    rng = np.random.default_rng(1)
    for law, middle in ((aerial.uniform, 100.5), (aerial.log_uniform, np.sqrt(200.0))):
        draws = np.array([law(rng, 1.0, 200.0) for _ in range(2000)])
        assert draws.min() >= 1
        assert draws.max() <= 200
        assert np.mean(draws < middle) == pytest.approx(0.5, abs=0.04)


def test_explored() -> None:
    """Areas, thresholds and medians of a cloud in which a far outlier stands out."""
    rng = np.random.default_rng(1)
    xyz = np.concatenate([rng.normal(size=(300, 3)), [[40.0, 0, 0], [0, 60.0, 0]]])
    code = np.zeros(302, np.uint8)
    code[300:] = Cause.SINGLE, Cause.CLUSTER
    found = roc.explore(xyz, code, Cause.CLUSTER, (3, 5))
    assert found.auc['SOR'] == [1.0, 1.0]
    assert found.best('SOR') == 0
    assert found.single['SOR'] == found.clustered['SOR'] == [1.0, 1.0]
    assert 30 < found.limit['SOR'][0] < 60
    assert list(found.curves['LOF']) == [3]
    values = statistics(Neighbourhood(xyz, 5), 5)
    assert found.median['LOF'][1] == np.median(values['LOF'])


def test_off_the_line() -> None:
    """Along a straight street the distance is that across it; one beside it stands out."""
    xyz = np.zeros((50, 3))
    xyz[:, 0] = np.arange(50)
    xyz[20, 1] = 3.0
    off = pirotti_buses.with_line(Neighbourhood(xyz, 10), 10)[pirotti_buses.OFF]
    assert off[20] == pytest.approx(3.0)
    assert np.delete(off, 20).max() < 1.0


def test_hard_tracks() -> None:
    """Some outliers are nearer to the route than the easy ones, and as many as the line says."""
    for line, how in bus_tracks.HARD.items():
        track = bus_tracks.track(how, how.outliers, np.random.default_rng([1, line]))
        assert len(track) == how.points
        bad = track['label'] != Cause.GOOD
        assert bad.sum() == how.outliers
        xy = np.stack([track['x'], track['y']], axis=1).astype(float)
        near = np.array([np.linalg.norm(xy[~bad] - one, axis=1).min() for one in xy[bad]])
        assert np.quantile(near, 0.2) < bus_tracks.OFF


# Pictures -----------------------------------------------------------------------------------------


def test_side_views(tmp_path: Path) -> None:
    """Panels of a row have the same axes, whatever is left in them."""
    flat = np.random.default_rng(1).normal(size=(40, 2))
    bad = np.arange(40) < 4
    views = [
        side_views.View('before', flat, bad, np.ones(40, np.bool_)),
        side_views.View('after', flat, bad, np.arange(40) > 6, marks=True),
    ]
    side_views.draw([views, views], tmp_path / 'views.png', ('x, m', 'z, m'))
    assert (tmp_path / 'views.png').read_bytes().startswith(b'\x89PNG')
    low, high = side_views._limits(views)
    assert (low < flat.min(axis=0)).all()
    assert (high > flat.max(axis=0)).all()


def test_maps(tmp_path: Path) -> None:
    """Range images with holes, and points in classes."""
    pixels = np.array([[1.0, np.nan, 2.0], [1.5, 1.0, 1.0]])
    maps.draw_images([maps.Grey('a', pixels, 1.0, 2.0)] * 2, tmp_path / 'images.png')
    flat = np.random.default_rng(1).normal(size=(9, 2))
    one = maps.Classes('b', flat, np.arange(9) % 2, ('#000000', '#ff0000'), ('good', 'bad'))
    maps.draw_classes([one, one], tmp_path / 'classes.png')
    for name in ('images', 'classes'):
        assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
