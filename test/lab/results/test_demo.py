# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The demo: what it leaves, what it says, and what it does not overwrite."""

import re
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import confusion
from lidar_outlier_lab.results import demo
from lidar_outlier_lab.results import pictures as picture
from lidar_outlier_lab.simulation.scenes.demo_street import demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.trajectory import Trajectory

FILES = {
    '.lidar_outlier_filter_demo',
    'drive',
    'classic',
    'default',
    'demo.yaml',
    'before_after.png',
    'report.html',
    'snow',
    'snow_default',
    'snow_before_after.png',
}


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Run the demo once: its folder, and what it printed."""
    output = tmp_path_factory.mktemp('demo') / 'new' / 'demo_output'
    printed = StringIO()
    # The stretch of the street where the second cloud of exhaust is.
    drive = replace(demo_drive(), lines=120, trajectory=Trajectory(start=(15.0, -1.6)))
    with redirect_stdout(printed):
        assert demo.run(output, drive, replace(snow_drive(), lines=2)) == 0
    return output, printed.getvalue()


def test_everything_is_there(made: tuple[Path, str]) -> None:
    """The folder holds recordings, parameters and picture, and nothing is left beside it."""
    output, printed = made
    assert {path.name for path in output.iterdir()} == FILES
    assert [path.name for path in output.parent.iterdir()] == ['demo_output']
    for name in FILES - {'.lidar_outlier_filter_demo'}:
        assert str(output / name) in printed


def test_printed_scores_are_those_of_the_bags(made: tuple[Path, str]) -> None:
    """Precision and recall are printed as the bags hold them; of flakes most are found."""
    output, printed = made
    classic, default, snow = (
        confusion(points.bad, points.rejected)
        for points in (
            read_recording(output / name) for name in ('classic', 'default', 'snow_default')
        )
    )
    for figure in ('precision', 'recall'):
        rows = re.findall(rf'^{figure} +([\d.]+) %(?: +([\d.]+) %)?', printed, re.MULTILINE)
        said = [float(text) for row in rows for text in row if text]
        expected = [100 * getattr(run, figure).ratio for run in (classic, default, snow)]
        assert said == pytest.approx(expected, abs=0.005)
    assert snow.recall.ratio > 0.8
    assert snow.lost < 0.001 * snow.good


@pytest.mark.parametrize('name', ['before_after.png', 'snow_before_after.png'])
def test_pictures(made: tuple[Path, str], name: str) -> None:
    """They have the README's size, stay small, and show what was found and what is left."""
    path = made[0] / name
    assert path.stat().st_size < 400_000
    with Image.open(path) as image:
        assert image.size == (1400, 900)
        pixels = np.asarray(image.convert('RGB')).reshape(-1, 3).astype(np.int64)
    for colour in (picture.FOUND, picture.LEFT):
        away = np.abs(pixels - list(bytes.fromhex(colour[1:]))).max(axis=1)
        assert np.count_nonzero(away < 24) > 200


def test_other_folders_are_refused(tmp_path: Path) -> None:
    """A folder of somebody else's, a file and a link stay as they are."""
    mine, file, link = tmp_path / 'mine', tmp_path / 'file', tmp_path / 'link'
    mine.mkdir()
    (mine / 'thesis.txt').write_text('years of work', encoding='utf-8')
    file.touch()
    link.symlink_to(mine)
    with pytest.raises(RecordingError, match='must be a new folder, or that of an earlier demo'):
        demo.run(mine)
    for path in (file, link):
        with pytest.raises(RecordingError, match='the output must be a folder'):
            demo.run(path)
    assert (mine / 'thesis.txt').read_text(encoding='utf-8') == 'years of work'
    assert {path.name for path in tmp_path.iterdir()} == {'mine', 'file', 'link'}


@pytest.mark.parametrize('error', [KeyboardInterrupt, ValueError])
def test_broken_off_demo_leaves_the_old_one(tmp_path: Path, error: type[BaseException]) -> None:
    """Whatever breaks the demo off, the folder of the earlier one is still whole."""
    output = tmp_path / 'demo'
    with demo._new_folder(output) as folder:
        (folder / 'old').touch()

    def break_off() -> None:
        with demo._new_folder(output) as folder:
            (folder / 'new').touch()
            raise error

    with pytest.raises(error):
        break_off()
    assert {path.name for path in output.iterdir()} == {demo.MARKER, 'old'}
    assert [path.name for path in tmp_path.iterdir()] == ['demo']
