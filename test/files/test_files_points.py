# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Which columns of a file are coordinates, time and scan lines."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyarrow as pa
import pytest
from helpers.cloud_files import write_las
from helpers.e57_files import write_e57
from helpers.scans import Drive
from pyarrow import parquet

from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core.detectors.boosted_trees.methods import find_either
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import judge
from lidar_outlier_filter.core.detectors.boosted_trees.trees import PROFILE_MODEL
from lidar_outlier_filter.errors import CloudError, FilterError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.mirror_lines import EDGE, find_lines
from lidar_outlier_filter.files.points import Loaded, choose_coordinates, load, number_rows
from lidar_outlier_filter.parameters.filter import FilterParameters


def table(folder: Path, text: str) -> Path:
    """Write a table."""
    path = folder / 'table.csv'
    path.write_text(text)
    return path


def loaded(path: Path, *columns: str, timed: bool = True, **values: Any) -> Loaded:
    """Load a file; parameters with __ for the dot."""
    parameters = FilterParameters().changed(
        {name.replace('__', '.'): value for name, value in values.items()}
    )
    file = open_cloud(path)
    return load(file, choose_coordinates(file, columns), parameters, timed=timed)


@pytest.mark.parametrize(
    ('names', 'requested', 'expected'),
    [
        ('z,w,y,x', '', 'x,y,z'),
        ('X,Y,Z', '', 'X,Y,Z'),
        ('x,X,y,z', '', 'x,y,z'),
        ('lat,lon,speed', 'lon,lat', 'lon,lat'),
        ('a,b,c', '', 'got no numbers x and y and z in the columns a, b, c'),
        ('x,y,c', '', 'read with --columns X,Y,Z, got no numbers z in the columns x, y, c'),
        ('a,b,c', 'a', 'the coordinates must be two or three columns, got a'),
        ('a,b,c', 'a,a', 'the coordinates must be two or three columns, got a, a'),
        ('a,b,c,d', 'a,b,c,d', 'the coordinates must be two or three columns, got a, b, c, d'),
        ('a,b,c', 'a,x', 'got the columns a, b, c'),
    ],
)
def test_coordinates(tmp_path: Path, names: str, requested: str, expected: str) -> None:
    """Named columns, or x, y and z in any order and case; others are refused by name."""
    path = table(tmp_path, f'{names}\n' + ','.join('1234'[: names.count(',') + 1]) + '\n')
    try:
        found = ','.join(
            choose_coordinates(open_cloud(path), requested.split(',') if requested else ())
        )
    except CloudError as err:
        found = str(err)
    assert found.endswith(expected)


def test_two_coordinates(tmp_path: Path) -> None:
    """With two coordinates z is 0; missing values and all zeros are missing returns."""
    found = loaded(table(tmp_path, 'lat,lon\n45.1,7.2\n,7.3\n0,0\n0,7\n'), 'lat', 'lon')
    expected = [[45.1, 7.2, 0], [np.nan, 7.3, 0], [0, 0, 0], [0, 7, 0]]
    np.testing.assert_array_equal(found.points.xyz, expected)
    assert found.points.valid.tolist() == [True, False, False, True]
    assert (found.lines, found.lack) == ('', 'no column with the time of each point')


@pytest.mark.parametrize(
    ('names', 'values'),
    [
        ('ring,timestamp,c', {'time_unit': 's'}),
        ('a,b,c', {'time_field': 'b', 'line_field': 'a', 'sigma_field': 'c'}),
    ],
)
def test_time_and_ring(tmp_path: Path, names: str, values: dict[str, Any]) -> None:
    """Time and ring, by their usual names or as named, give times in nanoseconds and lines."""
    rows = '1,2,3,0,1.5,0.01\n4,5,6,1,1.5000001,0.02\n,8,9,1,,\n'
    found = loaded(table(tmp_path, f'x,y,z,{names}\n{rows}'), **values)
    assert found.points.t.tolist() == [1_500_000_000, 1_500_000_100, 0]
    assert found.points.line.tolist() == [0, 1, 1]
    ring, time, _ = names.split(',')
    assert (found.lines, found.lack) == (f'{time} (s) and {ring}', '')
    sigma = [0.01, 0.02, np.nan] if 'sigma_field' in values else None
    np.testing.assert_array_equal(found.points.sigma, sigma)


