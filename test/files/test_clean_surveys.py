# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What `clean` offers for surveys: classes, marks, strips, many files, and going on later."""

import re
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.neighbours.floor import is_high
from lidar_outlier_filter.core.points.mask import HEAD, MASK_COLUMNS
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report import figures, worst

Capture = pytest.CaptureFixture[str]

BIRD, LOW = 40, 41


def write_las(path: Path, xyz: Any, classes: Any, strips: int = 1) -> Path:
    """Write points in strips one by one."""
    cloud = laspy.LasData(laspy.LasHeader(point_format=6, version='1.4'))
    cloud.header.scales, cloud.header.offsets = [0.001] * 3, [0.0] * 3
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.classification = classes
    cloud.point_source_id = np.arange(len(xyz)) % strips
    cloud.write(path)
    return path


def floor() -> tuple[Any, Any]:
    """Make a floor of class 2 with a bird and a low point of class 1."""
    xyz = np.random.default_rng(1).uniform((0.0, 0.0, 0.0), (20.0, 20.0, 0.02), (1500, 3))
    xyz[BIRD, 2], xyz[LOW, 2] = 30.0, -30.0
    return xyz, np.where(np.isin(np.arange(1500), [BIRD, LOW]), 1, 2).astype(np.uint8)


@pytest.fixture
def cloud(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a cloud, and widen the terminal."""
    monkeypatch.setenv('COLUMNS', '200')
    return write_las(tmp_path / 'a.las', *floor())


@pytest.mark.parametrize(
    ('options', 'low', 'high', 'withheld'),
    [
        ([], 7, 7, 0),
        (['--mark', 'noise'], 7, 18, 0),
        (['--mark', 'withheld'], 1, 1, 1),
        (['--mark-class', '65'], 65, 65, 0),
        (['--mark', 'column'], 1, 1, 0),
        (['--keep-classes', '1'], 1, 1, 0),
        (['--only-classes', '2,3'], 1, 1, 0),
        (['--only-classes', '1'], 7, 7, 0),
    ],
)
def test_marks_and_classes(
    cloud: Path, options: list[str], low: int, high: int, withheld: int
) -> None:
    """Rejected points are marked as requested, except points of classes to keep."""
    assert main(['clean', str(cloud), *options]) == 0
    after = laspy.read(cloud.with_name('a_cleaned.las'))
    classes, flag = np.array(after.classification), np.array(after.withheld)
    assert (classes[LOW], classes[BIRD]) == (low, high)
    assert flag[[LOW, BIRD]].tolist() == [withheld, withheld]
    assert flag.sum() == 2 * withheld
    assert (np.delete(classes, [LOW, BIRD]) == 2).all()


def test_undo(cloud: Path) -> None:
    """By the old classes, and without the column of them, the points are those of the file."""
    before = laspy.read(cloud)
    before.classification[:] = np.arange(1500) % 256
    before.write(cloud)
    for mark in (['--mark', 'noise'], ['--mark-class', '200'], ['--mark', 'column']):
        output = cloud.with_name(f'{mark[-1]}.las')
        arguments = ['clean', str(cloud), '--old-class', '--chain', 'sor', '--output', str(output)]
        assert main([*arguments, *mark]) == 0
        after = laspy.read(output)
        if mark[-1] == 'column':
            assert set(np.flatnonzero(after.outlier)) >= {BIRD, LOW}
            after.remove_extra_dim('outlier')
        else:
            assert (after.classification != before.classification).any()
        after.classification = after.old_class
        after.remove_extra_dim('old_class')
        assert after.points.array.tobytes() == before.points.array.tobytes()


def test_classes_and_the_own_vehicle(tmp_path: Path) -> None:
    """A mask rejects no point of a class that stays as it is, and each point is counted once."""
    xyz = np.random.default_rng(1).uniform((5.0, -1.0, 0.0), (9.0, 1.0, 0.1), (200, 3))
    xyz[:3], xyz[3] = [2.0, 0.1, 0.0], 0.0
    classes = np.full(200, 2, np.uint8)
    classes[:4] = [5, 6, 2, 5]
    path, mask = write_las(tmp_path / 'a.las', xyz, classes), tmp_path / 'car.csv'
    mask.write_text(f'{HEAD}\n{MASK_COLUMNS}\n' + ''.join(f'0,{i},1.8,2.2\n' for i in range(20)))
    settings = {'chain': ['sor'], 'mask': str(mask), 'line_field': 'scanner_channel'}
    parameters, output = FilterParameters().changed(settings), tmp_path / 'out.las'
    report = clean_file(path, output, parameters, CleanOptions(ignore=(5,), keep=(6,)))
    assert laspy.read(output).classification[:4].tolist() == [5, 6, 7, 5]
    assert report.rejected_by['mask'] == 1
    assert (report.ignored, report.spared, report.invalid) == (1, 1, 1)


def test_scores(cloud: Path, capsys: Capture) -> None:
    """Scores are extra bytes of LAS, from which curves can be drawn."""
    assert main(['clean', str(cloud), '--scores', '--chain', 'sor']) == 0
    output = cloud.with_name('a_cleaned.las')
    after = laspy.read(output)
    assert (after.outlier_score[[BIRD, LOW]] > 1).all()
    assert after.outlier_score.dtype == np.float32
    capsys.readouterr()
    assert main(['evaluate', str(output), '--labels', str(cloud), '--codes', '1']) == 0
    assert re.search(r'^area under the ROC curve +1\.0000', capsys.readouterr().out, re.MULTILINE)


def test_known_noise_is_not_seen(tmp_path: Path) -> None:
    """It keeps its class, and hides no outlier beside it: others are judged as if it were away."""
    away, _ = floor()
    away[BIRD] = 10.1, 10.1, 30.1
    beside = np.array([10.0, 10.0, 30.0]) + np.random.default_rng(2).random((60, 3)) / 5
    every = np.concatenate((away, beside))
    found: list[Any] = []
    for xyz, options in ((every, []), (every, ['--ignore-classes', '7,18']), (away, [])):
        path = tmp_path / f'{len(found)}.las'
        write_las(path, xyz, np.where(np.arange(len(xyz)) < 1500, 2, 18).astype(np.uint8))
        assert main(['clean', str(path), '--chain', 'sor', *options]) == 0
        after = laspy.read(path.with_name(f'{path.stem}_cleaned.las'))
        found.append(np.array(after.classification))
    plain, known, alone = found
    assert (plain[BIRD], known[BIRD]) == (2, 7)
    assert (known[1500:] == 18).all()
    assert (alone == known[:1500]).all()


def test_the_picture(cloud: Path, capsys: Capture) -> None:
    """It is a new PNG, also in a dry run; nothing is overwritten, and no other format."""
    picture = cloud.with_name('worst.png')
    arguments = ['clean', str(cloud), '--dry-run', '--picture']
    assert main([*arguments, str(picture)]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert capsys.readouterr().out.endswith(f'\nwritten to {picture}\n')
    assert main([*arguments, str(picture)]) == 1
    assert main([*arguments, str(cloud.with_name('worst.gif'))]) == 1
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f'--picture must be a new file, got {picture}, which exists; remove it, or name another',
        f'--picture must be a name that ends with .png, got {cloud.parent}/worst.gif',
    ]
    assert sorted(path.name for path in cloud.parent.iterdir()) == ['a.las', 'worst.png']


def test_side_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every rejected point has the colour of its own side; places are in the unit of the file."""
    xyz, classes = floor()
    xyz[BIRD, :2] = xyz[LOW, :2] = 10.0
    path = write_las(tmp_path / 'a.las', xyz, classes)
    drawn: dict[str, list[float]] = {figures.ABOVE: [], figures.BELOW: []}

    def note(_axes: object, points: Any, _along: int, colour: str, _size: float) -> None:
        if colour in drawn:
            drawn[colour] += np.round(points[:, 2] / 0.3048).tolist()

    def draw(judged: JudgedFile) -> None:
        found = worst.find(judged)
        assert sorted(np.round(group.middle).tolist() for group in found.groups) == [
            [10, 10, -30],
            [10, 10, 30],
        ]
        figures.draw_worst(judged, found, tmp_path / 'a.png')

    monkeypatch.setattr(figures, '_dots', note)
    parameters = FilterParameters().changed({'chain': ['sor']})
    options = CleanOptions(dry=True, unit='ft')
    clean_file(path, tmp_path / 'out.las', parameters, options, inspect=draw)
    # From the middle of either group; each is seen in the view of the other.
    assert sorted(drawn[figures.ABOVE]) == [0, 60]
    assert sorted(drawn[figures.BELOW]) == [-60, 0]


def test_a_dry_run_writes_nothing(cloud: Path, capsys: Capture) -> None:
    """It prints rejected points by detector and by class."""
    assert main(['clean', str(cloud), '--dry-run', '--keep-classes', '1']) == 0
    # Kept points far below all around are counted, with the chain that finds them.
    said = 'kept points that look like low points: 1; to find more, try --chain boosted_trees,elev'
    assert said in capsys.readouterr().err
    assert main(['clean', str(cloud), '--dry-run']) == 0
    assert [path.name for path in cloud.parent.iterdir()] == ['a.las']
    lines = [line.replace('│', ' ').split() for line in capsys.readouterr().out.splitlines()]
    assert ['1', 'unclassified', '2', '2', '100.000', '%'] in lines
    assert ['2', 'ground', '1,498', '0', '0.000', '%'] in lines
    assert ['below,', 'alone', '1', '1', '1'] in lines
    assert ['above,', 'alone', '1', '1', '1'] in lines


def test_notes_beside_clouds(cloud: Path, tmp_path: Path, capsys: Capture) -> None:
    """Prose in a folder of clouds is skipped by name, and the rest is cleaned."""
    (folder := tmp_path / 'survey').mkdir()
    cloud.rename(folder / cloud.name)
    (folder / 'notes.txt').write_text('flown on Monday\nin light rain\n')
    assert main(['clean', str(folder), '--output', str(tmp_path / 'out'), '--chain', 'sor']) == 0
    said = capsys.readouterr().err.replace('\n', ' ')
    assert 'notes.txt is skipped: it is text without columns of numbers' in said
    assert (tmp_path / 'out' / 'a_cleaned.las').is_file()
    (folder / cloud.name).unlink()
    assert main(['clean', str(folder), '--output', str(tmp_path / 'none')]) == 1
    assert 'survey must be one with .las .laz' in capsys.readouterr().err.replace('\n', ' ')


def test_strips_are_judged_alone(tmp_path: Path) -> None:
    """A bird that two strips see is alone in each of them; points of others do not count."""
    path = write_las(tmp_path / 'b.las', *floor(), strips=2)
    assert main(['clean', str(path), '--strips']) == 0
    assert (laspy.read(tmp_path / 'b_cleaned.las').classification == 7).sum() == 2


def test_high_and_low() -> None:
    """Rejected points are compared with kept points around them on the map."""
    rng = np.random.default_rng(2)
    xyz = rng.uniform((0.0, 0.0, 0.0), (100.0, 100.0, 0.1), (5000, 3))
    xyz[:, 2] += xyz[:, 0]
    rejected = np.zeros(len(xyz), np.bool_)
    rejected[:40] = True
    xyz[:40, 2] += np.where(np.arange(40) % 2, 15.0, -15.0)
    assert is_high(xyz, ~rejected, rejected).tolist() == (np.arange(40) % 2 == 1).tolist()
    assert not is_high(xyz, np.zeros(len(xyz), np.bool_), rejected).any()


def test_failures_of_a_folder_name_the_file(tmp_path: Path, capsys: Capture) -> None:
    """Where a sentence does not name its file, the file comes before it."""
    folder = tmp_path / 'run'
    folder.mkdir()
    rows = ''.join(f'{x},{y},{z}\n' for x, y, z in ROWS)
    (folder / 'far.csv').write_text(f'x,y,z\n1e12,0,0\n{rows}')
    (folder / 'near.csv').write_text(f'x,y,z\n{rows}')
    assert main(['clean', str(folder), '--chain', 'sor']) == 3
    said = capsys.readouterr().err
    assert f'{folder}/far.csv: the coordinates of a point must be within' in said


ROWS = [(i % 9, i % 7, i / 10) for i in range(50)]
HARD = {
    'quoted.csv': 'name,x,y,z\n' + ''.join(f'"a","{x}","{y}","{z}"\n' for x, y, z in ROWS),
    'excel.csv': 'sep=;\nx;y;z\n' + ''.join(f'{x};{y};{z}\n' for x, y, z in ROWS),
    'fortran.xyz': ''.join(f'{x}.0D+02 {y}.0D+02 {z}D+00\n' for x, y, z in ROWS),
    'commented.txt': 'a scan\nof a street\n\n' + ''.join(f'{x} {y} {z}\n' for x, y, z in ROWS),
    'leica.pts': '50\n' + ''.join(f'{x} {y} {z} 7\n' for x, y, z in ROWS),
}


def test_clouds_that_cannot_be_read(tmp_path: Path, capsys: Capture) -> None:
    """In a folder they are failures that are named, not skipped; what is read alone is read."""
    folder = tmp_path / 'run'
    folder.mkdir()
    for name, text in HARD.items():
        (folder / name).write_text(text)
    (folder / 'utf16.csv').write_text(HARD['excel.csv'], encoding='utf-16')
    (folder / 'notes.txt').write_text('A street in May,\nscanned in light rain.\n')
    alone = {
        one.name: main(['clean', str(one), '--chain', 'sor', '--output', f'{tmp_path / one.name}'])
        for one in sorted(folder.iterdir())
    }
    assert alone['quoted.csv'] == 0
    capsys.readouterr()
    assert main(['clean', str(folder), '--chain', 'sor']) == 3
    said = capsys.readouterr()
    assert said.err.count('is skipped') == 1
    assert 'notes.txt is skipped' in said.err
    for name, status in alone.items():
        if name != 'notes.txt':
            assert (name in said.err) == (status != 0), name
            assert (tmp_path / 'run_cleaned' / f'{Path(name).stem}_cleaned.csv').exists() <= (
                status == 0
            )


def test_names_in_80_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Each file of a folder has one line, with its whole name."""
    monkeypatch.setenv('COLUMNS', '80')
    folder = tmp_path / 'run'
    folder.mkdir()
    listed = [f'survey_of_the_northern_valley_tile_{number:03}.csv' for number in range(3)]
    for name in listed:
        (folder / name).write_text('x,y,z\n' + ''.join(f'{x},{y},{z}\n' for x, y, z in ROWS))
    assert main(['clean', str(folder), '--chain', 'sor']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [sum(f'│ {name} ' in line for line in lines) for name in listed] == [1, 1, 1]


def test_more_than_can_be_outliers_is_refused(tmp_path: Path, capsys: Capture) -> None:
    """A method that rejects most of a file does not fit it, unless the user says that it does."""
    (xyz, _), rng = floor(), np.random.default_rng(5)
    scattered = rng.uniform((0.0, 0.0, 2.0), (20.0, 20.0, 60.0), (400, 3))
    xyz = np.concatenate([xyz, scattered])
    path = write_las(tmp_path / 'b.las', xyz, np.ones(len(xyz), np.uint8))
    most = ['clean', str(path), '--set', 'boosted_trees.threshold=0.1']
    assert main(most) == 1
    error = capsys.readouterr().err
    assert 'by trees on the neighbours of each point' in error
    assert '--accept-share' in error
    assert 'boosted_trees.sensor=survey' in error
    assert '--dry-run' in error
    assert [one.name for one in tmp_path.iterdir()] == ['b.las']
    assert main([*most, '--dry-run']) == 0
    assert main([*most, '--accept-share', '2']) == 1
    assert 'from 0 to 1' in capsys.readouterr().err
    assert main([*most, '--accept-share', '1']) == 0
    assert (tmp_path / 'b_cleaned.las').is_file()
    assert (
        main(['clean', str(path), '--accept-share', '0', '--output', str(tmp_path / 'c.las')]) == 1
    )
