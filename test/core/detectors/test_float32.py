# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Coordinates that are too far from the origin for float32: it is said, once."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_outlier_filter import CloudFilter
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.points.points import COARSEST, too_coarse

SENTENCE = 'float32 coordinates of 131073 m come in steps of 0.0156 m, and what is finer is lost'
FIRST = 131_072.0  # metres, from where on steps are more than a centimetre


def test_where_steps_are_too_long() -> None:
    """From 2^17 m on, on any axis that is float32, in metres or feet."""
    xyz, valid = np.ones((100, 3)), np.ones(100, np.bool_)
    single = (True, True, True)
    assert np.spacing(np.float32(FIRST)) > COARSEST >= np.spacing(np.float32(FIRST - 1))
    for axis in range(3):
        far = xyz.copy()
        far[:, axis] = -FIRST
        assert too_coarse(far, valid, single)
        assert not too_coarse(far, valid, [axis != other for other in range(3)])
        assert not too_coarse(far + 1, valid, single)
    # In feet the number is larger, and the step in metres shorter.
    assert not too_coarse(xyz * FIRST, valid, single, unit=0.3048)
    assert too_coarse(xyz * 2 * FIRST, valid, single, unit=0.3048)


def test_a_far_point_says_nothing() -> None:
    """What counts is where most are; missing returns are nowhere."""
    xyz, valid = np.ones((100, 3)), np.ones(100, np.bool_)
    xyz[::3] = 9e8
    assert not too_coarse(xyz, valid, (True, True, True))
    xyz[::2] = 9e8
    valid[::2] = valid[::3] = False
    assert not too_coarse(xyz, valid, (True, True, True))
    assert not too_coarse(xyz, np.zeros(100, np.bool_), (True, True, True))


def cloud(kind: str, far: float) -> NDArray[np.void]:
    """Make a cloud of a profile scanner at a distance."""
    rows = np.zeros(500, [('x', kind), ('y', 'f4'), ('z', 'f4'), ('t', 'u4')])
    rows['x'], rows['y'] = far, np.arange(500) * 0.01
    rows['t'] = np.arange(500) * 50_000
    return rows


@pytest.mark.parametrize(
    ('kind', 'far', 'count'), [('f4', 131_073.0, 1), ('f8', 5e6, 0), ('f4', 100.0, 0)]
)
def test_a_stream(kind: str, far: float, count: int) -> None:
    """Once in its life, whatever the layout; float64 carries what maps need."""
    said: list[str] = []
    clean = CloudFilter(chain=['sor'], warn=said.append)
    for number in range(3):
        clean.push(cloud(kind, far), stamp=number * 100_000_000)
    assert sum('float32' in text for text in said) == count
    assert sum(SENTENCE in text for text in said) == count


@pytest.mark.parametrize('kind', ['float', 'double'])
def test_clean(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """On standard error and in the log, of a file whose coordinates are float32."""
    path = tmp_path / 'cloud.ply'
    rows = np.random.default_rng(1).normal(size=(60, 3))
    rows[:, 1] = 131_073.0
    axes = ''.join(f'property {kind} {axis}\n' for axis in 'xyz')
    body = ''.join(f'{x} {y} {z}\n' for x, y, z in rows.tolist())
    path.write_text(f'ply\nformat ascii 1.0\nelement vertex 60\n{axes}end_header\n{body}')
    assert main(['clean', str(path), '--chain', 'sor']) == 0
    said = capsys.readouterr().err
    assert said.count(f'{path}: {SENTENCE}') == (kind == 'float')
    log = (tmp_path / 'cloud_cleaned.ply.json').read_text('utf-8')
    assert log.count(json.dumps(SENTENCE)[1:-1]) == (kind == 'float')
