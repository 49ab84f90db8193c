# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The same columns are the same points, whether in a message, in arrays or in a file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.cloud_files import write_las
from helpers.clouds import SECOND, STAMP, cloud

from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.judged_file import CleanOptions, judge_file
from lidar_outlier_filter.files.points import Loaded, load
from lidar_outlier_filter.messages.array_cloud import as_message
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters

COUNT, LINES = 500, 5
SHOT = 4000  # nanoseconds
T = np.arange(COUNT) * SHOT
LINE = np.arange(COUNT) * LINES // COUNT
INTENSITY = np.arange(COUNT) % 7
FIELD: dict[str, object] = {
    'chain': ('field_range',),
    'field_range.field': 'signal',
    'field_range.max_value': 4.0,
    'field_range.max_range': 2.5,
}
UNITS = {'s': 1e9, 'ms': 1e6, 'us': 1e3, 'ns': 1.0}
# Names and types of time, line and intensity, unit of time, and what is said of it.
Layout = tuple[dict[str, str], str, str]
PLAIN: Layout = ({'t': 'u4', 'ring': 'u2', 'intensity': 'f4'}, 'ns', '')
FLOAT: Layout = ({'t': 'f8', 'ring': 'f4', 'intensity': 'f4'}, 'ns', '')
LAYOUTS: list[Layout] = [
    PLAIN,
    ({'Time': 'f8', 'Ring': 'u2', 'Intensity': 'f4'}, 's', ''),
    ({'GpsTime': 'f8', 'scalar_Line': 'f4', 'I': 'f4'}, 's', ''),
    ({'stamps': 'f4', 'layer': 'f4', 'scalar_Intensity': 'f4'}, 's', ''),
    ({'time_us': 'f8', 'Laser ID': 'f8', 'Reflectivity': 'f4'}, 'us', ''),
    (
        {'time': 'f4', 'laser': 'u1', 'i': 'f4'},
        'ms',
        "a time 'time' in ms: in s, points would be 0.004 s apart (time_unit)",
    ),
    (
        {'timestamp': 'u8', 'profile': 'i4', 'reflectance': 'f4'},
        'us',
        "a time 'timestamp' in us: in ns, points would be 4e-09 s apart (time_unit)",
    ),
]


def rows_of(layout: Layout) -> Rows:
    """Make a structured array: points of lines along y, one of which is far."""
    fields, unit, _ = layout
    rows = np.zeros(COUNT, [*((name, 'f8') for name in 'xyz'), *fields.items()])
    for name, values in zip(fields, (T / UNITS[unit], LINE, INTENSITY), strict=True):
        rows[name] = values
    rows['x'], rows['y'], rows['z'] = 0.1 * LINE, 0.02 * (np.arange(COUNT) % 100), 2.0
    rows['x'][250] += 3.0
    return rows


def as_csv(path: Path, rows: Rows) -> Path:
    """Write rows as a table."""
    lines = [','.join(f'{value!r}' for value in row) for row in rows.tolist()]
    path.write_text('\n'.join([','.join(rows.dtype.names or ()), *lines]))
    return path


def decoded(given: Any) -> tuple[Points, str]:
    """Decode a cloud; return its points, and what was warned of."""
    said: list[str] = []
    return Decoder(FilterParameters(), warn=said.append).decode(given), ' '.join(said)


def loaded(path: Path) -> Loaded:
    """Load a file with its times."""
    file = open_cloud(path)
    return load(file, ('x', 'y', 'z'), FilterParameters(), timed=True)


@pytest.mark.parametrize('layout', LAYOUTS)
def test_the_same_points_and_sentence(tmp_path: Path, layout: Layout) -> None:
    """Times, lines and intensities are the same in all forms, and what is said of them."""
    rows, ((time, line, _), unit, said) = rows_of(layout), layout
    file = loaded(as_csv(tmp_path / 'table.csv', rows))
    assert file.lines == f'{time} ({unit}) and {line}'
    for points, note, start in (
        (*decoded(as_message(rows, STAMP)), STAMP),
        (*decoded(cloud(rows, STAMP)), STAMP),
        (file.points, file.note, 0),
    ):
        assert (note.partition(' there is ')[2] or note) == said
        np.testing.assert_allclose(points.t - start, T, atol=20)  # float32 seconds, too
        assert points.line.tolist() == LINE.tolist()
        assert points.intensity is not None
        assert points.intensity.tolist() == INTENSITY.tolist()


@pytest.mark.parametrize('layout', LAYOUTS)
def test_the_same_verdict(tmp_path: Path, layout: Layout) -> None:
    """A structured array, its columns as arrays, a message and a file are judged alike."""
    rows, ((time, line, _), unit, said) = rows_of(layout), layout
    chain = FilterParameters().changed({'chain': ('alpha_beta_gamma',)})
    notes: list[str] = []
    verdict = detect_outliers(rows, parameters=chain, warn=notes.append)
    assert [one.partition(' there is ')[2] for one in notes] == [said] * bool(said)
    assert np.flatnonzero(verdict.outlier).tolist() == [250]
    xyz = np.column_stack([rows[name] for name in 'xyz'])
    arrays = detect_outliers(
        xyz, t=rows[time], line=rows[line], parameters=chain.changed({'time_unit': unit})
    )
    file = open_cloud(as_csv(tmp_path / 'table.csv', rows))
    judged = judge_file(file, CleanOptions(), chain).verdict
    for other in (arrays, detect_outliers(cloud(rows), parameters=chain), judged):
        np.testing.assert_array_equal(other.outlier, verdict.outlier)