def test_time_is_not_asked_for(tmp_path: Path) -> None:
    """Where no detector needs them, times that make no sense do no harm."""
    path = table(tmp_path, 'x,y,z,ring,time\n1,2,3,0.5,1e300\n')
    assert loaded(path, timed=False).points.line.tolist() == [0]
    with pytest.raises(CloudError, match='the time of a point must be finite and within 73 years'):
        loaded(path)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ({'time_field': 'when'}, "time_field must be a column of {}: x, y, z, t, s, got 'when'"),
        ({'line_field': 'row'}, "line_field must be a column of {}: x, y, z, t, s, got 'row'"),
        ({'line_field': 's'}, "column 's' must be of whole numbers, got others"),
        (
            {'line_source': 'field'},
            'the line column must be of a usual name, such as ring',
        ),
        ({'line_source': 'row'}, "line_source must be 'auto', 'field' or 'angle' for a file, got"),
        ({'line_source': 'angle'}, 'the angle column must be one of scan_angle, scan_angle_rank'),
        ({'angle_field': 'phi', 'line_source': 'angle'}, 'angle_field must be a column of {}'),
        (
            {'sigma_field': 's', 'line_source': 'angle', 'angle_field': 't'},
            "column 's' must be from 1e-09 to 1e+09 m, got -0.5",
        ),
    ],
)
def test_refused_columns(tmp_path: Path, values: dict[str, Any], sentence: str) -> None:
    """Columns that are not there, or cannot be what they shall be, are refused."""
    path = table(tmp_path, 'x,y,z,t,s\n1,2,3,0,0.5\n4,5,6,1,-0.5\n4,5,6,9,0.5\n4,5,6,0,0.5\n')
    with pytest.raises(FilterError) as caught:
        loaded(path, **values)
    assert sentence.format(path) in str(caught.value)


def test_absurd_coordinates(tmp_path: Path) -> None:
    """As in clouds, impossible coordinates are refused."""
    path = table(tmp_path, 'x,y,z\n1,2,3\n1,-1.0000001e9,3\n')
    with pytest.raises(CloudError, match=r'^the coordinates of a point must be within 1e\+09 m'):
        loaded(path, 'x', 'y', 'z', timed=False)


EXACT = 1_493_800_000_000_000_001  # nanoseconds; a float64 knows the hundreds only


def with_gaps(path: Path, rows: Sequence[tuple[float | None, ...]]) -> Path:
    """Write x, y, z, ring and timestamp into a table of any format; None is missing."""
    names = ('x', 'y', 'z', 'ring', 'timestamp')
    if path.suffix == '.csv':
        texts = [','.join('' if one is None else str(one) for one in row) for row in rows]
        path.write_text('\n'.join([','.join(names), *texts]))
    elif path.suffix == '.sqlite':
        with closing(sqlite3.connect(path)) as database, database:
            database.execute('CREATE TABLE t (x REAL, y REAL, z REAL, ring, timestamp INTEGER)')
            database.executemany('INSERT INTO t VALUES (?, ?, ?, ?, ?)', rows)
    else:
        columns = zip(*rows, strict=True)
        parquet.write_table(pa.table(dict(zip(names, map(pa.array, columns), strict=True))), path)
    return path


@pytest.mark.parametrize(
    ('missing', 'chunk'), [((4,), 1), ((0, 1, 2, 7), 3), (tuple(range(9)), 100)]
)
@pytest.mark.parametrize('suffix', ['csv', 'sqlite', 'parquet'])
def test_times_are_exact_beside_a_row_of_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    suffix: str,
    missing: tuple[int, ...],
    chunk: int,
) -> None:
    """A missing return without time and line rounds neither time nor line of the others."""
    module = 'rows' if suffix == 'csv' else suffix
    monkeypatch.setattr(f'lidar_outlier_filter.files.{module}.CHUNK_ROWS', chunk)
    times = [EXACT + i for i in range(10)]
    rings = [2**53 + 1 + i for i in range(10)]
    rows: list[tuple[float | None, ...]] = [
        (0.0, 0.0, 0.0, None, None) if i in missing else (1.5, 2.0, 3.0, rings[i], times[i])
        for i in range(10)
    ]
    found = loaded(with_gaps(tmp_path / f'table.{suffix}', rows))
    known = np.isin(np.arange(10), missing, invert=True)
    np.testing.assert_array_equal(found.points.valid, known)
    assert found.points.t.tolist() == np.where(known, times, 0).tolist()
    assert found.points.line.tolist() == np.where(known, rings, 0).tolist()
    assert found.lines == 'timestamp (ns) and ring'


