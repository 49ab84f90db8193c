# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command `clean`: files in, files out, and a log of what was done."""

import csv
import json
import sqlite3
import struct
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from helpers import names
from helpers.archives import command_of, records
from helpers.cloud_files import columns
from helpers.programs import ended
from pyproj import CRS

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.registry import reasons
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import Verdict
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions
from lidar_outlier_filter.parameters.filter import FilterParameters, describe

Capture = pytest.CaptureFixture[str]

SWEEP = 'actual_scan_20240820_cloud'
AIRBORNE = 'test_semis_2021_0382_6565_LA93_IGN69_cropped'


@pytest.fixture
def folder(real_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy the real clouds to where output may be put beside them; widen the terminal."""
    monkeypatch.setenv('COLUMNS', '200')
    for path in (real_data / 'clouds').iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def expected_verdict(path: Path, **values: Any) -> Verdict:
    """Judge the points of a file in one piece by spatial detectors; parameters with __ for dots."""
    xyz = np.stack(columns(path, 'x', 'y', 'z'), axis=1, dtype=np.float64)
    valid = xyz.any(axis=1)
    zeros = np.zeros(np.count_nonzero(valid), np.int64)
    parameters = {name.replace('__', '.'): value for name, value in values.items()}
    cloud = Points(xyz[valid], zeros, zeros, np.ones(len(zeros), np.bool_))
    verdict = Verdict.untested(len(xyz))
    verdict.put(np.flatnonzero(valid), Chain(FilterParameters().changed(parameters)).judge(cloud))
    return verdict


# What is rejected, and how it is shown


def test_las_is_marked_by_its_class(folder: Path, capsys: Capture) -> None:
    """Rejected points of LAS and LAZ get class 7 in a copy beside the file."""
    path = folder / f'{AIRBORNE}.laz'
    assert main(['clean', str(path), '--chain', 'sor']) == 0
    rejected = expected_verdict(path, chain=['sor']).rejected
    before, after = laspy.read(path), laspy.read(folder / f'{AIRBORNE}_cleaned.laz')
    np.testing.assert_array_equal(
        after.classification, np.where(rejected, 7, before.classification)
    )
    np.testing.assert_array_equal(after.xyz, before.xyz)
    printed = capsys.readouterr()
    assert printed.err == f'{path}: {100 * rejected.mean():.1f} % of its points are rejected\n'
    assert printed.out.endswith(f'written to {folder / AIRBORNE}_cleaned.laz\n')


@pytest.mark.parametrize('name', ['samp41-utm.pcd', 'source.ply'])
def test_others_gain_columns(folder: Path, name: str) -> None:
    """Elsewhere the whole verdict is added: rejected or not, score, detectors."""
    path, expected = folder / name, expected_verdict(folder / name, chain=['lof', 'sor'])
    assert main(['clean', str(path), '--chain', 'lof,sor']) == 0
    copy = path.with_name(f'{path.stem}_cleaned{path.suffix}')
    outlier, score, detectors = columns(copy, 'outlier', 'outlier_score', 'outlier_detectors')
    np.testing.assert_array_equal(outlier, expected.rejected)
    np.testing.assert_array_equal(score, expected.score)
    np.testing.assert_array_equal(detectors, expected.detectors)
    assert outlier.sum() > 100


@pytest.mark.parametrize('name', ['autzen_trim.laz', 'bun0.pcd', 'samp41-utm.pcd', 'source.ply'])
def test_removed_and_separated(folder: Path, name: str) -> None:
    """Kept and rejected points together are the file, point by point."""
    path = folder / name
    outputs = [folder / 'removed', folder / 'kept', folder / 'out']
    removed, kept, out = (output.with_suffix(path.suffix) for output in outputs)
    chain = ['--chain', 'sor', '--set', 'sor.k=8']
    assert main(['clean', str(path), *chain, '--rejected', 'remove', '--output', str(removed)]) == 0
    assert main(['clean', str(path), *chain, '--outliers', str(out), '--output', str(kept)]) == 0
    assert removed.read_bytes() == kept.read_bytes()
    rejected = expected_verdict(path, chain=['sor'], sor__k=8).rejected
    for column, first, second in zip(columns(path), columns(kept), columns(out), strict=True):
        np.testing.assert_array_equal(first, column[~rejected])
        np.testing.assert_array_equal(second, column[rejected])
    assert len(columns(out)[0]) > 10


def test_list_of_the_rejected_points(folder: Path) -> None:
    """CSV and GeoPackage list each: its place in the file's system, score, and reason in words."""
    path, command = folder / 'sample_lareunion_epsg2975.laz', ['clean', '--chain=boosted_trees,sor']
    for name in ('list.csv', 'list.gpkg'):
        assert main([*command, str(path), '--dry-run', '--list', str(folder / name)]) == 0
    assert main([*command, str(path), '--scores']) == 0
    copy = laspy.read(folder / f'{path.stem}_cleaned.laz')
    some = copy[copy['outlier_score'] > 1]
    texts = {number: one.text for number, one in reasons().items()}
    why = [texts.get(n, 'is too far from its nearest neighbours') for n in some['outlier_reason']]
    assert len(set(why)) == 2
    names = {8: 'sor', 64: 'boosted_trees', 72: 'sor boosted_trees'}
    by = [names[bits] for bits in some['outlier_detectors']]
    where = np.flatnonzero(copy['outlier_score'] > 1).tolist()
    expected = list(zip(where, some['outlier_score'].tolist(), by, why, strict=True))
    with (folder / 'list.csv').open(encoding='utf-8', newline='') as stream:
        _, *rows = csv.reader(stream)
    np.testing.assert_array_equal(np.array([row[:3] for row in rows], float), some.xyz)
    assert [(int(i), float(score), *said) for _, _, _, i, score, *said in rows] == expected
    with closing(sqlite3.connect(folder / 'list.gpkg')) as database:
        _, shapes, *about = zip(*database.execute('SELECT * FROM rejected'), strict=True)
        system = 'SELECT definition FROM gpkg_spatial_ref_sys NATURAL JOIN gpkg_geometry_columns'
        ((wkt,),) = database.execute(system)
        (bounds,) = database.execute('SELECT min_x, min_y, max_x, max_y FROM gpkg_contents')
    assert list(zip(*about, strict=True)) == expected
    # OGC 12-128r18, clause 2.1.3: magic, version, little-endian, system; then a point with z.
    found = [struct.unpack('<2sBBiBI3d', shape) for shape in shapes]
    assert {one[:6] for one in found} == {(b'GP', 0, 1, 100_000, 1, 1001)}
    np.testing.assert_array_equal([one[6:] for one in found], some.xyz)
    assert CRS(wkt).to_epsg() == 2975
    assert bounds == (*some.xyz[:, :2].min(axis=0), *some.xyz[:, :2].max(axis=0))


def test_lists_of_several_files(tmp_path: Path, capsys: Capture) -> None:
    """Each lies beside its output, known to its sidecar, and is made anew if lost."""
    words = [*command_of('clean', tmp_path), '--list']
    assert main([*words, 'csv']) == 0
    found = records(tmp_path / 'out')
    assert len(found) == 2
    for record in found.values():
        lines = (tmp_path / 'out' / f'{record.output}.rejected.csv').read_text().splitlines()
        assert len(lines) == 1 + sum(counts['rejected'] for counts in record.topics.values()) > 1
        assert f'{record.output}.rejected.csv' in record.outputs
    path, *others = sorted((tmp_path / 'out').rglob('*.rejected.csv'))
    text = path.read_text()
    path.unlink()
    capsys.readouterr()
    assert main([*words, 'csv']) == 0
    assert f'1 cleaned, {len(others)} done before' in capsys.readouterr().out
    assert path.read_text() == text
    assert [main([*words, 'x.csv']), main([*words, 'csv', '--dry-run'])] == [1, 1]
    one = 'given for one file, or csv or gpkg for each, got 2 files'
    dry = '--list of several files must be left out with --dry-run, got csv'
    assert capsys.readouterr().err == f'--list must be {one}\n{dry}\n'
    path.write_text('mine')
    assert main(words[:-1]) == 0
    assert [file.read_text() for file in (tmp_path / 'out').rglob('*.rejected.csv')] == ['mine']


# Time and scan lines


def test_the_default_runs_where_there_are_lines(folder: Path, capsys: Capture) -> None:
    """All files get the default chain; files without scan lines are reported."""
    files = [folder / f'{SWEEP}.pcd', folder / 'autzen_trim.laz', folder / 'plane.laz']
    assert main(['clean', *map(str, files), '--output', str(folder)]) == 0
    written = [folder / f'{path.stem}_cleaned{path.suffix}.json' for path in files]
    logs = [json.loads(path.read_text()) for path in written]
    assert [log['chain'] for log in logs] == 3 * [['boosted_trees']]
    turns = 'gps_time (s) and 198.81 turns/s, from time and geometry'
    lines = ['time (s) and ring', 'gps_time (s) and scan_direction_flag', turns]
    assert [log['lines'] for log in logs] == lines
    assert [log['rejected'] <= 0.0005 * log['points'] for log in logs] == [False, True, True]
    share = 100 * logs[0]['rejected'] / logs[0]['points']
    said = capsys.readouterr().err
    for sentence in (
        f'{files[0]}: {share:.1f} % of its points are rejected\n',
        f'{files[1]} is in ft (0.3048 m), and is judged in metres',
        '; its coordinate system is NAD_1983_HARN_Lambert_Conformal_Conic\n',
    ):
        assert sentence in said


@pytest.mark.parametrize(('chain', 'fewest'), [('alpha_beta_gamma', 100), ('boosted_trees', 19)])
def test_lines_are_seen_as_by_the_replay(folder: Path, chain: str, fewest: int) -> None:
    """The verdict along lines is that of the points with their time and ring."""
    path = folder / f'{SWEEP}.pcd'
    assert main(['clean', str(path), '--chain', chain]) == 0
    x, y, z, time, ring, intensity = columns(path, 'x', 'y', 'z', 'time', 'ring', 'intensity')
    t = np.rint(time.astype(np.float64) * 1e9).astype(np.int64)
    xyz = np.stack((x, y, z), axis=1, dtype=np.float64)
    cloud = Points(xyz, t, ring.astype(np.int64), np.ones(len(x), np.bool_), intensity=intensity)
    verdict = Chain(FilterParameters().changed({'chain': [chain]})).judge(cloud)
    (outlier,) = columns(folder / f'{SWEEP}_cleaned.pcd', 'outlier')
    np.testing.assert_array_equal(outlier, verdict.rejected)
    assert outlier.sum() > fewest


# Tiles


def test_tiles_by_the_default(folder: Path) -> None:
    """In tiles the default judges without scan lines, as it does in one piece where asked."""
    path = folder / 'autzen_trim.laz'
    one, other = folder / 'one.laz', folder / 'other.laz'
    in_one = ['--set', 'boosted_trees.sensor=survey']
    for output, options in ((one, in_one), (other, ['--tile', '150'])):
        assert main(['clean', str(path), *options, '--output', str(output)]) == 0
    assert one.read_bytes() == other.read_bytes()


# The log


def test_log(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The log has input, parameters, versions, counts and durations, as JSON."""
    path = folder / f'{SWEEP}.pcd'
    settings = folder / 'my.yaml'
    settings.write_text('/**:\n  ros__parameters:\n    sor:\n      k: 7\n')
    options = ['--params', str(settings), '--set', 'lof.min_pts=9', '--chain', 'lof,sor']
    assert main(['clean', str(path), *options]) == 0
    log = json.loads((folder / f'{SWEEP}_cleaned.pcd.json').read_text())
    assert log['input'] == str(path)
    assert log['outputs'] == [str(folder / f'{SWEEP}_cleaned.pcd')]
    assert log['options']['rejected'] == 'mark'
    assert log['coordinates'] == ['x', 'y', 'z']
    assert log['chain'] == ['lof', 'sor']
    assert set(log['parameters']) == {parameter.name for parameter in describe()}
    assert (log['parameters']['sor.k'], log['parameters']['lof.min_pts']) == (7, 9)
    verdict = expected_verdict(path, chain=['lof', 'sor'], sor__k=7, lof__min_pts=9)
    bits = {'lof': 4, 'sor': 8}
    by = {name: np.count_nonzero(verdict.detectors & bit) for name, bit in bits.items()}
    assert log['rejected_by'] == by
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert all(['│', name, '│', f'{count:,}', '│'] in rows for name, count in by.items())
    assert log['rejected'] == sum(by.values()) > 0
    assert log['second_phase'] == 0
    assert (log['points'], log['invalid'], log['untested']) == (24224, 0, 0)
    assert set(log['seconds']) == {'read', 'judge', 'write'}
    assert log['versions']['lidar_outlier_filter'] == __version__
    assert {'python', 'numpy', 'python-neo-lzf'} <= set(log['versions'])


def test_one_file_needs_no_archive(tmp_path: Path) -> None:
    """A single file is cleaned without a module of the archive; status 3: nothing was tested."""
    path = tmp_path / 'few.csv'
    path.write_text('x,y,z\n' + '1,2,3\n' * 3)
    code = (
        'import sys; from lidar_outlier_filter.cli.main import main; status = main(sys.argv[1:]); '
        "print(status, *(name for name in sys.modules if 'lidar_outlier_filter.archive' in name))"
    )
    done = ended(sys.executable, '-c', code, 'clean', path, '--chain', 'sor')
    assert done.stdout.splitlines()[-1] == '3'
    assert done.stderr == f'{path}: sor could test none of its points\n'
    assert (tmp_path / 'few_cleaned.csv').exists()


def test_some_refused_give_status_3(folder: Path, capsys: Capture) -> None:
    """A refused file does not keep others from being cleaned; the exit status reports it."""
    (folder / 'broken.las').write_bytes(b'LASF')
    files = [str(folder / name) for name in ('bun0.pcd', 'broken.las', 'samp41-utm.pcd')]
    assert main(['clean', *files, '--chain', 'sor']) == 3
    printed = capsys.readouterr()
    must_be = 'must be of at least 227 bytes, got 4'
    assert f'the header of {folder}/broken.las {must_be}\n' in printed.err
    rows = [[cell.strip() for cell in line.split('│')] for line in printed.out.splitlines()]
    for path, state in zip(files, ('done', 'refused', 'done'), strict=True):
        assert any(Path(path).name in row and state in row for row in rows)
    assert '2 cleaned, 0 done before, 1 refused, 0 incomplete\n' in printed.out
    assert 'samp41-utm_cleaned.pcd' in names(folder)


def test_a_name_that_is_taken_meanwhile(folder: Path) -> None:
    """Of two runs for one output the one that ends later is refused; the other's files stay."""
    path, output = folder / 'plane.laz', folder / 'out.laz'
    parameters = FilterParameters().changed({'chain': ('sor',)})
    sentence = f'the output must be a new file, got {output}, which exists'
    with pytest.raises(FilterError, match=sentence):
        clean_file(
            path,
            output,
            parameters,
            CleanOptions(rejected='remove'),
            inspect=lambda _: clean_file(path, output, parameters),
        )
    assert [name for name in names(folder) if 'out.laz' in name] == ['out.laz', 'out.laz.json']
    assert json.loads((folder / 'out.laz.json').read_text())['options']['rejected'] == 'mark'


MASK = '# own vehicle, 720 columns, metres\nring,column,near,far\n0,0,0.500,1.500\n'
FEW = 'x,y,z,ring,t\n1,0.001,0,0,0\n' + ''.join(f'{i},{i},0,0,0.00{i}\n' for i in range(5, 9))


@pytest.mark.parametrize('is_real', [False, True])
def test_untested_beside_the_own_vehicle(
    tmp_path: Path, request: pytest.FixtureRequest, capsys: Capture, *, is_real: bool
) -> None:
    """A file is untested if all of its points are, but those on the own vehicle."""
    path, mask = tmp_path / 'untested.csv', tmp_path / 'untested_mask.csv'
    path.write_text(FEW)
    mask.write_text(MASK)
    if is_real:
        folder = request.getfixturevalue('real_data') / 'hostile'
        path, mask = folder / path.name, folder / mask.name
    output = tmp_path / 'out.csv'
    words = ['clean', str(path), '--set', f'mask={mask}', '--output', str(output)]
    assert main(words) == 3
    assert 'could test none of its points' in capsys.readouterr().err
    log = json.loads((tmp_path / 'out.csv.json').read_text())
    assert (log['masked'], log['points'] - log['untested']) == (1, 1)
