# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Labels from foreign files, scores beside them, and what codes mean."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import laspy
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.evaluation.judged import ColumnNames, read_files
from lidar_outlier_filter.evaluation.labels import (
    ALL_BUT_0,
    USUAL_CODES,
    Codes,
    by_number,
    is_recording,
    parse_codes,
    read_codes,
    read_column,
)

if TYPE_CHECKING:
    from pathlib import Path

CODE = np.array([0, 7, 1, 18, 7, 65])
SCORE = np.array([0.5, 3.0, 1.0, np.nan, 1.0000001, 0.25])


def las(path: Path, classes: Any, **columns: Any) -> Path:
    """Write a LAS file with these classes and further dimensions."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = np.full(3, 0.001)
    for name, values in columns.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, np.asarray(values).dtype))
    data = laspy.LasData(header)
    data.x = data.y = data.z = np.arange(len(classes)) + 1.0
    data.classification = classes
    for name, values in columns.items():
        data[name] = values
    data.write(path)
    return path


def table(path: Path, **columns: Any) -> Path:
    """Write a table as CSV or Parquet."""
    made = pa.table(columns)
    (csv.write_csv if path.suffix == '.csv' else parquet.write_table)(made, path)
    return path


def test_semantic_kitti(tmp_path: Path) -> None:
    """The class is in the low 16 bits, the instance in the others; class 1 is the outlier."""
    path = tmp_path / '000000.label'
    np.array([0, 1, 40, 1 | (77 << 16), 40 | (65535 << 16)], '<u4').tofile(path)
    codes = read_codes(path, '')
    np.testing.assert_array_equal(codes, [0, 1, 40, 1, 40])
    meaning = USUAL_CODES['.label']
    np.testing.assert_array_equal(meaning.bad(codes), [0, 1, 0, 1, 0])
    np.testing.assert_array_equal(meaning.counted(codes), [0, 1, 1, 1, 1])


@pytest.mark.parametrize('suffix', ['.las', '.laz'])
def test_las_classes(tmp_path: Path, suffix: str) -> None:
    """Low and high noise are outliers; another column may hold the truth, too."""
    path = las(tmp_path / f'a{suffix}', CODE, truth=np.arange(6).astype(np.uint8))
    np.testing.assert_array_equal(read_codes(path, 'classification'), CODE)
    np.testing.assert_array_equal(USUAL_CODES[suffix].bad(CODE), [0, 1, 0, 1, 1, 0])
    np.testing.assert_array_equal(read_codes(path, 'truth'), np.arange(6))


@pytest.mark.parametrize('suffix', ['.csv', '.parquet'])
def test_columns_of_tables(tmp_path: Path, suffix: str) -> None:
    """Whole numbers and scores; an empty cell is an untested point."""
    scores = [None if np.isnan(score) else score for score in SCORE]
    path = table(tmp_path / f'a{suffix}', x=np.zeros(6), code=CODE, score=pa.array(scores))
    np.testing.assert_array_equal(read_codes(path, 'code'), CODE)
    np.testing.assert_array_equal(read_column(path, 'score'), SCORE)


def test_npy(tmp_path: Path) -> None:
    """An array is a column."""
    np.save(tmp_path / 'a.npy', CODE)
    np.testing.assert_array_equal(read_codes(tmp_path / 'a.npy', ''), CODE)
    np.save(tmp_path / 'b.npy', CODE.astype(np.float32))
    np.testing.assert_array_equal(read_codes(tmp_path / 'b.npy', ''), CODE)


@pytest.mark.parametrize(
    ('text', 'codes'),
    [('7', {7}), ('7,18', {7, 18}), ('1-3, 110', {1, 2, 3, 110}), ('0-0', {0})],
)
def test_codes(text: str, codes: set[int]) -> None:
    """Single codes and ranges, both ends included."""
    assert parse_codes(text) == codes


@pytest.mark.parametrize('text', ['', 'x', '3-1', '1-', '-1', '70000', '1.5', '1,,2', '²'])
def test_refused_codes(text: str) -> None:
    """What is no code is refused with an example."""
    with pytest.raises(
        FilterError, match=r"must be numbers up to 65535 as in '7,18' or '1-5', got"
    ):
        parse_codes(text)


def test_default_is_all_but_0() -> None:
    """Without a meaning every code but 0 is an outlier, and all count."""
    np.testing.assert_array_equal(ALL_BUT_0.bad(CODE), [0, 1, 1, 1, 1, 1])
    assert ALL_BUT_0.counted(CODE).all()


def test_recordings_are_told_from_files(tmp_path: Path) -> None:
    """A folder and what bags are called; anything else has a value for each point."""
    assert is_recording(tmp_path)
    assert all(is_recording(tmp_path / name) for name in ('a', 'a.mcap', 'a.db3', 'A.BAG'))
    names = ('a.npy', 'a.laz', 'a.csv', 'a.label', 'a.db')
    assert not any(is_recording(tmp_path / name) for name in names)


def test_refused_files(tmp_path: Path) -> None:
    """Each in one sentence that names the file."""
    (tmp_path / 'odd.label').write_bytes(b'12345')
    np.save(tmp_path / 'flat.npy', np.zeros((2, 3)))
    np.save(tmp_path / 'text.npy', np.array(['a']))
    np.save(tmp_path / 'half.npy', np.array([1.0, 0.5]))
    np.save(tmp_path / 'nan.npy', np.array([np.nan]))
    np.save(tmp_path / 'large.npy', np.array([1, -70000]))
    (tmp_path / 'broken.las').write_bytes(b'LASF')
    table(tmp_path / 'a.csv', x=[1.0])
    for name, match in (
        ('odd.label', r'the size of .*odd\.label must be a multiple of 4 bytes, got 5'),
        ('flat.npy', r'must be one number for each point, got float64 \(2, 3\)'),
        ('text.npy', r'must be one number for each point, got <U1 \(1,\)'),
        ('half.npy', r'must be whole numbers up to 65535, got 0\.5'),
        ('nan.npy', r'must be whole numbers up to 65535, got nan'),
        ('large.npy', r'must be whole numbers up to 65535, got -70000'),
        ('broken.las', r'the header of .*broken\.las must be of at least 227 bytes, got 4'),
        ('none.npy', r'none\.npy must be readable, got "'),
        ('a.csv', r"must be one of x, got 'code'"),
        ('a.odt', r'the file .*a\.odt must be one of \.las'),
    ):
        with pytest.raises(FilterError, match=match) as caught:
            read_codes(tmp_path / name, 'code')
        assert '\n' not in str(caught.value)


# Files with verdicts -----------------------------------------------------------------------------


def test_scores_and_labels(tmp_path: Path) -> None:
    """A point is rejected above the threshold, not at it; an untested one is kept."""
    np.save(tmp_path / 'score.npy', SCORE)
    np.save(tmp_path / 'code.npy', CODE)
    pair = (tmp_path / 'score.npy', tmp_path / 'code.npy')
    points = read_files(*pair, Codes(frozenset({7, 18})))
    np.testing.assert_array_equal(points.rejected, [0, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 0, 1, 1, 0])
    np.testing.assert_array_equal(points.index, np.arange(6))
    np.testing.assert_array_equal(points.score, SCORE)
    assert points.detectors is None
    points = read_files(*pair, columns=ColumnNames(threshold=0.25))
    np.testing.assert_array_equal(points.rejected, [1, 1, 1, 0, 1, 0])


def test_what_clean_wrote_in_las(tmp_path: Path) -> None:
    """Rejected are the classes 7 and 18, the truth are those of the file before it was cleaned."""
    before = las(tmp_path / 'before.laz', [1, 65, 65, 2, 1, 1])
    after = las(tmp_path / 'after.laz', [1, 7, 65, 7, 18, 1])
    points = read_files(after, before, Codes(frozenset({65})))
    np.testing.assert_array_equal(points.rejected, [0, 1, 0, 1, 1, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 1, 0, 0, 0])
    assert points.score is None


def test_what_clean_wrote_in_tables(tmp_path: Path) -> None:
    """The column outlier says what was rejected, whatever the scores are, as under a vote."""
    columns = {
        'label': [0, 1, 1, 0, 0, 0],
        'outlier': [0, 1, 0, 0, 1, 0],
        'outlier_score': [0.5, 3.0, 2.0, 0.1, 1.5, 0.25],
        'outlier_detectors': [0, 5, 4, 0, 5, 0],
    }
    path = table(tmp_path / 'a.parquet', **columns)
    points = read_files(path, path)
    np.testing.assert_array_equal(points.rejected, columns['outlier'])
    np.testing.assert_array_equal(points.detectors, columns['outlier_detectors'])
    np.testing.assert_array_equal(points.score, columns['outlier_score'])
    # Asked for, the score decides.
    for asked in (ColumnNames(score='outlier_score'), ColumnNames(threshold=1.0)):
        points = read_files(path, path, columns=asked)
        np.testing.assert_array_equal(points.rejected, [0, 1, 1, 0, 1, 0])
    points = read_files(path, path, columns=ColumnNames(verdict='outlier_detectors'))
    np.testing.assert_array_equal(points.rejected, [0, 1, 1, 0, 1, 0])


def test_refused_pairs(tmp_path: Path) -> None:
    """One column cannot be both; numbers must fit; columns must be there."""
    np.save(tmp_path / 'six.npy', SCORE)
    np.save(tmp_path / 'five.npy', CODE[:5])
    with pytest.raises(FilterError, match='labels and verdicts must be equal, got 5 and 6'):
        read_files(tmp_path / 'six.npy', tmp_path / 'five.npy')
    cloud = las(tmp_path / 'a.las', CODE)
    with pytest.raises(
        FilterError, match="another than that of the verdicts, got 'classification'"
    ):
        read_files(cloud, cloud)
    plain = table(tmp_path / 'a.csv', x=[1.0] * 6)
    with pytest.raises(FilterError, match='must be with outlier or classification, got x'):
        read_files(plain, cloud)
    with pytest.raises(FilterError, match='must be with classification or label, got x'):
        read_files(cloud, plain)
    with pytest.raises(FilterError, match='must be with outlier_score, got x'):
        read_files(plain, cloud, columns=ColumnNames(threshold=2.0))


def test_real_labelled_cloud(recordings: Path) -> None:
    """The artefacts of a real aerial cloud are class 65."""
    path = recordings / 'clouds' / 'test_semis_2021_0382_6565_LA93_IGN69_cropped.laz'
    codes = read_codes(path, 'classification')
    assert len(codes) == 218_731
    assert np.count_nonzero(Codes(frozenset({65})).bad(codes)) == 89


@pytest.mark.parametrize(
    ('names', 'got'),
    [
        (['a.label', 'b.label'], 'a.label and b.label'),
        (['1_1.label', '1_2.label', '2_1.label'], '1_2.label and 2_1.label'),
        (['1_1.label', '1_2.label', '2_2.label'], '1_2.label and 2_2.label'),
        (['1.label', '01.label'], '1.label'),
        (['1.label', '2.label', 'README'], '2.label and README'),
        (['1.label', '2.npy'], '1.label and 2.npy'),
        (['1.label', '1_2.label'], '1.label and 1_2.label'),
    ],
)
def test_labels_of_which_the_clouds_are_not_known(
    tmp_path: Path, names: list[str], got: str
) -> None:
    """Names that differ in more than one number, or less, are refused."""
    for name in names:
        (tmp_path / name).touch()
    sentence = f'the names in {tmp_path} must be alike but for one number, that of the cloud, got '
    with pytest.raises(RecordingError) as caught:
        by_number(tmp_path)
    assert str(caught.value).startswith(sentence)
    assert got in str(caught.value)