def test_lines_that_are_no_numbers_of_lines(tmp_path: Path) -> None:
    """A float with fractions is not used as a line, and that is said, in all forms."""
    rows = rows_of(FLOAT)
    rows['ring'] += 0.5
    said = "'ring', which is not used: not of whole numbers"
    _, note = decoded(cloud(rows))
    assert said in note
    file = loaded(as_csv(tmp_path / 'table.csv', rows))
    assert (file.note, file.lack) == (said, 'no column that says its scan lines')


def test_plain_arrays_in_another_unit() -> None:
    """The unit of plain times is that of time_unit, or the one that makes sense; that is said."""
    rows = rows_of(FLOAT)
    xyz = np.column_stack([rows[name] for name in 'xyz'])
    seen = []
    for t, values in (
        (T * 1e-9, {}),
        (T * 1e-3, {}),
        (T * 1e-3, {'time_unit': 'us'}),
        (1.7e15 + T * 1e-3, {}),
    ):
        notes: list[str] = []
        parameters = {'chain': ['alpha_beta_gamma'], **values}
        verdict = detect_outliers(xyz, t=t, line=LINE, parameters=parameters, warn=notes.append)
        assert np.flatnonzero(verdict.outlier).tolist() == [250]
        seen.append(notes)
    said = "among the arrays there is a time 't' in us: in ns, points would be 4e-09 s apart"
    assert seen == [[], [f'{said} (time_unit)'], [], []]


@pytest.mark.parametrize('name', ['signal', 'Signal', 'scalar_Signal'])
def test_a_field_by_its_name(tmp_path: Path, name: str) -> None:
    """The field that a detector names is the same in a message, an array and a file."""
    rows = rows_of(({'t': 'u4', 'ring': 'u2', name: 'f8'}, 'ns', ''))
    rows[name][250] = np.nan
    chain = FilterParameters().changed(FIELD)
    file = open_cloud(as_csv(tmp_path / 'table.csv', rows))
    reach = np.linalg.norm([rows[axis] for axis in 'xyz'], axis=0)
    expected = (INTENSITY > 4) & (reach < 2.5)
    expected[250] = False
    assert 20 < np.count_nonzero(expected) < np.count_nonzero(INTENSITY > 4)
    for verdict in (
        detect_outliers(rows, parameters=chain),
        detect_outliers(cloud(rows), parameters=chain),
        judge_file(file, CleanOptions(), chain).verdict,
    ):
        np.testing.assert_array_equal(verdict.outlier, expected)
        assert np.flatnonzero(np.isnan(verdict.score)).tolist() == [250]


def test_a_field_that_is_missing(tmp_path: Path) -> None:
    """Nothing is tested, which is said once of a stream, of arrays and of a file, and counted."""
    rows, chain = rows_of(PLAIN), FilterParameters().changed(FIELD)
    said = "no 'signal', which a detector of the chain reads: it tests no point"
    notes: list[str] = []
    stream = CloudFilter(parameters=chain, warn=notes.append)
    for number in range(3):
        stream.push(rows, stamp=STAMP + number * SECOND)
    stream.flush()
    assert stream.statistics.undecided == {'field_range': 3 * COUNT}
    assert stream.statistics.untested == 3 * COUNT
    xyz = np.column_stack([rows[axis] for axis in 'xyz'])
    assert not detect_outliers(xyz, parameters=chain, warn=notes.append).outlier.any()
    assert [one.partition(' there is ')[2] for one in notes] == [said, said]
    path = as_csv(tmp_path / 'table.csv', rows)
    assert judge_file(open_cloud(path), CleanOptions(), chain).loaded.note == said
    assert main(['clean', str(path), '--chain', 'field_range', '--set', 'field_range.field=b']) == 3


def test_a_field_of_a_survey(tmp_path: Path) -> None:
    """That of LAS, in one piece and with the points beside the file, and that of arrays."""
    values = np.array([1, 9, 3, 9, 5])
    for name, x in (('one.las', 100), ('beside.las', 150)):
        write_las(tmp_path / name, 5, X=x + np.arange(5), Z=np.ones(5), intensity=values)
    chain = FilterParameters().changed({'chain': ['field_range'], 'field_range.max_value': 4.0})
    xyz = np.column_stack([1.0 + 0.01 * np.arange(5), np.zeros(5), np.full(5, 0.01)])
    file = open_cloud(tmp_path / 'one.las')
    for verdict in (
        detect_outliers(xyz, intensity=values, parameters=chain),
        *(judge_file(file, CleanOptions(buffer=wide), chain).verdict for wide in (0.0, 1.0)),
    ):
        assert verdict.outlier.tolist() == [False, True, False, True, True]