@pytest.mark.parametrize('suffix', ['csv', 'sqlite', 'parquet'])
def test_a_point_without_time_or_line(tmp_path: Path, suffix: str) -> None:
    """A point without time, or without line where there are lines, is refused."""
    for name, gap, sentence in (
        ('a', (0, None), r'the time of a point must be finite .* got nan'),
        ('b', (None, EXACT), "column 'ring' must be of whole numbers, got others"),
    ):
        path = with_gaps(tmp_path / f'{name}.{suffix}', [(1.5, 2, 3, 0, EXACT), (1.5, 2, 3, *gap)])
        with pytest.raises(CloudError, match=sentence):
            loaded(path)


@pytest.mark.parametrize('suffix', ['csv', 'sqlite', 'parquet'])
def test_gaps_in_coordinates_and_marks(tmp_path: Path, suffix: str) -> None:
    """Whole numbers with gaps may be coordinates, sigma and angles: there a gap is NaN."""
    rows: list[tuple[float | None, ...]] = [
        (1, 2, 3, 1, EXACT),
        (4, None, 6, 2, EXACT + 1),
        (None, None, 9, None, None),
    ]
    nan = np.nan
    found = loaded(with_gaps(tmp_path / f'a.{suffix}', rows), sigma_field='ring')
    np.testing.assert_array_equal(found.points.xyz, [[1, 2, 3], [4, nan, 6], [nan, nan, 9]])
    assert found.points.t.tolist() == [EXACT, 0, 0]
    np.testing.assert_array_equal(found.points.sigma, [1, 2, nan])


def las(folder: Path, **columns: Any) -> Path:
    """Write a file with some dimensions given."""
    count = len(columns['gps_time'])
    usual: dict[str, Any] = {'X': np.arange(1, count + 1)}
    usual['return_number'] = np.ones(count, np.uint8)
    return write_las(folder / 'made.las', count, **usual | columns)


def groups(line: np.ndarray[Any, Any]) -> list[int]:
    """Replace the number of each line by its order of appearance."""
    first = list(dict.fromkeys(line.tolist()))
    return [first.index(one) for one in line.tolist()]


@pytest.mark.parametrize(
    ('name', 'values', 'lines'),
    [
        ('scan_direction_flag', [0, 0, 0, 1, 1, 0, 0, 1], [0, 0, 0, 1, 1, 2, 2, 3]),
        # A line ends behind a shot with a return at the edge.
        ('edge_of_flight_line', [0, 0, 1, 0, 0, 1, 0, 0], [0, 0, 0, 1, 1, 1, 2, 2]),
        # A line ends where the angle steps back by more than half of its span.
        ('scan_angle', [-3000, 0, 3000, -3000, 0, 3000, -2900, 100], [0, 0, 0, 1, 1, 1, 2, 2]),
    ],
)
def test_lines_by_one_column(
    tmp_path: Path, name: str, values: list[int], lines: list[int]
) -> None:
    """Each column of the mirror ends lines, in the order of time."""
    mixed = np.array([7, 0, 3, 1, 6, 2, 5, 4])
    path = las(tmp_path, gps_time=mixed / 10, **{name: np.array(values)[mixed]})
    found = loaded(path)
    assert found.lines == f'gps_time (s) and {name}'
    in_time = np.argsort(mixed)
    assert groups(found.points.line[in_time]) == lines
    assert found.points.t[in_time].tolist() == [i * 10**8 for i in range(8)]


