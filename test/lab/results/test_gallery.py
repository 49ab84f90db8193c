# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The failure gallery shows the worst, each once, with what lies around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results import gallery, gallery_picture
from lidar_outlier_lab.results.gallery_picture import Cutout
from lidar_outlier_lab.results.pictures import LEFT, LOST
from lidar_outlier_lab.results.samples import Sample, simulated

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope='module')
def sample() -> Sample:
    """Simulate a drive with outliers near the surface."""
    (made,) = simulated('leslar-c', 102)
    return made


def colours(path: Path) -> set[object]:
    """Read the colours of a picture."""
    with Image.open(path) as image:
        return {colour for _, colour in image.convert('RGB').getcolors(1000) or []}


def test_the_worst() -> None:
    """Highest scores of what was lost, lowest and unknown ones of what was missed; none twice."""
    score = np.array([1.2, 3.0, 2.9, np.nan, 0.3, 0.2, 9.0])
    wrong = np.array([True] * 6 + [False])
    xyz = np.array([0.0, 10.0, 10.5, 20.0, 30.0, 40.0, 50.0])[:, None] * [1.0, 0.0, 0.0]
    assert gallery.worst(score, wrong & (score > 1), xyz, lost=True) == [1, 0]
    assert gallery.worst(score, wrong & ~(score > 1), xyz, lost=False) == [3, 5, 4]
    assert gallery.worst(score, np.zeros(7, np.bool_), xyz, lost=True) == []
    many = np.linspace(2.0, 3.0, 40)
    line = 2.0 * np.arange(40.0)[:, None] * [0.0, 1.0, 0.0]
    found = gallery.worst(many, np.ones(40, np.bool_), line, lost=True)
    assert found == list(range(39, 29, -1))


@pytest.mark.slow
@pytest.mark.parametrize(('threshold', 'lost'), [(0.4, True), (3.0, False)])
def test_failures(sample: Sample, *, threshold: float, lost: bool) -> None:
    """Too strict, it loses good points, which lie on something; too lax, it misses outliers."""
    parameters = FilterParameters().changed({'boosted_trees.threshold': threshold})
    found = [one for one in gallery.failures(sample, parameters) if one.lost is lost]
    assert 3 <= len(found) <= gallery.MOST
    assert all((one.score > 1) == lost for one in found)
    assert {one.what for one in found} <= (
        {'road', 'kerb', 'sidewalk', 'facade', 'glass', 'car', 'pole', 'foliage', 'manhole'}
        if lost
        else {'near surface'}
    )
    for one in found:
        own = one.cutout
        assert gallery.FEWEST <= len(own.flat) <= gallery.SHOWN
        np.testing.assert_array_equal(own.flat[0], 0.0)
        assert (own.bad[0], own.rejected[0]) == (not lost, lost)
        far = np.linalg.norm(own.flat, axis=1) > gallery.REACH
        assert not far.any() or len(own.flat) == gallery.FEWEST
        assert one.largest
        assert all((added > 0) == lost for _, added in one.largest)


@pytest.mark.slow
def test_the_surface_is_level(sample: Sample) -> None:
    """A panel looks along the surface: what is 4 cm above it is as much off on the picture."""
    parameters = FilterParameters().changed({'boosted_trees.threshold': 3.0})
    missed = [one for one in gallery.failures(sample, parameters) if not one.lost]
    even = [one for one in missed if one.sigma < 0.01]
    assert even
    for one in even:
        around = one.cutout.flat[~one.cutout.bad]
        assert abs(np.median(around[:, 1])) == pytest.approx(one.off, abs=0.02)


def test_picture(tmp_path: Path) -> None:
    """The colours of the legend survive the palette; no failure is no error."""
    few = Cutout(np.zeros((2, 2)), np.array([True, False]), np.array([False, True]))
    gallery_picture.draw([('one', few)] * 7, tmp_path / 'panels.png')
    legend = {tuple(bytes.fromhex(colour[1:])) for colour in (LEFT, LOST)}
    assert legend <= colours(tmp_path / 'panels.png')
    gallery_picture.draw([], tmp_path / 'none.png')
    assert (tmp_path / 'none.png').exists()


@pytest.mark.slow
def test_section(tmp_path: Path) -> None:
    """A picture and a row for each failure of all seeds together, the losses first."""
    text = gallery.section(['leslar-c'], (102, 103), tmp_path, lambda _d, _t, _w: None)
    assert 'seeds 102, 103 together' in text
    rows = [line for line in text.splitlines() if line.startswith(('| lost', '| missed'))]
    assert rows
    assert rows == sorted(rows, key=lambda row: row.startswith('| missed'))
    assert '(images/results_failures_leslar_c.png)' in text
    assert (tmp_path / 'results_failures_leslar_c.png').exists()


def test_nothing_to_show(tmp_path: Path) -> None:
    """No preset with a target, or no failure: a sentence."""
    text = gallery.section([], (1,), tmp_path, lambda _d, _t, _w: None)
    assert 'None of the presets with a target' in text
    assert not list(tmp_path.iterdir())
