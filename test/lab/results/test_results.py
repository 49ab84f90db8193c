# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The sections of the results: run time, real clouds, and the command itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.cli import terminal
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_lab.results import real_clouds
from lidar_outlier_lab.results.papers import roc

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def quiet(_done: int, _total: int, _what: str) -> None:
    """Show no progress."""


def test_statistics() -> None:
    """SOR is the mean distance; SOR2 and LOF2 are distances from the median."""
    xyz = np.random.default_rng(1).normal(size=(60, 3))
    found = roc.statistics(Neighbourhood(xyz, 9), 4)
    apart = np.sort(np.linalg.norm(xyz[:, None] - xyz, axis=2), axis=1)
    np.testing.assert_allclose(found['SOR'], apart[:, 1:5].mean(axis=1))
    for name in ('SOR', 'LOF'):
        middle = np.median(found[name])
        np.testing.assert_array_equal(found[f'{name}2'], np.abs(found[name] - middle))


def test_labelled_clouds(real_data: Path) -> None:
    """Artefacts are found by their class; a cloud without them is none."""
    sample = real_clouds.labelled(real_data / 'clouds' / 'sample_lareunion_epsg2975.laz')
    assert sample is not None
    assert np.count_nonzero(sample.data.bad) == 3
    assert len(sample.data) == 59_712
    assert real_clouds.labelled(real_data / 'clouds' / 'plane.laz') is None


def test_without_real_clouds(tmp_path: Path) -> None:
    """A sentence says so."""
    assert 'There was no folder' in real_clouds.section(tmp_path / 'none', quiet)
    text = real_clouds.section(tmp_path, quiet)
    assert 'No cloud in `clouds` has points of the classes' in text
    assert 'None of the clean recordings could be reached.' in text


def test_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is written by hand stays; each part has its markers; a second run gives the same."""
    monkeypatch.setattr(terminal, 'LINE_PERIOD', 0)
    page = tmp_path / 'page.md'
    page.write_text('# By hand\n')
    command = ['results', '--output', str(page), '--quick', '--presets', 'sotoodeh-hod']
    command += ['--data', str(tmp_path / 'none'), '--sections', 'contest', 'real']
    assert main(command) == 0
    text = page.read_text()
    assert text.startswith('# By hand\n\n<!-- begin default')
    for part in ('default', 'contest', 'real'):
        assert f'<!-- end {part} -->' in text
    assert '| `hierarchical` |' in text
    said = capsys.readouterr()
    assert 'contest written to' in said.out
    # Where there is no terminal, lines say what goes on.
    assert said.err.startswith('results: section contest, 0%\n')
    assert main([*command, '--sections', 'real']) == 0
    assert page.read_text() == text