@pytest.mark.parametrize('sense', [1, -1])
def test_lines_by_angle_over_open_ground(tmp_path: Path, sense: int) -> None:
    """Lines of a turning mirror may span little of the angle; a swinging one begins no line."""
    spans = [(-90, 91), (-20, 21), (-20, 21), (-90, 91), (0, 21), (-20, 1), (-90, 91)]
    angle = np.concatenate([np.arange(*span) for span in spans]) * sense
    turn = np.repeat(np.arange(len(spans)), [high - low for low, high in spans])
    path = las(tmp_path, gps_time=np.arange(len(angle)) / 100, scan_angle=angle * 166)
    assert groups(loaded(path).points.line) == turn.tolist()
    swing = np.tile([*range(-90, 90), *range(90, -90, -1)], 6) * sense
    kept = np.flatnonzero(np.random.default_rng(2).random(len(swing)) < 0.2)
    assert np.abs(np.diff(swing[kept])).max() > 15
    path = las(tmp_path, gps_time=kept / 100, scan_angle=swing[kept] * 166)
    assert loaded(path).lines == ''


def test_a_named_angle_decides_alone(tmp_path: Path) -> None:
    """The scan angle decides if a parameter names it."""
    angle = np.array([-3000, 0, 3000, -3000, 0, 3000, -2900, 100])
    direction = np.arange(8) % 2
    path = las(tmp_path, gps_time=np.arange(8), scan_angle=angle, scan_direction_flag=direction)
    assert groups(loaded(path).points.line) == list(range(8))
    for found in (loaded(path, line_source='angle'), loaded(path, angle_field='scan_angle')):
        assert groups(found.points.line) == [0, 0, 0, 1, 1, 1, 2, 2]


def test_sources_are_apart_and_returns_together(tmp_path: Path) -> None:
    """Flight lines that overlap in time have own lines; all returns of a shot are on one."""
    path = las(
        tmp_path,
        gps_time=np.array([0, 0, 1, 1, 2, 2, 3, 3]),
        scan_direction_flag=np.array([0, 1, 0, 1, 1, 0, 1, 0]),
        point_source_id=np.array([8, 9, 8, 9, 8, 9, 8, 9]),
        return_number=np.array([1, 1, 1, 1, 1, 1, 1, 2]),
    )
    assert groups(loaded(path).points.line) == [0, 1, 0, 1, 2, 3, 2, 3]


@pytest.mark.parametrize('source', ['point_source_id', 'user_data'])
def test_scanners_of_a_vehicle(tmp_path: Path, source: str) -> None:
    """Two heads in coordinates of a map, some shots with two returns: each has its lines."""
    drives = [Drive(30 + k, 0.02, lines=16, shots=800, strays=0.005) for k in range(2)]
    columns = []
    for k, drive in enumerate(drives):
        behind = np.arange(len(drive.t)) % 25 == 0
        far = drive.eye + 1.2 * drive.far[:, None] * drive.beam
        second = np.append(np.zeros(len(behind), np.int64), np.ones(behind.sum(), np.int64))
        xyz = np.concatenate([drive.points.xyz, far[behind]]) + 20.0 * k
        t = 3.1e8 + np.append(drive.t, drive.t[behind]) * 1e-9 + 0.0013 * k
        angle = np.append(drive.angle, drive.angle[behind]) * (30000 / np.pi) - 30000
        bad = np.append(drive.stray, behind[behind])
        head = np.full(len(t), k + 1)
        columns.append([*np.rint(xyz.T * 1000), t, angle.astype(int), second + 1, bad, head])
    x, y, z, t, angle, number, bad, head = map(np.concatenate, zip(*columns, strict=True))
    order = np.lexsort((number, t))
    path = tmp_path / 'heads.las'
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales, header.offsets = [0.001] * 3, [4e5, 5.4e6, 0.0]
    las = laspy.LasData(header)
    las['X'], las['Y'], las['Z'] = (one[order].astype(np.int32) for one in (x, y, z))
    las['gps_time'], las['scan_angle'], las['return_number'] = t[order], angle[order], number[order]
    las[source] = head[order]
    las.write(path)
    points = loaded(path).points
    assert len(np.unique(points.line)) == 32
    found = find_either(points, 'auto')
    assert found is not None
    assert found.model == PROFILE_MODEL
    rejected = judge(found.pattern, 1.0, model=found.model) > 1
    stray = bad[order].astype(bool)
    assert rejected[stray & (number[order] == 1)].mean() > 0.8
    assert rejected[~stray].mean() < 0.002


@pytest.mark.parametrize('kind', ['ptx', 'e57'])
def test_columns_of_grids(tmp_path: Path, kind: str) -> None:
    """Scans of a tripod have no times: their columns are lines for methods along lines."""
    column, row = np.divmod(np.arange(30 * 40), 40)
    azimuth, elevation = 0.01 * column, 0.01 * row - 0.3
    far = 8.0 / np.cos(azimuth) / np.cos(elevation)
    far[555] += 3.0
    xyz = far * np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)])
    path = tmp_path / f'tripod.{kind}'
    if kind == 'ptx':
        head = '30\n40\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n'
        path.write_text(head + ''.join(f'{x:.4f} {y:.4f} {z:.4f} 0.5\n' for x, y, z in xyz.T))
    else:
        order = np.random.default_rng(1).permutation(len(row))
        scan = dict(zip(('cartesianX', 'cartesianY', 'cartesianZ'), xyz[:, order], strict=True))
        scan |= {'columnIndex': column[order] + 7, 'rowIndex': row[order] + 3}
        write_e57(path, [scan])
    points = loaded(path, chain=['alpha_beta_gamma']).points
    x = xyz[0] if kind == 'ptx' else xyz[0, order]
    np.testing.assert_allclose(points.xyz[:, 0], x, atol=1e-3)
    true = column if kind == 'ptx' else column[order]
    assert (points.line == true).all()
    verdict = detect_outliers(
        points.xyz, t=points.t, line=points.line, parameters={'chain': ['alpha_beta_gamma']}
    )
    assert np.asarray(verdict.outlier)[555 if kind == 'ptx' else np.flatnonzero(order == 555)]
    assert loaded(path).lack == 'no column with the time of each point'


@pytest.mark.parametrize('source', ['point_source_id', 'user_data'])
def test_turns_of_scanners_without_angles(tmp_path: Path, source: str) -> None:
    """Where no column shows the mirror, times and geometry do, of each scanner by itself."""
    drives = [Drive(40 + k, 0.02, lines=40, shots=400) for k in range(2)]
    xyz = np.concatenate([drive.points.xyz for drive in drives])
    t = np.concatenate([drive.t * 1e-9 + 0.0013 * k for k, drive in enumerate(drives)])
    head = np.repeat([1, 2], [len(drive.t) for drive in drives])
    order = np.argsort(t, kind='stable')
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = [0.001] * 3
    las = laspy.LasData(header)
    las['X'], las['Y'], las['Z'] = np.rint(xyz[order].T * 1000).astype(np.int32)
    las['gps_time'], las[source] = 3.1e8 + t[order], head[order]
    las.write(tmp_path / 'heads.las')
    found = loaded(tmp_path / 'heads.las')
    assert 'scanner 0: ' in found.lines
    assert 'scanner 1: ' in found.lines
    for k in range(2):
        begins = np.flatnonzero(np.diff(found.points.line[head[order] == k + 1]))
        assert len(begins) >= 38


def test_no_scan_lines(tmp_path: Path) -> None:
    """Without columns of a mirror, or with a single line, there are no scan lines."""
    source = np.arange(8) // 4
    path = las(tmp_path, gps_time=source, point_source_id=source, scan_direction_flag=source)
    assert loaded(path).lines == ''
    found = loaded(las(tmp_path, gps_time=np.arange(8), point_source_id=source))
    assert (found.lines, found.lack) == ('', 'no column that says its scan lines')
    assert not found.points.line.any()
    assert find_lines(np.empty(0, np.int64), {EDGE: np.empty(0)}) == (None, '')


@pytest.mark.parametrize('high', [2**7, 2**40, 2**63])
def test_number_rows(high: int) -> None:
    """Rows of columns get the numbers that ``np.unique`` gives, in a small range or a large."""
    generator = np.random.default_rng(1)
    wide, narrow = generator.integers(-high, high, 999), generator.integers(-3, 3, 999)
    expected = np.unique(np.stack([wide, narrow]), axis=1, return_inverse=True)[1].reshape(-1)
    np.testing.assert_array_equal(number_rows([wide, narrow.astype(np.int8)]), expected)
